"""Make the figures of the documentation by running the package; called by ``build.py``."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path


def make_figures(folder: Path) -> Iterator[Path]:
    """Make all figures and give their paths as they are finished."""
    import matplotlib as mpl

    mpl.use("Agg")
    folder.mkdir(exist_ok=True)
    yield five_lines(folder / "five-lines.png")
    yield from story(folder)
    yield from scores(folder)


def five_lines(path: Path) -> Path:
    """Draw what the five lines of the README give."""
    from riftberg import Iceberg, Model, Steady, draw_map

    berg = Iceberg.rectangle(60e3, 20e3, thickness=200.0, placement=(-37.0, -56.0))
    model = Model(berg, Steady.balanced(current=(0.2, 0.05), latitude=-56.0, wind=(5.0, -2.0)))
    run = model.run(days=3)
    draw_map(run, path, forcing=model.forcing)
    return path


def story(folder: Path) -> Iterator[Path]:
    """Run the built-in experiment; draw its map, the stress in its bonds, the life of its fragments, and why it broke."""
    from riftberg.diagnostics.why import explain
    from riftberg.experiments import build
    from riftberg.viz.map import draw_map
    from riftberg.viz.plots import draw_stress, draw_timeline
    from riftberg.viz.why import draw_reasons

    model, info = build("a68a")
    with tempfile.TemporaryDirectory() as scratch:
        run = model.run(info.days, output=Path(scratch) / "run.nc", every_hours=info.output_every_hours)
        run.attrs["experiment"] = "A68a"
        draw_map(run, folder / "a68a-map.png", forcing=model.forcing, title=info.title, observed=info.observed)
        yield folder / "a68a-map.png"
        yield draw_stress(run, folder / "a68a-stress.png", dpi=100)
        yield draw_timeline(run, folder / "a68a-timeline.png", dpi=100)
        yield draw_reasons(explain(run), folder / "a68a-why.png", dpi=90)


def scores(folder: Path) -> Iterator[Path]:
    """Draw the scores of A68a against the daily outlines, where the observations are at hand; centroids only."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
    from scores import daily_outlines, run_experiment, shared_folder

    from riftberg.diagnostics.score import score_run
    from riftberg.viz.plots import heading
    from riftberg.viz.score import draw_score

    data = shared_folder()
    if data is None:
        print("no observations (RIFTBERG_SHARED): the figures of the scores stay as they are", file=sys.stderr)
        return
    for name in ("a68a", "a68a-oras5"):
        with tempfile.TemporaryDirectory() as scratch:
            run, _ = run_experiment(name, "own", data, Path(scratch) / "run.nc")
            with run:
                title = heading(run, "run against the daily outlines").replace("Iceberg", name)
                yield draw_score(
                    score_run(run, daily_outlines(data)), folder / f"score-{name}.png", title=title, dpi=110
                )
