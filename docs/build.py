"""Build what the documentation takes from the code: the reference pages, and the figures.

    python docs/build.py            reference pages, then figures (about two minutes)
    python docs/build.py --pages    reference pages only (a second)
    python docs/build.py --figures NAME ...    these figures only, such as house five-lines
    python docs/build.py --site     the whole site in build/site, with the gallery run and the replay of A68a (some minutes)
    python docs/build.py --site --quick     the same without running the gallery, and with a replay of a few hours
    python docs/build.py --check    exit with 1 if a reference page is out of date; write nothing
    python docs/build.py --trust F  put the tables of a test run into docs/evidence/validation.md; F holds the output of
                                    pytest -v -m "" tests/parity tests/verification

Everything under ``docs/reference`` is written by this script: change the code, not the page.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, get_args

from typer.models import ArgumentInfo

DOCS = Path(__file__).resolve().parent
NOTE = "<!-- Written by docs/build.py from {source}; change that, then run the script. -->\n\n"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table; bars and line ends in cells are made harmless."""
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in rows:
        lines.append("| " + " | ".join(" ".join(str(cell).replace("|", "\\|").split()) for cell in row) + " |")
    return "\n".join(lines) + "\n"


def code(value: Any) -> str:
    """Return a value as code, or nothing for an empty text."""
    return "" if value == "" else f"`{value}`"


