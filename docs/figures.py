"""Make the figures of the documentation by running the package; called by ``build.py``."""

from __future__ import annotations

import ast
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from matplotlib.patches import Rectangle

ROOT = Path(__file__).resolve().parents[1]

FLOOR_COLOURS = ("#F6E3C5", "#DCE9F5", "#DFF0E3", "#EFE3F3", "#F2F2F2")

LIFE = (
    ("Shape", "An outline, mask, table or rectangle is filled with a lattice on an equal-area plane.",
     "bergs/lattice, placement"),
    ("Birth", "Positions, size, thickness and density give mass and radius; an id names the element for good.",
     "bergs/bonding, state"),
    ("Bonds", "Neighbours within reach are bonded; the length at that moment is the rest length. Rifts weaken or drop some.",
     "bergs/bonding, strength"),
    ("Long step", "The element finds its cell, takes what surrounds it, and the media push it: water, air, ice, waves, floor.",
     "ocean, stepping/forces, explicit/substeps"),
    ("Sub-steps", "Bonds pull, shear and bend, neighbours press, often enough to follow the lattice's ringing.",
     "stepping/explicit, quasi_static, physics"),
    ("Break", "A bond beyond its strength fails, for good. Parts that hang together no more get a number of their own.",
     "stepping/fracture, breaking, fragments"),
    ("Record", "Recorders keep what the element is, under its id; a restart file holds all that the next step needs.",
     "runs/run_file, restart, track"),
    ("Death", "Removed from the population, it takes its bonds with it; its record ends, its id is never used again.",
     "state, stepping, runs"),
)  # fmt: skip
"""Title, text and rooms of each station in the life of an element."""


def make_figures(folder: Path) -> Iterator[Path]:
    """Make all figures and give their paths as they are finished."""
    import matplotlib as mpl

    mpl.use("Agg")
    folder.mkdir(exist_ok=True)
    yield house(folder / "house.png")
    yield life(folder / "life-of-an-element.png")
    yield five_lines(folder / "five-lines.png")
    yield own_files(folder / "own-files.png")
    yield keel_and_floor(folder / "keel-and-floor.png")
    yield coarse_oceans(folder / "coarse-oceans.png")
    yield from story(folder)
    yield from scores(folder)


def coarse_oceans(path: Path) -> Path:
    """Draw the tracks and distances of the example of that name."""
    sys.path.append(str(ROOT / "docs" / "examples"))
    from coarse_oceans import draw

    return draw(path)


