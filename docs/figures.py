"""Make the figures of the documentation by running the package; called by ``build.py``."""

from __future__ import annotations

import ast
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.patches import Rectangle

if TYPE_CHECKING:
    import xarray as xr

ROOT = Path(__file__).resolve().parents[1]

FLOOR_COLOURS = ("#F6E3C5", "#DCE9F5", "#DFF0E3", "#EFE3F3", "#F2F2F2")

LIFE = (
    ("Shape", "An outline, mask, table or rectangle is filled with a lattice on an equal-area plane.", "bergs/"),
    ("Birth", "Positions, size, thickness and density give the mass; an id names the element for good.", "bergs/, state/"),
    ("Bonds", "Neighbours within reach are bonded at their distance of that moment. Rifts weaken or drop some.", "bergs/"),
    ("Time step", "Currents, wind, waves, sea ice and sea floor at the element act on it.", "ocean/, engines/"),
    ("Stress", "Bonds are stretched, sheared and bent; bergs that touch press on each other.",
     "engines/quasi_static/lattice, contact"),
    ("Break-up", "A bond loaded beyond its strength breaks for good. Each fragment gets its own number.",
     "engines/quasi_static/fracture, fragments"),
    ("Melt", "Base and sides melt; small bergs roll over; edges calve.", "life/"),
    ("Removal", "A melted element leaves with its bonds. Its record ends; its id is never used again.", "life/, runs/"),
)  # fmt: skip
"""Title, text and packages of each stage in the life of an element."""


def make_figures(folder: Path, only: Sequence[str] = ()) -> Iterator[Path]:
    """Make all figures, or those of some names, and give their paths as they are finished.

    Each PNG holds, as its Description, the data that it shows: ``tests/test_figures.py`` compares them with today's code.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    folder.mkdir(exist_ok=True)
    for names, draw in DRAWN.items():
        if only and not set(only) & set(names):
            continue
        data = draw(*(folder / f"{name}.png" for name in names))
        for name in names if data is not None else ():
            stamp(folder / f"{name}.png", data)
            yield folder / f"{name}.png"


def stamp(path: Path, data: Any) -> None:
    """Write into a PNG the data that it shows."""
    from PIL import Image, PngImagePlugin

    about = PngImagePlugin.PngInfo()
    about.add_itxt("Description", json.dumps(data))
    with Image.open(path) as picture:
        picture.save(path, pnginfo=about, optimize=True)


def shown_in(path: Path) -> Any:
    """Return the data that a figure was drawn from; None for one that holds none."""
    from PIL import Image

    with Image.open(path) as picture:
        picture.load()
        text = picture.info.get("Description")
    return None if text is None else json.loads(text)


def told_by(run: xr.Dataset) -> dict[str, Any]:
    """Return what the pictures of a run show, as numbers that a reader could take from them."""
    from riftberg.runs.scene import Scene

    scene = Scene(run)
    tracks = {scene.name(number): scene.track(number) for number in scene.numbers}
    return {
        "pieces_km2": {scene.name(number): round(scene.final_area(number) / 1e6) for number in scene.numbers},
        "births": {
            scene.name(number): str(birth[0])[:16] for number in scene.numbers if (birth := scene.birth(number)) is not None
        },
        "ends": {name: [round(float(x[-1]), 1), round(float(y[-1]), 1)] for name, (x, y, _) in tracks.items()},
    }


def coarse_oceans(path: Path) -> Any:
    """Draw the tracks and distances of the example of that name."""
    sys.path.append(str(ROOT / "docs" / "examples"))
    import coarse_oceans as example

    example.draw(path)
    return example.table()


def house(path: Path) -> list[tuple[str, str]]:
    """Draw the packages, one above the other as the contract in ``pyproject.toml`` has them, with what they are for."""
    from textwrap import fill

    from riftberg.viz.style import new_figure

    levels = packages()
    figure = new_figure(10.5, 0.5 * len(levels) + 0.4, 100)
    ax = figure.add_subplot()
    for k, (names, purpose) in enumerate(levels):
        y, colour = len(levels) - k, FLOOR_COLOURS[k * len(FLOOR_COLOURS) // len(levels)]
        ax.add_patch(Rectangle((0.0, y - 0.93), 10.0, 0.86, fc=colour, ec="#444444", lw=0.8))
        ax.text(0.12, y - 0.5, names, va="center", fontsize=11, fontweight="bold")
        ax.text(2.9, y - 0.5, fill(purpose, 88), va="center", fontsize=8.5)
    ax.annotate("", (10.35, 0.1), (10.35, len(levels) - 0.1), arrowprops={"arrowstyle": "-|>", "lw": 2.0})
    ax.text(10.5, 0.5 * len(levels), "imports run down, never up", rotation=270, va="center", fontsize=10)
    ax.set_xlim(-0.05, 10.85)
    ax.set_ylim(-0.05, len(levels) + 0.05)
    ax.set_axis_off()
    figure.savefig(path)
    return levels


def packages() -> list[tuple[str, str]]:
    """Return packages and modules from top to bottom, those of one level together, each level with its purpose."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    from house import floors

    package = ROOT / "src" / "riftberg"
    return [
        (", ".join(sorted(rooms)), subject(package / min(rooms)) if len(rooms) == 1 else "What all others may import.")
        for rooms in floors(ROOT / "pyproject.toml")
    ]


