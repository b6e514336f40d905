"""Figures of the house: lines by kind and folder, arguments, circles, imports that run upwards, names with two meanings.

    python benchmarks/house.py                 # of src/riftberg
    python benchmarks/house.py --list FOLDER   # of another copy of the package, with every finding
    python benchmarks/house.py --write         # bring the tables of the docs up to date: lines, fields of types

Nothing is imported: the files are read as text. Imports count wherever they stand (inside functions and under
``TYPE_CHECKING`` too).
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import tokenize
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

PACKAGE = "riftberg"

MANY = 10
"""Arguments beyond which a function has many."""

PRIVATE_WORDS = (
    "Standing", "depart", "arrive", "motion_at", "close_alone", "Touching", "Acting", "acted", "BodyRoom", "MeetingRoom",
    "SlowRoom", "miss", "sought", "seat", "Blow", "blow", "heaviest", "struck", "caught_up", "led", "way_back", "Forgetful",
    "recall", "alive", "meet", "met", "memory", "surround", "Meetings", "meeting", "meetings",
)  # fmt: skip
"""Words of earlier versions for what numerical mechanics and contact dynamics have names for."""

DOCS = Path(__file__).resolve().parents[1] / "docs"

PAGES = (DOCS / "explanation" / "architecture.md", DOCS / "reference" / "code.md")
"""Pages with tables that are made here."""


CENTRAL_TYPES = (
    ("state/variables.py", "Elements"),
    ("state/variables.py", "Bonds"),
    ("engines/common/run_state.py", "RunState"),
    ("engines/quasi_static/bodies/pose.py", "Bodies"),
    ("engines/quasi_static/rigid_step.py", "BodyState"),
)
"""Types that the page shows with their fields."""

FOLDER_ROW = r"^\| `([^`]+/)` \| [\d,]+ \| [\d,]+ \|"
FILE_ROW = r"^\| (\d+) \| `([^`]+)` \| \d+ \|"
"""Rows of the tables of folders and of files."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def floors(project: Path) -> list[set[str]]:
    """Return the rooms of each floor from the roof to the ground, as in the contract in ``pyproject.toml``."""
    contracts = tomllib.loads(project.read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["id"] == "floors")
    return [set(layer.replace(":", " ").replace("|", " ").split()) for layer in layers]