def value_text(value: Any) -> str:
    """Return a default value as it is written in an experiment file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.6g}"
    return "none" if value is None else str(value)


def limits(field: Any) -> str:
    """Return the limits that pydantic checks."""
    signs = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))
    found = [
        f"{sign} {getattr(item, name):g}" for item in field.metadata for name, sign in signs if hasattr(item, name)
    ]
    return " and ".join(found)


def extra(field: Any, name: str) -> str:
    """Return one of the things noted beside a field."""
    return str((field.json_schema_extra or {}).get(name, ""))


def parameters_page() -> str:
    """Return the page of all parameters, with the values of the presets where they differ from the default."""
    from riftberg.config.values import field_extra, words_for_nothing
    from riftberg import A68A_2022, A68A_2022_KID, Parameters
    from riftberg.parameters import GROUPS, group_classes

    engines = {
        "`quasi_static`": Parameters(), "`mts`, `verlet` and `runge_kutta`": Parameters(stepping={"scheme": "mts"}),
    }  # fmt: skip
    text = [
        "# Parameters\n",
        "Set one with `riftberg run EXPERIMENT --set group.name=value`, in a YAML file under `parameters:`, or in Python with",
        '`A68A_2022.changed(group={"name": value})`. Values may carry units: `--set fracture.normal_strength="20 kPa"`.',
        "Impossible values and unknown names are refused. A value outside its usual range is reported by `run` and `doctor`,",
        "and in Python by `model.notices`; the run continues.\n",
        "`A68A_2022` is the physics of the published A68a run (Huth et al. 2022, table S1) with Riftberg's numerics;",
        "`A68A_2022_KID` adds the numerics and quirks of the reference. The columns show their values where they differ from",
        "the default. What differs between the engines has a table for each; `stepping.scheme` chooses the engine. The A68a experiments and `preset: a68a-2022` take them; `Model(berg, ocean)` and YAML files without a",
        "preset take the defaults, `Parameters()`, which hold for bergs of any size. Sources are sections of [the equations](../explanation/equations.md)",
        "and of those of [melt, calving and files](../explanation/equations-of-life.md), or names in KID's namelist;",
        "Q numbers stand in",
        "[differences from the reference](../explanation/differences-from-the-reference.md).\n",
    ]
    for group in GROUPS:
        text.append(f"## {group}\n")
        for kind in group_classes(group):
            has = [name for name, p in engines.items() if isinstance(getattr(p, group, None), kind)]
            whose = f" With {has[0]}." if len(has) == 1 else ""
            text.append((kind.__doc__ or "").split("\n\n")[0] + whose + "\n")
            rows = []
            for name, field in kind.model_fields.items():
                usual = field_extra(field, "usual")
                span = f"{usual.low:g} to {usual.high:g}" if usual else ""
                plain = field.get_default()
                sets = (p for p in (A68A_2022, A68A_2022_KID) if isinstance(getattr(p, group, None), kind))
                differ = {type(p): getattr(getattr(p, group), name) for p in sets}
                physics, kid = (differ.get(type(p), plain) for p in (A68A_2022, A68A_2022_KID))
                kid = kid if type(A68A_2022_KID) in differ else physics
                meaning = (field.description or "") + (" (`riftberg kid` alone)" if field_extra(field, "hidden") else "")
                rows.append(
                    (
                        # Nothing by a word that is no choice of its own.
                        code(name), words_for_nothing(field)[0] if plain is None else value_text(plain),
                        extra(field, "unit"), limits(field), span, meaning,
                        value_text(physics) if physics != plain else "", value_text(kid) if kid != physics else "",
                        extra(field, "source"),
                    )
                )  # fmt: skip
            heads = ("name", "default", "unit", "limits", "usual", "meaning", "A68A_2022", "A68A_2022_KID", "source")
            text.append(table(heads, rows))
    return "\n".join(text)


def experiment_page() -> str:
    """Return the page of the keys of an experiment file."""
    from riftberg.bergs.keys import FieldOfBergs
    from riftberg.config.values import section_fields
    from riftberg.experiments.schema import PRESETS, LatticeRows, Mask, OutlineFile, Rectangle, Rift, Shelf, Strength
    from riftberg.experiments.yaml_file import sections
    from riftberg.ocean.formulas import FORMULAS

    text = [
        "# Experiment files\n",
        "Keys of a YAML experiment; see the [how-to](../howto/own-experiment-yaml.md) for a whole one. Quantities may carry",
        "units (`thickness: 200 m`, `time_step: 30 min`); plain numbers are in the unit named here. Unknown keys are refused",
        "with the line where they stand, and all errors are reported at once. Where a list of sections stands, one section",
        "may stand alone; for a section that has a `file`, the name of the file (`outline: berg.geojson`).\n",
    ]
    shapes = (
        ("berg.outline", OutlineFile),
        ("berg.mask", Mask),
        ("berg.shelf", Shelf),
        ("berg.rectangle", Rectangle),
        ("berg.lattice", LatticeRows),
        ("berg.rifts, each", Rift),
        ("berg.strength", Strength),
        ("berg.field", FieldOfBergs),
        *((f"forcing.{name}, kind: formula", part) for name, part in FORMULAS.items()),
    )
    for name, fields in (*sections(), *((name, section_fields(kind)) for name, kind in shapes)):
        text.append(f"## {name or 'top level'}\n")
        rows = []
        for key, field in fields.items():
            if extra(field, "hidden"):  # of formulas: what a file takes from its parameters
                continue
            needed = field.is_required()
            rows.append((code(field.alias or key), "needed" if needed else _default(field), extra(field, "unit"), limits(field),
                         field.description or "a section of its own"))  # fmt: skip
        text.append(table(("key", "default", "unit", "limits", "meaning"), rows))
    text.append(
        f"`parameters` takes the groups of [the parameters](parameters.md) and `preset`: {', '.join(map(code, PRESETS))}.\n"
    )
    return "\n".join(text)


def _default(field: Any) -> str:
    value = field.get_default()
    return value_text(list(value) if isinstance(value, tuple) else value).replace("[]", "none").replace("{}", "none")


def variables_page() -> str:
    """Return the page of the state variables and of the run file."""
    from riftberg.runs import tracks
    from riftberg.runs.layout import (
        BOND_HISTORY,
        BOND_LATEST,
        FRAGMENT_VARIABLES,
        GROUNDING_VARIABLES,
        SHAPE,
        in_file,
    )
    from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES

    def rows(variables: Any) -> list[tuple[str, ...]]:
        written = {v.name for v in variables if v.output} | {*SHAPE, *BOND_LATEST}
        return [
            (
                code(v.name), v.units, v.long_name, code(v.standard_name),
                code(in_file(v.name)) if v.name in written else "", "yes" if v.restart else "",
            )
            for v in variables
        ]  # fmt: skip

    heads = ("name", "units", "meaning", "CF standard name", "in the run file", "in restarts")
    fragments = [(code(f"fragment_{v.name}"), v.units, v.long_name) for v in FRAGMENT_VARIABLES]
    stays = [(code(f"grounding_{v.name}"), v.units, v.long_name) for v in GROUNDING_VARIABLES]
    return "\n".join(
        [
            "# Variables\n",
            "One registry (`riftberg.state`) gives names, units and meaning to the state, run files, restarts and this page.\n",
            "## Run file\n",
            "`run.nc` is one CF-1.11 NetCDF-4 file that opens with `xarray.open_dataset` as it is, and with TrajAn and",
            "clouddrift. Variables of an element are tables `(trajectory, time)`; "
            f"{', '.join(code(in_file(name)) for name in SHAPE)} are written once. Bonds have the dimension `bond`:",
            f"{', '.join(map(code, BOND_HISTORY))} are `(bond, time)` (so is `damage`, in runs with",
            "[damage](../explanation/damage.md)), the others hold the latest state. There `peak_stress` is the largest",
            "`normal_stress` of any sub-step since the record before, not of the last long step alone. Positions and",
            "`rotation` are kept in double precision, the rest in single precision.\n",
            "## Elements\n",
            table(heads, rows(ELEMENT_VARIABLES)),
            "## Bonds\n",
            table(heads, rows(BOND_VARIABLES)),
            "## Fragments\n",
            "Family tree of the fragments, in the run file along `fragment`; `fragment_number` is the value of `berg`.\n",
            table(("name", "units", "meaning"), fragments),
            "## Stays on the sea floor\n",
            "One row for each stay of a berg, or of a fragment of 5 % of its berg or more, along `grounding`.\n",
            table(("name", "units", "meaning"), stays),
            "## Tracks\n",
            "The group `tracks`: bergs and fragments over time, as CF contiguous ragged arrays",
            "([results by berg](../howto/results-by-berg.md)). The first ones lie along `trajectory`, the others along `index`.\n",
            table(
                ("name", "units", "meaning"),
                [(code(v.name), v.units, v.long_name) for v in (*tracks.TRACK_COORDINATES, *tracks.TRACK_VARIABLES)],
            ),
        ]
    )


def namelist_page() -> str:
    """Return the page of KID's namelist entries."""
    from riftberg.kid.entries import DRIVER, ICEBERGS

    words = {
        "honoured": "acts as in KID",
        "refused": "the run is refused unless it has the value named",
        "reported": "without effect here; the reason is printed at the end of the run if a file sets it",
    }
    text = [
        "# Entries of KID's namelists\n",
        "What `riftberg kid CASE_DIR` does with each entry of `input.nml`; see the [how-to](../howto/kid-directories.md).",
        "Names ignore the case. An entry that KID does not know is an error that offers the nearest name.\n",
        table(("treatment", "meaning"), words.items()),
    ]
    for name, group in (("icebergs_nml", ICEBERGS), ("icebergs_driver_nml", DRIVER)):
        counts = {kind: sum(e.treatment == kind for e in group) for kind in words}
        told = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
        text += [f"## {name}\n", f"{len(group)} entries: {told}.\n"]
        rows = []
        for e in group:
            treatment = e.treatment + (f" (only {value_text(e.accepted)})" if e.treatment == "refused" else "")
            rows.append((code(e.name), e.kind, _entry_default(e.default), e.unit, e.meaning, treatment, e.note))
        text.append(table(("entry", "type", "default", "unit", "meaning in KID", "here", "how, or why not"), rows))
    return "\n".join(text)


