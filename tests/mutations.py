"""Do the tests bite? Small changes of the source, one at a time, and whether the tests of the same folder notice them.

    python tests/mutations.py results.jsonl --count 100 --seed 26    # 100 changes; goes on where it was stopped
    python tests/mutations.py results.jsonl --for 450                # a piece: stops after so many seconds
    python tests/mutations.py results.jsonl --folders physics,engines/common   # drawn from these alone
    python tests/mutations.py results.jsonl --again --tests tests/ocean/test_grid.py   # those not noticed, by these tests
    python tests/mutations.py results.jsonl --again --compiled       # those not noticed, once more with compilation
    python tests/mutations.py results.jsonl --report                 # shares by folder, and what nobody noticed

A change turns a sign, a comparison, ``and`` into ``or``, ``min`` into ``max``, ``sin`` into ``cos``, takes a condition as its
opposite or a constant times 1.1. Messages, names, defaults of arguments and annotations are left alone. The source is copied
once, beside the results, and changed there; so a later edit of the source does not mix two samples.

The tests of `PLAIN` run without compilation first, those of other folders with it. One run of a
folder's tests on the unchanged source, with a probe before the statement of each change, finds how long every test takes and
which statements it reaches. A change is then tried on the tests that reach it, the quickest first, and on the others of
their files. Tests that fail, or take over ten seconds, on the unchanged source are left out. A test that no longer ends has
noticed.

`SAME` lists changes that mean the same, by file, words of the line where there are any, and kind; where they go unnoticed
they do not count. Look at each that it takes out.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import json
import math
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TESTS = ROOT / "src" / "riftberg", ROOT / "tests"

SAME = TESTS / "mutations_same.txt"

FOLDERS = tuple(sorted(p.parent.name for p in SOURCE.glob("*/__init__.py")))

OTHERS = {
    "physics": ("engines",),
    "coupling": ("kid/test_driver.py", "kid/test_driver_corners.py", "kid/test_hours.py", "kid/test_run.py",
                 "kid/test_mixed_options.py", "parity/test_coupling.py", "engines/test_population_step.py"),
    "diagnostics": ("viz", "cli", "verify", "runs/test_channels.py"),
    "ensembles": ("verify",),
    "runs": ("cli",),
    "cli": ("ensembles", "verify"),
    "config": ("test_usual.py", "test_values.py", "test_units.py", "test_arguments.py", "experiments"),
    "system": ("test_bad_input.py", "test_values.py", "test_units.py", "experiments"),
    "compiled": ("test_machine_code.py", "test_threads.py"),
    "engines/quasi_static/contact": ("physics/test_contact.py", "test_several_bergs.py", "test_births.py"),
}  # fmt: skip
"""Folders and files of tests that also hold a folder of the source to its word."""

INSTEAD = {"verification": "verify"}
"""Folders of the source whose tests have another name; tests of that name compare the model with theory."""

PLAIN = ("physics", "engines", "life", "ocean")
"""Folders made of kernels, whose tests run without compilation first: no probe is seen in machine code."""

COMPILED_OTHERS = {"engines": ("verification",), "physics": ("verification",)}
"""The same, of tests that take too long without compilation."""

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Lt: ast.GtE, ast.Gt: ast.LtE, ast.LtE: ast.Gt,
    ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=",
         ast.Eq: "==", ast.NotEq: "!=", ast.And: "and", ast.Or: "or"}  # fmt: skip
CALLS = {"min": "max", "max": "min", "sin": "cos", "cos": "sin", "minimum": "maximum", "maximum": "minimum"}
LONGEST = 1e6
"""Seconds that are waited for tests at most: beyond some 24 days, as for ``inf``, Python raises OverflowError."""

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


def changes_of(path: Path, source: Path) -> Iterator[Change]:
    """Give every change that a module offers."""
    text = path.read_text("utf-8")
    lines = text.splitlines(keepends=True)
    offsets = [0]
    for line in lines:
        offsets.append(offsets[-1] + len(line.encode()))
    raw = text.encode()
    name = path.relative_to(source).as_posix()

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


def sample(source: Path, folders: list[str], count: int, seed: int) -> list[Change]:
    """Return changes at random: as many from each folder as it has of all that are named, no two in one line."""
    random_ = random.Random(seed)
    every = [
        c for folder in folders for path in sorted((source / folder).rglob("*.py")) for c in changes_of(path, source)
    ]
    random_.shuffle(every)
    taken: dict[tuple[str, int], Change] = {}
    for change in every:
        taken.setdefault((change.path, change.line), change)
    return list(taken.values())[:count]


def folder_of_tests(folder: str, *, compiled: bool) -> list[str]:
    """Return the files of tests for a folder of the source."""
    top = folder.partition("/")[0]
    others = (*OTHERS.get(folder, ()), *(COMPILED_OTHERS.get(top, ()) if compiled else ()))
    places = [TESTS / name for name in (INSTEAD.get(top, top), *others)]
    files = [p for place in places for p in ([place] if place.is_file() else sorted(place.rglob("test_*.py")))]
    return [str(p.relative_to(ROOT)) for p in files]


class Tree:
    """A copy of the source that one process changes, and the results that it belongs to."""

    def __init__(self, results: Path) -> None:
        """Copy the pinned source to a folder of this process."""
        self.results = results
        self.pinned = results.with_suffix(".src")
        if not self.pinned.exists():
            shutil.copytree(SOURCE.parent, self.pinned, ignore=shutil.ignore_patterns("__pycache__"))
        self.folder = Path(tempfile.mkdtemp(prefix="changed-"))
        shutil.copytree(self.pinned, self.folder / "src")
        shutil.copy(__file__, self.folder / "mutations.py")

    def has_kernels(self, change: Change) -> bool:
        """Whether a change is in a module with compiled functions, whose statements no probe sees once compiled."""
        return "compiled.kernels" in (self.pinned / "riftberg" / change.path).read_text("utf-8")

    def pytest(self, files: list[str], orders: dict[str, Any], *, compiled: bool, seconds: float) -> tuple[int, str]:
        """Run tests on the copy; return how pytest ended and what it printed."""
        (self.folder / "orders.json").write_text(json.dumps(orders))
        path = [str(self.folder / "src"), str(self.folder), os.environ.get("PYTHONPATH", "")]
        env = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path),
            "MPLBACKEND": "Agg",
            ORDERS: str(self.folder / "orders.json"),
        }
        env |= {} if compiled else {"NUMBA_DISABLE_JIT": "1"}
        # Byte code is told apart by the second and the size of its source, which a change of one sign leaves alike.
        env |= {"PYTHONDONTWRITEBYTECODE": "1"} if "order" in orders else {}
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "mutations",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:xdist",
            "-o",
            "timeout_func_only=true",  # set-ups compile, for a minute under load: an error of theirs is no notice of a change
            "--tb=no",
            "-rfE",
        ]
        process = subprocess.Popen(
            [*command, *orders.get("options", ()), *files], cwd=ROOT, env=env,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            text, _ = process.communicate(timeout=min(seconds, LONGEST))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return -1, ""
        return process.returncode, text

    def reach(self, folder: str, changes: list[Change], *, compiled: bool, seconds: float) -> dict[str, Any] | None:
        """Return how long each test of a folder takes and which changes it reaches; None if the time does not suffice.

        It is kept beside the results, a line for each test, so that a second call goes on.
        """
        path = self.results.with_suffix(f".{folder.replace('/', '-')}.jsonl")
        rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
        if rows[-1:] != ["all"]:
            by_path: dict[str, list[tuple[int, int]]] = {}
            seen = [c for c in changes if not compiled or not self.has_kernels(c)]
            for number, change in enumerate(seen):
                by_path.setdefault(change.path, []).append((change.start, number))
            for name, places in by_path.items():
                file = self.folder / "src" / "riftberg" / name
                file.write_text(probed(file.read_text("utf-8"), places), "utf-8")
            # Programs that tests start have probes too.
            (self.folder / "sitecustomize.py").write_text("import builtins\nbuiltins.__reached__ = set().add\n")
            known = {
                "keys": [key(c) for c in seen],
                "known": [row["test"] for row in rows],
                "to": str(path),
                "options": ["--timeout", "15"],
            }
            files = folder_of_tests(folder, compiled=False)
            try:
                code, text = self.pytest(files, known, compiled=compiled, seconds=seconds)
            finally:
                (self.folder / "sitecustomize.py").unlink()
                for name in by_path:
                    shutil.copy(self.pinned / "riftberg" / name, self.folder / "src" / "riftberg" / name)
                    forget(self.folder / "src" / "riftberg" / name)
            if code == -1:
                return None
            if (
                code == 3
            ):  # a limit of time that strikes where a frame has no line ends pytest; without that test once more
                return self.reach(folder, changes, compiled=compiled, seconds=seconds)
            if code not in (0, 1, 5):
                raise SystemExit(text)
            with path.open("a") as file:
                file.write('"all"\n')
            rows = [json.loads(line) for line in path.read_text().splitlines()]
        found: dict[str, Any] = {"seconds": {}, "reached": {}}
        for row in rows[:-1]:
            if row["seconds"] is not None:
                found["seconds"][row["test"]] = row["seconds"]
            for name in row["reached"]:
                found["reached"].setdefault(name, []).append(row["test"])
        return found

    def tried(
        self, change: Change, files: list[str], order: list[str], *, compiled: bool, seconds: float
    ) -> dict[str, Any]:
        """Change the copy, run the tests up to the first failure, and return what came."""
        path = self.folder / "src" / "riftberg" / change.path
        raw = path.read_bytes()
        forget(path)
        path.write_bytes(raw[: change.start] + change.new.encode() + raw[change.end :])
        line = path.read_text("utf-8").splitlines()[change.line - 1].strip()
        began = time.monotonic()
        # A test that compiles a changed kernel takes minutes: its end by a limit would be no notice of the change.
        limit = "600" if compiled and self.has_kernels(change) else "60"
        try:
            code, text = self.pytest(
                files, {"order": order, "options": ["-x", "--timeout", limit]}, compiled=compiled, seconds=seconds
            )
        finally:
            path.write_bytes(raw)
            forget(path)
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", text, flags=re.M)
        test = failed.group(1) if failed else "no end" if code == -1 else "" if code in (0, 5) else text[-200:]
        verdict = "unnoticed" if code in (0, 5) else "noticed"
        took = round(time.monotonic() - began, 1)
        return {
            **change._asdict(),
            "text": line,
            "verdict": verdict,
            "test": test,
            "compiled": compiled,
            "seconds": took,
        }


def key(change: Change) -> str:
    """Return the name of a change."""
    return f"{change.path}:{change.start}"


def forget(path: Path) -> None:
    """Remove the byte code of a module."""
    for file in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
        file.unlink()


def probed(text: str, places: list[tuple[int, int]]) -> str:
    """Return a module with a probe before the statement of each place that is given as (byte, number)."""
    lines = text.splitlines(keepends=True)
    offsets = [0]
    for line in lines:
        offsets.append(offsets[-1] + len(line.encode()))
    firsts: list[tuple[int, int, int]] = []  # first byte, end, line of the statements before which a line may be put
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt) and not getattr(node, "decorator_list", ()):
            before = lines[node.lineno - 1].encode()[: node.col_offset].decode()
            if not before.strip() and not lines[node.lineno - 1].lstrip().startswith("elif"):
                start, end = (
                    offsets[node.lineno - 1] + node.col_offset,
                    offsets[node.end_lineno - 1] + node.end_col_offset,
                )
                firsts.append((start, end, node.lineno))
    probes: dict[int, list[int]] = {}
    for place, number in places:
        _, _, line = max(f for f in firsts if f[0] <= place < f[1])
        probes.setdefault(line, []).append(number)
    for line, numbers in probes.items():
        old = lines[line - 1]
        space = old[: len(old) - len(old.lstrip())]
        lines[line - 1] = "".join(f"{space}__reached__({n})\n" for n in numbers) + old
    return "".join(lines)


# --- what pytest calls: this module is also its plug-in --------------------------------------------------------------------

ORDERS = "RIFTBERG_MUTATIONS"
orders: dict[str, Any] = json.loads(Path(os.environ[ORDERS]).read_text()) if ORDERS in os.environ else {}
reached: set[int] = set()
took: dict[str, float] = {}
if "keys" in orders:
    builtins.__reached__ = reached.add  # type: ignore[attr-defined]


def pytest_collection_modifyitems(items: list[Any]) -> None:
    """Take the tests in the order that was given, and no others; leave out those that are known."""
    if orders.get("order"):
        place = {test: i for i, test in enumerate(orders["order"])}
        items[:] = sorted((item for item in items if item.nodeid in place), key=lambda item: place[item.nodeid])
    known = set(orders.get("known", ()))
    items[:] = [item for item in items if item.nodeid not in known]


def pytest_runtest_logstart(nodeid: str) -> None:
    """Forget what an earlier test has reached; a test that ends pytest is known by its row without an end."""
    reached.clear()
    _note(nodeid, {"seconds": None, "reached": []})


def pytest_runtest_logreport(report: Any) -> None:
    """Note how long a test took, unless it failed or was skipped."""
    if report.when == "call" and report.passed:
        took[report.nodeid] = report.duration


def pytest_runtest_logfinish(nodeid: str) -> None:
    """Write how long a test took and what it has reached."""
    if "keys" in orders:
        _note(nodeid, {"seconds": took.get(nodeid), "reached": [orders["keys"][n] for n in sorted(reached)]})


def _note(nodeid: str, row: dict[str, Any]) -> None:
    if "to" in orders:
        with Path(orders["to"]).open("a") as file:
            file.write(json.dumps({"test": nodeid, **row}) + "\n")


# --- the loop over the changes -------------------------------------------------------------------------------------------------


def tests_for(change: Change, reach: dict[str, Any], budget: float) -> tuple[list[str], list[str]]:
    """Return the files and the tests for a change: those that reach it, the quickest first, then others of these files."""
    took = {test: s for test, s in reach["seconds"].items() if s < 10.0}
    direct = sorted((t for t in reach["reached"].get(key(change), ()) if t in took), key=took.__getitem__)
    module = "riftberg." + change.path.removesuffix(".py").replace("/", ".")
    files = {t.split("::")[0] for t in direct} or {
        f
        for f in {t.split("::")[0] for t in took}
        if module in (ROOT / f).read_text("utf-8") or Path(change.path).stem in f
    }
    files = files or {test.split("::")[0] for test in took}
    others = sorted((t for t in took if t.split("::")[0] in files and t not in set(direct)), key=took.__getitem__)
    order: list[str] = []
    for test in (*direct, *others):
        budget -= took[test]
        if budget < 0.0:
            break
        order.append(test)
    return sorted({t.split("::")[0] for t in order}), order


def report(path: Path) -> None:
    """Print shares by folder, and the changes that nobody noticed."""
    rows = [line.split(" | ") for line in SAME.read_text("utf-8").splitlines()]
    reasons = [(*name.partition(" "), kind, reason) for name, kind, reason in rows]

    def reason_of(r: dict[str, Any]) -> str:
        of = (
            why for name, _, code, kind, why in reasons if (name, kind) == (r["path"], r["kind"]) and code in r["text"]
        )
        return next(of, "")

    last = {(r["path"], r["start"]): r for r in map(json.loads, path.read_text().splitlines())}
    count: Counter[str] = Counter()
    for r in last.values():
        alike = r["verdict"] != "noticed" and bool(reason_of(r))
        for folder in (r["path"].split("/")[0], "all"):
            count[folder, "tried"] += 1
            count[folder, "same" if alike else r["verdict"]] += 1
    print("| folder | tried | noticed | same meaning | unnoticed | share noticed |\n|---|---:|---:|---:|---:|---:|")
    for folder in (*FOLDERS, "all"):
        tried, noticed, alike, unnoticed = (count[folder, what] for what in ("tried", "noticed", "same", "unnoticed"))
        print(
            f"| {folder} | {tried} | {noticed} | {alike} | {unnoticed} | {100.0 * noticed / max(tried - alike, 1):.0f} % |"
        )
    for r in sorted(last.values(), key=lambda r: (r["path"], r["line"])):
        if r["verdict"] != "noticed":
            reason = reason_of(r)
            print(f"  {r['path']}:{r['line']}  {r['kind']}:  {r['text']}{'   SAME: ' if reason else ''}{reason}")


def main() -> None:
    """Try changes, or print what came."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "results", type=Path, help="file of results, one line a change; what it holds is not tried again"
    )
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=24)
    parser.add_argument("--folders", default=",".join(FOLDERS), help="folders of the source, such as physics,life")
    parser.add_argument(
        "--budget", type=float, default=60.0, help="longest time for the tests of a change, unchanged [s]"
    )
    parser.add_argument("--again", action="store_true", help="try those that were not noticed once more")
    parser.add_argument("--tests", nargs="+", default=[], help="with --again: files of tests to run")
    parser.add_argument("--only", default="", help="with --again: changes whose path:line contains this")
    parser.add_argument("--compiled", action="store_true", help="with --again: run with compilation")
    parser.add_argument("--for", type=float, default=math.inf, dest="seconds", help="stop after so long [s]")
    parser.add_argument("--report", action="store_true")
    options = parser.parse_args()
    if options.report:
        report(options.results)
        return
    options.results.parent.mkdir(parents=True, exist_ok=True)
    tree = Tree(options.results)
    stop = time.monotonic() + options.seconds
    known = {}
    if options.results.exists():
        known = {f"{r['path']}:{r['start']}": r for r in map(json.loads, options.results.read_text().splitlines())}
    folders = options.folders.split(",")
    changes = sample(tree.pinned / "riftberg", folders, options.count, options.seed)
    for folder in folders:
        ours = [c for c in changes if c.path.startswith(folder + "/")]
        compiled = options.compiled if options.again else folder.partition("/")[0] not in PLAIN
        for change in ours:
            before = known.get(key(change))
            if options.again != bool(before) or (
                before and (before["verdict"] == "noticed" or options.only not in f"{change.path}:{change.line}")
            ):
                continue
            if options.again:
                files, order, seconds = options.tests or folder_of_tests(folder, compiled=compiled), [], 1200.0
            else:
                reach = tree.reach(folder, ours, compiled=compiled, seconds=stop - time.monotonic())
                if reach is None:
                    break
                files, order = tests_for(change, reach, options.budget)
                seconds = 120.0 + 10.0 * sum(reach["seconds"][test] for test in order)
            if files:
                left = stop - time.monotonic()
                result = tree.tried(change, files, order, compiled=compiled, seconds=min(seconds, max(left, 1.0)))
                if result["test"] == "no end" and left < seconds:
                    break
            else:
                nothing = {
                    "text": "",
                    "verdict": "unnoticed",
                    "test": "none reaches it",
                    "compiled": compiled,
                    "seconds": 0.0,
                }
                result = {**change._asdict(), **nothing}
            with options.results.open("a") as file:
                file.write(json.dumps(result) + "\n")
            print(
                f"{result['verdict']:>10}  {change.path}:{change.line}  {change.kind}  {result['test']}  {result['seconds']} s",
                flush=True,
            )
    shutil.rmtree(tree.folder)


if __name__ == "__main__":
    main()