def modules(folder: Path) -> dict[str, ast.Module]:
    """Return the modules of a package by dotted name."""
    trees = {}
    for path in sorted(folder.rglob("*.py")):
        parts = [folder.name, *path.relative_to(folder).with_suffix("").parts]
        trees[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = ast.parse(path.read_text(encoding="utf-8"))
    return trees


def imports(trees: dict[str, ast.Module]) -> dict[str, set[str]]:
    """Return which modules of the package each module imports."""
    edges: dict[str, set[str]] = {name: set() for name in trees}
    for name, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                edges[name] |= {alias.name for alias in node.names if alias.name in trees}
            elif isinstance(node, ast.ImportFrom) and node.module in trees:
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                edges[name] |= (inner & set(trees)) or {node.module}
    return edges


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import each other, by way of others too."""
    reach = {name: _reached(edges, name) for name in edges}
    groups = {tuple(sorted(b for b in reach[a] if a in reach[b])) for a in edges if a in reach[a]}
    return [list(group) for group in sorted(groups)]


def _reached(edges: dict[str, set[str]], start: str) -> set[str]:
    seen: set[str] = set()
    front = [start]
    while front:
        for name in edges[front.pop()] - seen:
            seen.add(name)
            front.append(name)
    return seen


def room(module: str) -> str:
    """Return the room of a module; the package itself is ``riftberg``."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else parts[0]


def upward(edges: dict[str, set[str]], rooms: list[set[str]]) -> list[tuple[str, str]]:
    """Return the imports of a module on a floor above."""
    floor = {name: -level for level, names in enumerate(rooms) for name in names}
    pairs = ((a, b) for a in sorted(edges) for b in sorted(edges[a]))
    return [(a, b) for a, b in pairs if room(a) in floor and room(b) in floor and floor[room(b)] > floor[room(a)]]


def functions(trees: dict[str, ast.Module]) -> Iterator[tuple[str, Function, ast.AST]]:
    """Give every function with the module and the node that it stands in."""
    for name, tree in trees.items():
        for outer in ast.walk(tree):
            for node in ast.iter_child_nodes(outer):
                if isinstance(node, Function):
                    yield name, node, outer


def lines_by_kind(text: str) -> Counter[str]:
    """Return the number of lines of a module that are code, docstring, comment, import or blank."""
    lines = text.splitlines()
    kind = ["code" if line.strip() else "blank" for line in lines]
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT and not token.line[: token.start[1]].strip():
            kind[token.start[0] - 1] = "comment"
    for node in ast.walk(ast.parse(text)):
        said = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        if said or isinstance(node, ast.Import | ast.ImportFrom):
            for n in range(node.lineno - 1, node.end_lineno or node.lineno):
                kind[n] = "docstring" if said else "import"
    return Counter(kind)


def names_used(text: str) -> Counter[str]:
    """Return how often each name of the program stands in a module (no comments, no texts)."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return Counter(token.string for token in tokens if token.type == tokenize.NAME)


def decorated(node: Function, *names_sought: str) -> bool:
    """Return whether a function has one of these decorators: of kernels, or of commands, whose options are arguments."""
    names = {
        getattr(getattr(d, "func", d), "id", getattr(getattr(d, "func", d), "attr", "")) for d in node.decorator_list
    }
    return bool(names & set(names_sought))


def arguments(node: Function) -> int:
    """Return the number of arguments but ``self`` and ``cls``."""
    every = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return sum(name not in ("self", "cls") for name in every)


def with_many_arguments(trees: dict[str, ast.Module], *, kernels: bool = False) -> list[str]:
    """Return the functions of more than `MANY` arguments; commands apart, kernels too unless they are asked for."""
    apart = ("report_errors",) if kernels else ("kernel", "borrower", "stage", "njit", "report_errors")
    return [
        f"{name}.{node.name}: {arguments(node)}"
        for name, node, _ in functions(trees)
        if arguments(node) > MANY and not decorated(node, *apart)
    ]


def without_reason(folder: Path) -> list[str]:
    """Return the kernels of more than `MANY` arguments above which no comment says why."""
    found = []
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        lines = text.splitlines()
        # Most modules have no kernel: those need not be parsed.
        trees = {path.stem: ast.parse(text)} if re.search(r"^@(kernel|borrower|stage)", text, re.MULTILINE) else {}
        for name, node, _ in functions(trees):
            if arguments(node) > MANY and decorated(node, "kernel", "borrower", "stage"):
                first = min(d.lineno for d in node.decorator_list)
                if not lines[first - 2].startswith("#"):
                    found.append(f"{name}.{node.name}")
    return found


EMPTY_WORDS = frozenset({
    "said", "told", "asked", "own", "noted", "held", "given", "taken", "there", "near", "away", "found", "now",
    "before", "whole", "theirs", "made", "shown", "kept", "wanted", "one", "both", "some", "several", "this", "that",
    "what", "named", "known", "begun", "done", "meant", "called", "place", "places", "way", "ways", "part", "parts",
    "apart", "together", "around", "still",
})  # fmt: skip
"""Names that say nothing of what a value is."""

PREPOSITIONS = frozenset({"of", "as", "from", "with", "in", "at", "to", "by", "on", "for", "into", "over", "under"})


def empty_names(trees: dict[str, ast.Module]) -> tuple[Counter[str], int]:
    """Return how often names are bound that are one of `EMPTY_WORDS`, and how often any name is."""
    nodes = [node for tree in trees.values() for node in ast.walk(tree)]
    bound = [n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
    bound += [n.arg for n in nodes if isinstance(n, ast.arg)]
    return Counter(name for name in bound if name in EMPTY_WORDS), len(bound)


def named_by_preposition(trees: dict[str, ast.Module]) -> list[str]:
    """Return the functions whose name ends in a preposition, or has one after a noun (``field_of_x``); constructors apart."""
    found = []
    for name, node, _ in functions(trees):
        words = node.name.strip("_").split("_")
        if len(words) > 1 and (words[-1] in PREPOSITIONS or words[1] in ("of", "at")):
            found.append(f"{name}.{node.name}")
    return found


def twice_named(trees: dict[str, ast.Module]) -> dict[str, list[str]]:
    """Return the names of classes and of functions of modules that are defined in more than one module."""
    homes: dict[str, list[str]] = defaultdict(list)
    for name, tree in trees.items():
        for node in tree.body:
            if isinstance(node, Function | ast.ClassDef):
                homes[node.name].append(name)
    return {name: places for name, places in sorted(homes.items()) if len(set(places)) > 1}


LAWS = ("errors", "physics", "state", "constants")
"""Rooms whose names tests may hold: laws have twins there."""


def inner_names(tests: Path) -> set[str]:
    """Return the names of the package that tests take from inside its rooms, laws apart, and not from the package itself."""
    held: set[str] = set()
    for path in tests.rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        aliases: dict[str, str] = {}
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{PACKAGE}."):
                aliases |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
            elif isinstance(node, ast.Import):
                aliases |= {a.asname: a.name for a in node.names if a.asname and a.name.startswith(f"{PACKAGE}.")}
        held |= set(aliases.values())
        # Of modules, the names that are taken from them.
        held |= {
            f"{aliases[node.value.id]}.{node.attr}"
            for node in nodes
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id.islower()
            and aliases.get(node.value.id, "....").count(".") <= 3
        }  # fmt: skip
    return {name for name in held if room(name) not in LAWS}


def folder_sizes(folder: Path) -> dict[str, tuple[int, int]]:
    """Return files and lines of each folder, without those of the folders inside it."""
    sizes: dict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for path in sorted(folder.rglob("*.py")):
        name = f"{path.parent.relative_to(folder).as_posix()}/"
        files, lines = sizes[name]
        sizes[name] = files + 1, lines + len(path.read_text(encoding="utf-8").splitlines())
    return dict(sizes)


def replaced(page: str, name: str, change: Callable[[str], str]) -> str:
    """Return a page with a marked passage changed; as it is where it has none of that name."""
    start, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    if start not in page:
        return page
    before, _, rest = page.partition(start)
    inside, _, after = rest.partition(end)
    return before + start + change(inside) + end + after


def with_sizes(page: str, folder: Path) -> str:
    """Return the page with the present numbers of files and lines, and the present fields of the central types."""
    sizes = folder_sizes(folder)

    def folder_row(match: re.Match[str]) -> str:
        files, lines = sizes[match[1]]
        return f"| `{match[1]}` | {files} | {lines:,} |"

    def file_row(match: re.Match[str]) -> str:
        lines = len((folder / match[2]).read_text(encoding="utf-8").splitlines())
        return f"| {match[1]} | `{match[2]}` | {lines} |"

    page = replaced(page, "folders", lambda table: re.sub(FOLDER_ROW, folder_row, table, flags=re.MULTILINE))
    page = replaced(page, "path", lambda table: re.sub(FILE_ROW, file_row, table, flags=re.MULTILINE))
    return replaced(page, "types", lambda _: f"\n\n{types_table(folder)}\n\n")


def types_table(folder: Path) -> str:
    """Return a table of the central types: what each is by its docstring, and its fields."""
    rows = ["| type | what it is | fields |", "|---|---|---|"]
    for file, name in CENTRAL_TYPES:
        tree = ast.parse((folder / file).read_text(encoding="utf-8"))
        node = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == name)
        said = (ast.get_docstring(node) or "").split("\n")[0].rstrip(".")
        fields = [n.target.id for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)]
        rows.append(f"| `{name}` (`{file}`) | {said[0].lower()}{said[1:]} | {', '.join(f'`{f}`' for f in fields)} |")
    return "\n".join(rows)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    home = Path(__file__).resolve().parents[1] / "src" / PACKAGE
    parser.add_argument("folder", nargs="?", type=Path, default=home, help="folder of the package")
    parser.add_argument("--list", action="store_true", help="print every finding")
    parser.add_argument("--write", action="store_true", help="update the tables of the docs")
    options = parser.parse_args()
    if options.write:
        for page in PAGES:
            page.write_text(with_sizes(page.read_text(encoding="utf-8"), home), encoding="utf-8")
        return
    trees = modules(options.folder)
    edges = imports(trees)
    texts = [path.read_text(encoding="utf-8") for path in sorted(options.folder.rglob("*.py"))]
    kinds = sum((lines_by_kind(text) for text in texts), Counter())
    used = sum((names_used(text) for text in texts), Counter())
    private = [f"{word}: {used[word]}" for word in PRIVATE_WORDS if used[word]]
    names = twice_named(trees)
    lists = {
        "circles of imports": [" <-> ".join(group) for group in circles(edges)],
        "imports that run upwards": [
            f"{a} -> {b}" for a, b in upward(edges, floors(home.parents[1] / "pyproject.toml"))
        ],
        f"functions of more than {MANY} arguments": with_many_arguments(trees, kernels=True),
        "the same, kernels apart": with_many_arguments(trees),
        "names with more than one home": [f"{name}: {', '.join(homes)}" for name, homes in names.items()],
        # A command has the name of the function that it calls.
        "of these public, commands apart": [
            f"{name}: {', '.join(homes)}"
            for name, homes in names.items()
            if not name.startswith("_") and sum(not home.startswith(f"{PACKAGE}.cli.") for home in homes) > 1
        ],
        "private words in use": private,
        "inner names held by tests": sorted(inner_names(home.parents[1] / "tests")),
    }
    print(f"{'modules':>40}  {len(trees)}")
    print(f"{'functions':>40}  {sum(1 for _ in functions(trees))}")
    print(f"{'lines':>40}  {sum(kinds.values())}")
    for name in ("code", "docstring", "comment", "import", "blank"):
        print(f"{name:>40}  {kinds[name]}")
    for title, entries in lists.items():
        print(f"{title:>40}  {len(entries)}")
        for entry in entries if options.list else ():
            print(f"      {entry}")


if __name__ == "__main__":
    main()
