"""Do the tests bite? Small changes of the source, one at a time, and whether the tests of the same folder notice them.

    python tests/mutations.py results.jsonl                     # 300 changes; goes on where it was stopped
    python tests/mutations.py results.jsonl --part 2/3          # a third of them
    python tests/mutations.py results.jsonl --compiled          # those not noticed, once more with compilation
    python tests/mutations.py results.jsonl --report            # shares by folder, and what nobody noticed

A change turns a sign, a comparison, ``and`` into ``or``, ``min`` into ``max``, ``sin`` into ``cos``, takes a condition as its
opposite or a constant times 1.1. Messages, names, defaults of arguments and annotations are left alone. The source is changed
in a copy; the tests run without compilation first, those named after the module before the others of its folder. Tests that
fail, or are slow, on the unchanged source are left out: they are found first, once for each folder.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TESTS = ROOT / "src" / "riftberg", ROOT / "tests"

FOLDERS = ("physics", "stepping", "life", "ocean", "products", "bergs", "diagnostics", "runs")

OTHERS = {"physics": ("stepping",), "diagnostics": ("viz", "cli"), "runs": ("cli",)}
"""Folders of tests that also hold a folder of the source to its word."""

COMPILED_OTHERS = {"stepping": ("verification",), "physics": ("verification",)}
"""The same, of tests that take too long without compilation."""

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Lt: ast.GtE, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=",
         ast.Eq: "==", ast.NotEq: "!=", ast.And: "and", ast.Or: "or"}  # fmt: skip
CALLS = {"min": "max", "max": "min", "sin": "cos", "cos": "sin", "minimum": "maximum", "maximum": "minimum"}
QUIET = ("raise", "warn", "logger", "InputError", "ForcingError", "BergError", "RunError", "print", "echo")
"""What a line with one of these says is a message, not a result."""


class Change(NamedTuple):
    """One change: characters ``start`` to ``end`` of a file become ``new``."""

    path: str
    start: int
    end: int
    new: str
    line: int
    kind: str


def changes_of(path: Path) -> Iterator[Change]:
    """Give every change that a module offers."""
    text = path.read_text("utf-8")
    lines = text.splitlines(keepends=True)
    offsets = [0]
    for line in lines:
        offsets.append(offsets[-1] + len(line.encode()))
    raw = text.encode()
    name = path.relative_to(SOURCE).as_posix()

    def place(line: int, column: int) -> int:
        return offsets[line - 1] + column

    def between(left: ast.AST, right: ast.AST, old: str, new: str, kind: str) -> Iterator[Change]:
        start, end = place(left.end_lineno, left.end_col_offset), place(right.lineno, right.col_offset)
        found = re.search(rf"(?<![\w<>=!*/]){re.escape(old)}(?![\w=*/])", raw[start:end].decode())
        if found:
            at = start + len(raw[start:end].decode()[: found.start()].encode())
            yield Change(name, at, at + len(old), new, left.end_lineno, kind)

    def walk(node: ast.AST) -> Iterator[Change]:
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
            return
        if isinstance(node, ast.AnnAssign):
            yield from walk(node.value) if node.value else ()
            return
        if isinstance(node, ast.FunctionDef):
            for child in node.body:
                yield from walk(child)
            return
        if isinstance(node, ast.Call) and any(word in ast.unparse(node.func) for word in QUIET):
            return
        if isinstance(node, ast.BinOp) and type(node.op) in (ast.Add, ast.Sub, ast.Mult) and not _is_text(node):
            old, new = SIGNS[type(node.op)], SIGNS[SWAPS[type(node.op)]]  # type: ignore[index]
            yield from between(node.left, node.right, old, new, f"{old} to {new}")
        if isinstance(node, ast.BoolOp):
            old, new = SIGNS[type(node.op)], SIGNS[SWAPS[type(node.op)]]  # type: ignore[index]
            yield from between(node.values[0], node.values[1], old, new, f"{old} to {new}")
        if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS:
            old, new = SIGNS[type(node.ops[0])], SIGNS[SWAPS[type(node.ops[0])]]  # type: ignore[index]
            yield from between(node.left, node.comparators[0], old, new, f"{old} to {new}")
        if isinstance(node, ast.Constant) and type(node.value) is float and node.value not in (0.0,):
            start, end = place(node.lineno, node.col_offset), place(node.end_lineno, node.end_col_offset)
            yield Change(name, start, end, f"{1.1 * node.value!r}", node.lineno, "constant times 1.1")
        if isinstance(node, ast.Call):
            word = ast.unparse(node.func).rpartition(".")[2]
            if word in CALLS:
                end = place(node.func.end_lineno, node.func.end_col_offset)
                yield Change(name, end - len(word), end, CALLS[word], node.lineno, f"{word} to {CALLS[word]}")
        if (
            isinstance(node, ast.UnaryOp)
            and isinstance(node.op, ast.USub)
            and not isinstance(node.operand, ast.Constant)
        ):
            start = place(node.lineno, node.col_offset)
            yield Change(name, start, start + 1, "+", node.lineno, "sign")
        for child in ast.iter_child_nodes(node):
            yield from walk(child)

    yield from walk(ast.parse(text))


def _is_text(node: ast.BinOp) -> bool:
    """Whether a sum joins texts."""
    return any(
        isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
        for n in ast.walk(node)
    )


def sample(count: int, seed: int) -> list[Change]:
    """Return changes at random: as many from each folder as it has of all, no two in one line."""
    random_ = random.Random(seed)
    every = [c for folder in FOLDERS for path in sorted((SOURCE / folder).rglob("*.py")) for c in changes_of(path)]
    random_.shuffle(every)
    taken: dict[tuple[str, int], Change] = {}
    for change in every:
        taken.setdefault((change.path, change.line), change)
    return list(taken.values())[:count]


def folder_of_tests(folder: str, *, compiled: bool) -> list[Path]:
    """Return the files of tests for a folder of the source."""
    others = (*OTHERS.get(folder, ()), *(COMPILED_OTHERS.get(folder, ()) if compiled else ()))
    return [p for name in (folder, *others) for p in sorted((TESTS / name).rglob("test_*.py"))]


def test_files(change: Change, *, compiled: bool) -> list[str]:
    """Return the files of tests for a change: those that name its module first, then the rest of its folder."""
    module = Path(change.path).stem
    dotted = "riftberg." + change.path.removesuffix(".py").replace("/", ".")

    def rank(path: Path) -> tuple[int, int]:
        named = module in path.stem
        used = dotted in path.read_text("utf-8")
        return (0 if named and used else 1 if used else 2 if named else 3), path.stat().st_size

    return [
        str(p.relative_to(ROOT))
        for p in sorted(folder_of_tests(change.path.split("/")[0], compiled=compiled), key=rank)
    ]


def pytest(source: Path, arguments: list[str], *, compiled: bool, seconds: float | None) -> tuple[int, str]:
    """Run tests on a source; return how pytest ended and what it printed."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(source), os.environ.get("PYTHONPATH", "")])}
    env |= {"MPLBACKEND": "Agg"} if compiled else {"MPLBACKEND": "Agg", "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", "-rfE"]
    done = subprocess.run(
        [*command, *arguments], cwd=ROOT, env=env, capture_output=True, text=True, timeout=seconds, check=False
    )
    return done.returncode, done.stdout