def subject(place: Path) -> str:
    """Return the first line of the docstring of a package or module."""
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n")[0].replace("`", "")


def life(path: Path) -> Any:
    """Draw the life of an element: stages as boxes, in the order in which a run passes them."""
    from textwrap import fill

    from riftberg.viz.style import new_figure

    figure = new_figure(10.5, 4.2, 100)
    ax = figure.add_subplot()
    for k, (title, text, room) in enumerate(LIFE):
        x, y = 2.6 * (k % 4), 2.0 * (1 - k // 4)
        ax.add_patch(Rectangle((x, y), 2.2, 1.6, fc="#F2F2F2", ec="#444444", lw=0.8))
        ax.text(x + 0.1, y + 1.4, title, fontsize=11, fontweight="bold", va="center")
        ax.text(x + 0.1, y + 1.16, fill(text, 32), fontsize=8, va="top")
        ax.text(x + 0.1, y + 0.1, fill(room, 30), fontsize=7, va="bottom", color="#333333", family="monospace")
        if k % 4 < 3 and k + 1 < len(LIFE):
            ax.annotate("", (x + 2.58, y + 0.8), (x + 2.22, y + 0.8), arrowprops={"arrowstyle": "-|>", "lw": 1.6})
    # From the end of the first row back to the start of the second, through the gap between them.
    ax.plot([8.9, 8.9, 1.1], [2.0, 1.8, 1.8], color="black", lw=1.6)
    ax.annotate("", (1.1, 1.62), (1.1, 1.82), arrowprops={"arrowstyle": "-|>", "lw": 1.6})
    ax.set_xlim(-0.05, 10.1)
    ax.set_ylim(-0.05, 3.65)
    ax.set_axis_off()
    figure.savefig(path)
    return LIFE


def keel_and_floor(path: Path) -> dict[str, float]:
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
    ax.set_facecolor("#BFD9EC")
    ax.text(4.5, draft + 1.2, "sea water", fontsize=9, ha="center", color="#1F4E79")
    ax.fill_between(x / 1e3, draft - 2.0, draft - lift, color="#EEF2F5", lw=0, label="ice, 250 m thick")
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
        xlim=(0.0, 6.0), ylim=(draft + 2.0, draft - 1.2), xlabel="distance from the front of the berg (km)",
        ylabel="depth (m)",
    )
    ax.legend(fontsize=8, loc="upper right", frameon=True)
    figure.savefig(path)
    return {"draft": round(draft, 1), "bending_length": round(length)}


def five_lines(path: Path) -> dict[str, Any]:
    """Draw what the five lines of the README give."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    lines = text.partition("## Five lines of Python")[2].partition("```python\n")[2].partition("```")[0]
    names: dict[str, Any] = {}
    exec(lines.replace('"berg.png"', repr(str(path))), names)
    return told_by(names["run"])


def own_files(path: Path) -> dict[str, Any]:
    """Draw what the experiment file of the README gives, with the outline and the ocean that the tutorial makes."""
    import contextlib
    import re

    from riftberg import build, draw_map

    tutorial = (ROOT / "docs" / "tutorials" / "from-outline-to-break-up.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", tutorial, flags=re.MULTILINE | re.DOTALL)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
        for name in ('"berg.geojson", "w"', '"ocean.nc"'):
            exec(next(block for block in blocks if name in block), {})
        Path("berg.yaml").write_text(readme.partition("```yaml\n")[2].partition("```")[0], "utf-8")
        model, info = build("berg.yaml")
        run = model.run(info.days, every_hours=1.0)
        draw_map(run, path, forcing=model.forcing, title=info.title or info.name, dpi=100)
    return told_by(run)


def story(on_a_map: Path, stress: Path, timeline: Path, why: Path) -> dict[str, Any]:
    """Run the built-in experiment; draw its map, the stress in its bonds, the life of its fragments, and why it broke."""
    from riftberg import build, draw_fragments, draw_map, draw_reasons, draw_stress, explain

    model, info = build("a68a")
    with tempfile.TemporaryDirectory() as scratch:
        run = model.run(info.days, output=Path(scratch) / "run.nc", every_hours=info.output_every_hours)
        run.attrs["heading"] = info.title
        draw_map(run, on_a_map, forcing=model.forcing, title=info.title, observed=info.observed)
        draw_stress(run, stress, dpi=100)
        draw_fragments(run, timeline, dpi=100)
        draw_reasons(explain(run), why, dpi=90)
        return told_by(run)


def score(path: Path) -> dict[str, int] | None:
    """Draw the score of A68a against the daily outlines, where the observations are at hand; centroids only."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
    from scores import daily_outlines, run_experiment, shared_folder

    from riftberg import draw_score, score_run
    from riftberg.runs.background import stored_water
    from riftberg.viz.plots import figure_title

    data = shared_folder()
    if data is None:
        print("no observations (RIFTBERG_SHARED): the figure of the score stays as it is", file=sys.stderr)
        return None
    with tempfile.TemporaryDirectory() as scratch:
        run, _ = run_experiment("a68a", "own", data, Path(scratch) / "run.nc")
        with run:
            run.attrs["heading"] = "A68a in the fitted ocean"
            result = score_run(run, daily_outlines(data))
            title = figure_title(run, "run against the daily outlines")
            draw_score(result, path, title=title, water=stored_water(run), dpi=110)
    return {day.time[:10]: round(day.berg.distance_km) for day in result.days if day.berg is not None}


DRAWN: dict[tuple[str, ...], Callable[..., Any]] = {
    ("house",): house,
    ("life-of-an-element",): life,
    ("keel-and-floor",): keel_and_floor,
    ("five-lines",): five_lines,
    ("own-files",): own_files,
    ("coarse-oceans",): coarse_oceans,
    ("a68a-map", "a68a-stress", "a68a-timeline", "a68a-why"): story,
    ("score-a68a",): score,
}
"""Names of the figures that are drawn together, and what draws them."""