def _entry_default(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{v:g}" for v in value)
    if isinstance(value, float) and value > 1e300:
        return "never"
    return value_text(value)


def summary_page() -> str:
    """Return the page of the keys of summary.json, from the docstring of its module."""
    from riftberg.diagnostics import summary

    return "\n".join(
        [
            "# Keys of `summary.json`\n",
            "Every `riftberg run` writes one; `riftberg.diagnostics.summary.summarize` makes the same dictionary in Python.\n",
            table(("key", "meaning"), _keys(summary.__doc__ or "")),
        ]
    )


def _keys(doc: str) -> list[tuple[str, str]]:
    """Read ``name : meaning`` lines; indented lines go on with the one before."""
    rows: list[tuple[str, str]] = []
    for line in doc.split("----\n", 1)[1].splitlines():
        if line.startswith(" ") and rows:
            rows[-1] = (rows[-1][0], f"{rows[-1][1]} {line.strip()}")
        elif " : " in line:
            names, _, meaning = line.partition(" : ")
            rows.append((", ".join(code(name) for name in names.split(", ")), meaning))
    return rows


def commands_page() -> str:
    """Return the page of the command line, from the signatures of its functions."""
    from riftberg.cli.main import SUMMARIES, app, load_command
    from riftberg.cli.options import verbose
    from riftberg.experiments import EXPERIMENTS

    text = [
        "# Commands\n",
        f"{app.info.help}\n",
        "Exit codes: 0 done; 1 `doctor` found something lacking; 2 an error, with one message; 130 interrupted.\n",
    ]
    for name, summary in SUMMARIES.items():
        text += [f"## riftberg {name}\n", f"{summary}\n"]
        given = inspect.signature(verbose(load_command(name)), eval_str=True).parameters.values()
        rows = [_argument(p) for p in given if get_args(p.annotation)]  # the context of a command is no option
        if rows:
            text.append(table(("argument or option", "default", "meaning"), rows))
    experiments = [(code(e.name), e.summary, ", ".join(map(code, e.parts))) for e in EXPERIMENTS]
    text += ["## Built-in experiments\n", table(("name", "shows", "`--without`"), experiments)]
    return "\n".join(text)


def _argument(p: inspect.Parameter) -> tuple[str, str, str]:
    """Return name, default and meaning of an argument or option of a command."""
    kind, info = get_args(p.annotation)[:2]
    meaning, _, told = (info.help or "").partition("[default: ")
    default = told.rstrip("] ") or ("" if p.default in (p.empty, None) else value_text(p.default))
    if isinstance(info, ArgumentInfo):
        name = info.metavar or p.name.upper()
        return code(name), "needed" if p.default is p.empty else default, meaning
    flag = bool in (kind, *get_args(kind))
    plain = "--" + p.name.strip("_").replace("_", "-")
    # In Annotated the first name stands where the default would.
    given = [*([info.default] if isinstance(info.default, str) else []), *(info.param_decls or ())]
    names = ", ".join(given or ([f"{plain}/--no-{plain[2:]}"] if flag else [plain]))
    takes = "" if flag else f" {info.metavar or _type_name(kind)}"
    return code(names + takes), "" if flag and default == "false" else default, meaning


def _type_name(kind: Any) -> str:
    plain = next(k for k in (*get_args(kind), kind) if k is not type(None))
    plain = next(iter(get_args(plain)), plain)
    return {"float": "NUMBER", "int": "N", "str": "TEXT", "Path": "PATH"}.get(plain.__name__, plain.__name__.upper())


def products_page() -> str:
    """Return the page of the data products and the canonical quantities."""
    from riftberg.ocean.needs import NEEDS
    from riftberg.products.quantities import QUANTITIES
    from riftberg.products.registry import PRODUCTS

    needs = [
        (need.quantity, ", ".join(map(code, need.fields)), need.needed, f"{need.default:g}", need.without) for need in NEEDS
    ]
    products = [
        (code(p.name), p.title, ", ".join(map(code, dict.fromkeys(p.gives))), p.checked(), "; ".join((*p.cautions, *p.notes)))
        for p in PRODUCTS
    ]
    quantities = [(code(q.name), q.units, q.long_name, q.sign, code(q.standard_name)) for q in QUANTITIES.values()]
    cite = [(code(p.name), p.citation) for p in PRODUCTS if p.citation]
    return "\n".join(
        [
            "# Data products\n",
            "Riftberg recognises these files by what is in them; a file belongs to the first product that matches. `riftberg",
            "doctor FILES` says what a file is. How to use them: [forcing from products](../howto/forcing-from-products.md).\n",
            table(("name (`--product`)", "product", "gives", "reader checked against", "to know"), products),
            "## What a run needs\n",
            "Files should give current, wind and sea level, with a value wherever a berg starts. Without a quantity elements",
            "have the value by default, and a notice, or the refusal of a run, says what follows.\n",
            table(("quantity", "fields", "needed", "by default", "without it"), needs),
            "## Canonical quantities\n",
            "Every product becomes an `xarray.Dataset` with these names, units and signs.\n",
            table(("name", "units", "meaning", "positive means", "CF standard name"), quantities),
            "## How to cite them\n",
            table(("name", "citation"), cite),
        ]
    )


PAGES: dict[str, tuple[Callable[[], str], str]] = {
    "parameters.md": (parameters_page, "src/riftberg/config/parameter_groups.py"),
    "experiment-file.md": (experiment_page, "src/riftberg/experiments/schema.py"),
    "variables.md": (variables_page, "src/riftberg/state/variables.py and runs/layout.py"),
    "namelist.md": (namelist_page, "src/riftberg/kid/entries.py"),
    "summary.md": (summary_page, "src/riftberg/diagnostics/summary.py and speed.py"),
    "commands.md": (commands_page, "src/riftberg/cli and experiments"),
    "products.md": (products_page, "src/riftberg/products and ocean/needs.py"),
}


def page(name: str) -> str:
    """Return a reference page as it should be."""
    make, source = PAGES[name]
    return NOTE.format(source=source) + make().rstrip() + "\n"


def outdated() -> list[str]:
    """Return the names of the reference pages that are not as the code says."""
    folder = DOCS / "reference"
    return [name for name in PAGES if not (folder / name).exists() or (folder / name).read_text("utf-8") != page(name)]


def take_tables(report: str) -> None:
    """Put the parity and the theory table of a test report into the page of evidence."""
    path = DOCS / "evidence" / "validation.md"
    text = path.read_text("utf-8")
    for name, title in (("parity", "parity with the reference"), ("theory", "theory and model")):
        found = re.search(rf"^=+ {title} =+\n(.*?)(?=^=+ )", report, flags=re.MULTILINE | re.DOTALL)
        if found is None:
            sys.exit(f"no table called '{title}' in the report: run pytest with -v")
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, _, rest = text.partition(begin)
        lines = [line.rstrip() for line in found[1].strip("\n").splitlines()]
        block = "\n".join(lines)
        text = f"{before}{begin}\n\n```text\n{block}\n```\n\n{end}{rest.partition(end)[2]}"
    path.write_text(text, "utf-8")


def write_replay_page(path: Path, days: float | None) -> None:
    """Write the replay of the built-in A68a that the first page of the site plays."""
    import tempfile

    from riftberg import Options, build
    from riftberg.runs.run_file import RunWriter, open_run
    from riftberg.viz.replay import write_replay

    model, info = build("a68a", Options(days=days))
    with tempfile.TemporaryDirectory() as folder:
        writer = RunWriter(Path(folder) / "run.nc", every_hours=2.0, experiment="a68a")
        model.advance(days or info.days, recorders=[writer])
        with open_run(folder) as run:
            write_replay(run, path, title=info.title)


def write_notebook_pages(folder: Path, *, run: bool) -> None:
    """Write each notebook as a page, with what its cells print and draw where they are run."""
    import base64

    import nbformat

    folder.mkdir(exist_ok=True)
    for path in sorted((DOCS / "notebooks").glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        if run:
            from nbclient import NotebookClient

            NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}}).execute()
        parts = []
        for cell in notebook.cells:
            parts.append(cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```")
            for output in cell.get("outputs", []):
                data = output.get("data", {})
                if "image/png" in data:
                    picture = folder / f"{path.stem}-{len(parts)}.png"
                    picture.write_bytes(base64.b64decode(data["image/png"]))
                    parts.append(f"![What the cell draws]({picture.name})")
                elif text := output.get("text") or data.get("text/plain"):
                    parts.append(f"```text\n{text.rstrip()}\n```")
        parts.append(f"[Download this notebook](../notebooks/{path.name})")
        (folder / f"{path.stem}.md").write_text("\n\n".join(parts) + "\n", "utf-8")


REDIRECT = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=docs/index.html"><title>Riftberg</title>'
"""First page of the site's folder: leads to that of the documentation."""


def build_site(made: Path, *, quick: bool) -> int:
    """Build the site strictly: a warning, or a link that leads nowhere, is an error.

    Parameters
    ----------
    made : Path
        Folder for the site and what is made on the way.
    quick : bool
        Do not run the examples of the gallery.
    """
    import os
    import shutil

    from sphinx.cmd.build import build_main

    extra = made / "site-extra"
    extra.mkdir(parents=True, exist_ok=True)
    (extra / "index.html").write_text(REDIRECT, "utf-8")
    replay = extra / "replay.html"
    if not quick or not replay.exists():
        write_replay_page(replay, 0.1 if quick else None)
    for name in ("made-gallery", "made-notebooks"):
        shutil.rmtree(DOCS / name, ignore_errors=True)
    write_notebook_pages(DOCS / "made-notebooks", run=not quick)
    os.environ["RIFTBERG_SITE_EXTRA"] = str(extra)
    os.environ["RIFTBERG_GALLERY"] = "0" if quick else "1"
    places = ["-c", str(DOCS / "site"), "-d", str(made / "site-doctrees")]
    arguments = ["-W", "--keep-going", "-q", "-E", "-b", "html", *places]
    done = int(build_main([*arguments, str(DOCS.parent), str(made / "site")]))
    # The theme keeps a template of its own among its static files, and Sphinx copies it: it is no page of the site.
    (made / "site" / "_static" / "webpack-macros.html").unlink(missing_ok=True)
    return done


def main() -> int:
    """Write the pages and the figures, or check the pages."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--check", action="store_true", help="name the pages that are out of date and write nothing")
    parser.add_argument("--pages", action="store_true", help="write the pages only, no figures")
    parser.add_argument("--figures", nargs="+", metavar="NAME", default=[], help="make these figures only")
    parser.add_argument("--trust", type=Path, help="file with the output of the parity and verification tests")
    parser.add_argument("--site", action="store_true", help="build the site in build/site")
    parser.add_argument("--quick", action="store_true", help="with --site: do not run the gallery")
    parser.add_argument("--into", type=Path, default=DOCS.parent / "build", help="with --site: folder for it")
    options = parser.parse_args()
    if options.site:
        return build_site(options.into, quick=options.quick)
    if options.trust:
        take_tables(options.trust.read_text("utf-8"))
        return 0
    stale = outdated()
    if options.check:
        for name in stale:
            print(f"docs/reference/{name} is out of date: run python docs/build.py --pages", file=sys.stderr)
        return 1 if stale else 0
    for name in stale:
        (DOCS / "reference" / name).write_text(page(name), "utf-8")
        print(f"docs/reference/{name}")
    if not options.pages:
        sys.path.insert(0, str(DOCS))
        from figures import make_figures

        for path in make_figures(DOCS / "figures", options.figures):
            print(path.relative_to(DOCS.parent))
    return 0


if __name__ == "__main__":
    sys.exit(main())