def failing(folder: str, results: Path, *, compiled: bool) -> list[str]:
    """Return the tests of a folder that fail on the unchanged source; found once and kept beside the results."""
    path = results.with_suffix(".compiled.json" if compiled else ".baseline.json")
    known = json.loads(path.read_text()) if path.exists() else {}
    if folder not in known:
        files = [str(p.relative_to(ROOT)) for p in folder_of_tests(folder, compiled=compiled)]
        longest = "60" if compiled else "10"  # s; what takes longer without compilation is left to the compiled run
        _, text = pytest(SOURCE.parent, ["--timeout", longest, *files], compiled=compiled, seconds=None)
        known[folder] = re.findall(r"^(?:FAILED|ERROR) (tests/.*?)(?: - .*)?$", text, flags=re.M)
        path.write_text(json.dumps(known, indent=1))
    return known[folder]


def tried(change: Change, left_out: list[str], *, compiled: bool, seconds: float) -> dict[str, Any]:
    """Change a copy of the source, run the tests up to the first failure, and return what came."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "src"
        shutil.copytree(SOURCE, source / "riftberg", ignore=shutil.ignore_patterns("__pycache__"))
        path = source / "riftberg" / change.path
        raw = path.read_bytes()
        path.write_bytes(raw[: change.start] + change.new.encode() + raw[change.end :])
        line = path.read_text("utf-8").splitlines()[change.line - 1].strip()
        # A test that hangs fails after two minutes; tests of a folder that end neither way count as not noticed.
        arguments = [
            "-x",
            "--timeout",
            "120",
            *(f"--deselect={test}" for test in left_out),
            *test_files(change, compiled=compiled),
        ]
        try:
            code, text = pytest(source, arguments, compiled=compiled, seconds=seconds)
        except subprocess.TimeoutExpired:
            code, text = -1, ""
    verdict = {0: "unnoticed", -1: "too long"}.get(code, "noticed")
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", text, flags=re.M)
    test = failed.group(1) if failed else "" if code <= 0 else text[-200:]
    return {**change._asdict(), "text": line, "verdict": verdict, "test": test, "compiled": compiled}


def report(results: list[dict[str, Any]]) -> None:
    """Print shares by folder, and the changes that nobody noticed."""
    last = {(r["path"], r["start"]): r for r in results}
    count: Counter[str] = Counter(path.split("/")[0] for path, _ in last)
    found = Counter(r["path"].split("/")[0] for r in last.values() if r["verdict"] == "noticed")
    for folder in count:
        print(f"{folder:>12}  {found[folder]:3d} of {count[folder]:3d} noticed")
    total, noticed = sum(count.values()), sum(found.values())
    print(f"{'all':>12}  {noticed:3d} of {total:3d} noticed, {100.0 * noticed / max(total, 1):.1f} %")
    for r in last.values():
        if r["verdict"] != "noticed":
            print(f"  {r['path']}:{r['line']}  {r['kind']}:  {r['text']}")


def main() -> None:
    """Try changes, or print what came."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "results", type=Path, help="file of results, one line a change; what it holds is not tried again"
    )
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=24)
    parser.add_argument("--part", default="1/1", help="which part of the changes to try, such as 2/3")
    parser.add_argument("--seconds", type=float, default=600.0, help="longest time for the tests of a change")
    parser.add_argument("--compiled", action="store_true", help="try those that were not noticed once more, compiled")
    parser.add_argument("--report", action="store_true")
    options = parser.parse_args()
    results = (
        [json.loads(line) for line in options.results.read_text().splitlines()] if options.results.exists() else []
    )
    if options.report:
        report(results)
        return
    known = {(r["path"], r["start"]): r for r in results}
    number, parts = (int(n) for n in options.part.split("/"))
    for change in sample(options.count, options.seed)[number - 1 :: parts]:
        before = known.get((change.path, change.start))
        again = options.compiled and before and before["verdict"] != "noticed" and not before["compiled"]
        if (before and not again) or (options.compiled and not before):
            continue
        left_out = failing(change.path.split("/")[0], options.results, compiled=options.compiled)
        result = tried(change, left_out, compiled=options.compiled, seconds=options.seconds)
        with options.results.open("a") as file:
            file.write(json.dumps(result) + "\n")
        print(f"{result['verdict']:>10}  {change.path}:{change.line}  {change.kind}  {result['test']}", flush=True)


if __name__ == "__main__":
    main()