def house(path: Path) -> Path:
    """Draw the rooms on their floors, as the contract in ``pyproject.toml`` has them, with what stands in their docstrings."""
    from textwrap import fill

    from riftberg.viz.style import new_figure

    sys.path.insert(0, str(ROOT / "benchmarks"))
    from house import floors

    package = ROOT / "src" / "riftberg"
    levels = floors(ROOT / "pyproject.toml")
    figure = new_figure(10.5, 0.62 * len(levels) + 0.5, 100)
    ax = figure.add_subplot()
    for k, rooms in enumerate(levels):
        y, colour = len(levels) - k, FLOOR_COLOURS[k * len(FLOOR_COLOURS) // len(levels)]
        ax.add_patch(Rectangle((0.0, y - 0.92), 10.0, 0.84, fc=colour, ec="#444444", lw=0.8))
        several = len(rooms) > 1
        names = fill(", ".join(sorted(rooms)), 30) if several else next(iter(rooms))
        text = "what every room may read" if several else subject(package / names)
        lines = sum(count_lines(package / name) for name in rooms)
        ax.text(0.12, y - 0.5, names, va="center", fontsize=8 if several else 12, fontweight="bold")
        ax.text(2.75, y - 0.5, fill(text, 92), va="center", fontsize=8.5)
        ax.text(
            9.88, y - 0.5, f"{max(100, round(lines, -2)):,} lines", va="center", ha="right", fontsize=8, color="#444444"
        )
    ax.annotate("", (10.35, 0.1), (10.35, len(levels) - 0.1), arrowprops={"arrowstyle": "-|>", "lw": 2.0})
    ax.text(10.5, 0.5 * len(levels), "imports run down, never up", rotation=270, va="center", fontsize=10)
    ax.set_xlim(-0.05, 10.85)
    ax.set_ylim(-0.05, len(levels) + 0.05)
    ax.set_axis_off()
    figure.savefig(path)
    return path


def subject(place: Path) -> str:
    """Return the first line of the docstring of a room."""
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n")[0]


def count_lines(place: Path) -> int:
    """Return the lines of a room."""
    paths = place.rglob("*.py") if place.is_dir() else [place.with_suffix(".py")]
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def life(path: Path) -> Path:
    """Draw the life of an element: stations as boxes, in the order in which a run passes them."""
    from textwrap import fill

    from riftberg.viz.style import new_figure

    figure = new_figure(10.5, 4.6, 100)
    ax = figure.add_subplot()
    for k, (title, text, room) in enumerate(LIFE):
        x, y = 2.6 * (k % 4), 2.4 * (1 - k // 4)
        ax.add_patch(Rectangle((x, y), 2.2, 1.9, fc=FLOOR_COLOURS[k % len(FLOOR_COLOURS)], ec="#444444", lw=0.8))
        ax.text(x + 0.1, y + 1.68, title, fontsize=11, fontweight="bold", va="center")
        ax.text(x + 0.1, y + 1.42, fill(text, 34), fontsize=8, va="top")
        ax.text(x + 0.1, y + 0.12, fill(room, 38), fontsize=7, va="bottom", color="#333333", family="monospace")
        if k % 4 < 3 and k + 1 < len(LIFE):
            ax.annotate("", (x + 2.58, y + 0.95), (x + 2.22, y + 0.95), arrowprops={"arrowstyle": "-|>", "lw": 1.6})
    # From the end of the first row back to the start of the second, through the gap between them.
    ax.plot([8.9, 8.9, 1.1], [2.4, 2.15, 2.15], color="black", lw=1.6)
    ax.annotate("", (1.1, 1.92), (1.1, 2.17), arrowprops={"arrowstyle": "-|>", "lw": 1.6})
    ax.set_xlim(-0.05, 10.1)
    ax.set_ylim(-0.1, 4.4)
    ax.set_axis_off()
    figure.savefig(path)
    return path


def keel_and_floor(path: Path) -> Path:
    """Draw a section of a berg of 250 m that has slid up a slope of 1 in 1000: keel afloat, keel aground, floor."""
    import numpy as np

    from riftberg.physics.floating import draft_of
    from riftberg.physics.seabed import bending_length
    from riftberg.viz.style import new_figure

    draft, length, slope, slid = draft_of(250.0, 850.0), bending_length(9e9, 0.3, 250.0), 1e-3, 310.0
    x = np.linspace(0.0, 6e3, 600)  # m from the front of the berg, which faces left
    floor = draft - slope * (slid - x)
    # The front of a plate on water under a line of load (Hetenyi), lifted there to the floor.
    lift = slope * slid * np.exp(-x / length) * np.cos(x / length)
    figure = new_figure(8.0, 3.4, 110)
    ax = figure.add_subplot()
    ax.fill_between(x / 1e3, floor, draft + 6.0, color="#C8A96A", lw=0, label="sea floor, slope 1 in 1000")
    ax.fill_between(x / 1e3, draft - 2.0, draft - lift, color="#DCE9F5", lw=0, label="ice")
    ax.plot(x / 1e3, np.full(x.size, draft), "--", color="#444444", lw=1.2, label="keel of the berg afloat")
    ax.plot(x / 1e3, draft - lift, color="#1F4E79", lw=2.0, label="keel as the floor lifts and bends it")
    ax.annotate(
        "",
        (0.06, draft - slope * slid),
        (0.06, draft),
        arrowprops={"arrowstyle": "<->", "color": "black", "shrinkA": 0, "shrinkB": 0},
    )
    ax.text(0.12, draft - 0.75, "overlap: the bed presses back", fontsize=8, va="center")
    ax.annotate("", (length / 1e3, draft + 1.2), (0.0, draft + 1.2), arrowprops={"arrowstyle": "<->"})
    ax.text(0.08, draft + 1.3, f"ice bends over {length / 1e3:.1f} km", va="top", fontsize=8)
    ax.set(
        xlim=(0.0, 6.0), ylim=(draft + 2.0, draft - 1.2), xlabel="from the front of the berg (km)", ylabel="depth (m)"
    )
    ax.legend(fontsize=8, loc="upper right", frameon=True)
    figure.savefig(path)
    return path


def five_lines(path: Path) -> Path:
    """Draw what the five lines of the README give."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = text.partition("## Five lines of Python")[2].partition("```python\n")[2].partition("```")[0]
    exec(lines.replace('"berg.png"', repr(str(path))), {})
    return path


def own_files(path: Path) -> Path:
    """Draw what the experiment file of the README gives, with the outline and the ocean that the tutorial makes."""
    import contextlib
    import re

    from riftberg.experiments import build
    from riftberg.viz.map import draw_map

    tutorial = (ROOT / "docs" / "tutorials" / "from-outline-to-break-up.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", tutorial, flags=re.MULTILINE | re.DOTALL)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        for name in ('"berg.geojson", "w"', '"ocean.nc"'):
            exec(next(block for block in blocks if name in block), {})
        Path("berg.yaml").write_text(readme.partition("```yaml\n")[2].partition("```")[0], "utf-8")
        model, info = build("berg.yaml")
        draw_map(model.run(info.days, every_hours=1.0), path, forcing=model.forcing, title=info.title, dpi=100)
    return path


def story(folder: Path) -> Iterator[Path]:
    """Run the built-in experiment; draw its map, the stress in its bonds, the life of its fragments, and why it broke."""
    from riftberg.diagnostics.why import explain
    from riftberg.experiments import build
    from riftberg.viz.map import draw_map
    from riftberg.viz.plots import draw_fragments, draw_stress
    from riftberg.viz.score import draw_reasons

    model, info = build("a68a")
    with tempfile.TemporaryDirectory() as scratch:
        run = model.run(info.days, output=Path(scratch) / "run.nc", every_hours=info.output_every_hours)
        run.attrs["experiment"] = "A68a"
        draw_map(run, folder / "a68a-map.png", forcing=model.forcing, title=info.title, observed=info.observed)
        yield folder / "a68a-map.png"
        yield draw_stress(run, folder / "a68a-stress.png", dpi=100)
        yield draw_fragments(run, folder / "a68a-timeline.png", dpi=100)
        yield draw_reasons(explain(run), folder / "a68a-why.png", dpi=90)


def scores(folder: Path) -> Iterator[Path]:
    """Draw the scores of A68a against the daily outlines, where the observations are at hand; centroids only."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
    from scores import daily_outlines, run_experiment, shared_folder

    from riftberg.diagnostics.score import score_run
    from riftberg.runs.scene import stored_water
    from riftberg.viz.plots import figure_title
    from riftberg.viz.score import draw_score

    data = shared_folder()
    if data is None:
        print("no observations (RIFTBERG_SHARED): the figures of the scores stay as they are", file=sys.stderr)
        return
    for name in ("a68a", "a68a-oras5"):
        with tempfile.TemporaryDirectory() as scratch:
            run, _ = run_experiment(name, "own", data, Path(scratch) / "run.nc")
            with run:
                title = figure_title(run, "run against the daily outlines").replace("Iceberg", name)
                score = score_run(run, daily_outlines(data))
                yield draw_score(score, folder / f"score-{name}.png", title=title, water=stored_water(run), dpi=110)
