"""``riftberg plot``, ``animate`` and ``replay``: figures of a run, a film, one web page; and helpers of commands that draw."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from riftberg.cli.options import (
    OutputBeside,
    Quiet,
    check_output,
    check_positive,
    check_range,
    load_observed,
    report_errors,
    results_folder,
    tell,
)
from riftberg.errors import InputError
from riftberg.system.atomic_files import only_writer
from riftberg.system.input_files import is_folder, refuse_large

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from riftberg.diagnostics.observed import Observations
    from riftberg.viz.panels import Projection
    from riftberg.viz.replay import ForecastMembers


Run = Annotated[Path, typer.Argument(metavar="RUN.nc", help="Run file, or the folder that 'riftberg run' made.")]
ObservedFile = Annotated[
    Path | None,
    typer.Option(
        "--observed",
        help="Observed outlines: GeoJSON, KML, shapefile, mask in NetCDF, or CSV with date, vertex, lat, lon.",
    ),
]
Dates = Annotated[
    list[str] | None,
    typer.Option(
        "--date",
        "-d",
        help="A date to show, for example 2020-12-17T13:00; may be repeated. A day alone means the time of its observed outline, "
        "else the hour of the start, as in score.",
    ),
]

MapProjection = Annotated[
    str,
    typer.Option(
        "--projection",
        metavar="NAME",
        help="polar (stereographic), degrees, or auto: polar beyond 60 degrees of latitude.",
    ),
]

FORMATS = ("png", "pdf", "svg")

Format = Annotated[
    str, typer.Option("--format", "-f", metavar="FORMAT", help="png, pdf or svg; text in pdf and svg remains editable.")
]


def check_picture_format(name: str) -> None:
    """Refuse a format of pictures that is not offered."""
    if name not in FORMATS:
        raise InputError(f"{name!r} is not known", where="--format", remedy=f"Use {', '.join(FORMATS)}")


def folder_beside(run: Path, wished: Path | None) -> Path:
    """Return the folder where results go: the one asked for, else the folder of the run."""
    return wished if wished is not None else run if is_folder(run) else run.parent


@contextmanager
def picture_path(run: Path, wished: Path | None, name: str, *, observed: Path | None = None) -> Iterator[Path]:
    """Give where a picture goes: where it was asked for, else beside the run; refused where it cannot be written."""
    path = wished if wished is not None else folder_beside(run, None) / name
    check_output(path, inputs=[run, run / "run.nc", observed])
    path.parent.mkdir(parents=True, exist_ok=True)
    with only_writer(path):
        yield path


def observations_or_none(path: Path | None) -> Observations:
    """Return observed outlines, none where no file was named."""
    from riftberg.diagnostics.observed import Observations

    if path is None:
        return Observations("")
    observations = load_observed(path)
    if not observations.outlines:
        raise InputError(
            "no outlines, only positions", where=f"--observed {path}", remedy="Use them with riftberg score"
        )
    return observations


def outlines(path: Path | None) -> dict[str, list[Any]]:
    """Return observed outlines by day, empty where no file was named."""
    return observations_or_none(path).rings_by_day()


def moments(dates: list[str] | None, run: xr.Dataset, observed: Observations) -> list[np.datetime64]:
    """Return dates from the command line.

    A day alone means the time of its observed outline; where that has none, the hour of the start of the run, as in
    ``riftberg score``.
    """
    import numpy as np

    from riftberg.config.values import parse_date

    start = run["time"].values[0]
    hour = start - start.astype("datetime64[D]")
    days = []
    for text in dates or ():
        when, day_only = parse_date(text, where="--date")
        timed = sorted(o.when for o in observed.outlines if not o.day_only and o.when.date() == when.date())
        moment = np.datetime64((timed[0] if day_only and timed else when).isoformat())
        days.append(moment + hour if day_only and not timed else moment)
    return days


KINDS = ("map", "dates", "stress", "timeline", "damage", "melt")


@report_errors
def plot(
    run: Run,
    output: OutputBeside = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(
            "--kind", "-k",
            help=f"{', '.join(KINDS)}.  [default: dates, stress, timeline, damage, melt where they are on]",
        ),
    ] = None,
    date: Dates = None,
    observed: ObservedFile = None,
    picture: Format = "png",
    projection: MapProjection = "auto",
    dpi: Annotated[int, typer.Option("--dpi", min=30, max=1200, help="Resolution.")] = 150,
) -> None:  # fmt: skip
    """Draw maps at chosen dates with observed outlines, stress and damage of the bonds, and the history of the fragments."""
    from riftberg.runs.run_file import open_run

    for name in kind or ():
        if name not in KINDS:
            raise InputError(f"{name!r} is not known", where="--kind", remedy=f"Use {', '.join(KINDS)}")
    check_picture_format(picture)
    observations = observations_or_none(observed)
    with open_run(run) as dataset:
        kinds = kind or usual_kinds(dataset)
        files = [f"{name}.{picture}" for name in dict.fromkeys(kinds)]
        when = moments(date, dataset, observations)
        rings = observations.rings_by_day()
        with results_folder(folder_beside(run, output), files, locked=files) as folder:
            for name in kinds:
                tell(
                    _draw_kind(
                        name, dataset, folder / f"{name}.{picture}", when, rings, find_projection(projection), dpi
                    )
                )


def find_projection(name: str) -> Projection:
    """Return a projection by its name."""
    from riftberg.viz.panels import PROJECTIONS

    for projection in PROJECTIONS:
        if name == projection:
            return projection
    raise InputError(f"{name!r} is not known", where="--projection", remedy=f"Use {', '.join(PROJECTIONS)}")


def usual_kinds(run: xr.Dataset) -> list[str]:
    """Return the kinds of figures that a run has something for."""
    bonds = ["stress"] if run.sizes["bond"] else []
    melts = "melt_water" in run and float(run["melt_water"].isel(time=-1).sum()) > 0.0
    return ["dates", *bonds, "timeline", *(["damage"] if "damage" in run else []), *(["melt"] if melts else [])]


def _draw_kind(
    name: str, run: xr.Dataset, path: Path, when: list[np.datetime64], rings: dict[str, list[Any]],
    projection: Projection, dpi: int,
) -> Path:  # fmt: skip
    """Draw one figure."""
    from riftberg.viz import map as maps
    from riftberg.viz import plots

    if name == "map":
        return maps.draw_map(run, path, observed=rings, projection=projection, dpi=dpi)
    if name == "timeline":
        return plots.draw_fragments(run, path, dpi=dpi)
    if name == "dates":
        return plots.draw_dates(run, path, dates=when, observed=rings, projection=projection, dpi=dpi)
    if name == "melt":
        return plots.draw_melt(run, path, date=when[-1] if when else None, projection=projection, dpi=dpi)
    draw = plots.draw_stress if name == "stress" else plots.draw_damage
    return draw(run, path, dates=when, projection=projection, dpi=dpi)


@report_errors
def animate(
    run: Run,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="MP4 or GIF.  [default: film.mp4 beside the run, film.gif without ffmpeg]"),
    ] = None,
    hours: Annotated[
        float | None, typer.Option("--hours", help="Hours between frames.  [default: a film of 20 s]")
    ] = None,
    fps: Annotated[
        int | None, typer.Option("--fps", min=1, max=60, help="Frames per second.  [default: 20, GIF 10]")
    ] = None,
    dpi: Annotated[
        int | None, typer.Option("--dpi", min=30, max=400, help="Resolution.  [default: 110, GIF 80]")
    ] = None,
    observed: ObservedFile = None,
    projection: MapProjection = "auto",
    quiet: Quiet = False,
) -> None:
    """Write a film of a run."""
    from riftberg.runs.run_file import open_run
    from riftberg.viz.animate import default_ending

    check_positive(hours, "--hours", "hours", most=1e6)
    rings = outlines(observed)
    with (
        open_run(run) as dataset,
        picture_path(run, output, "film" + default_ending(), observed=observed) as goal,
    ):
        check_frames(dataset["time"].values, hours)
        path = _film_run(dataset, goal, hours, fps, dpi, rings, find_projection(projection), quiet)
    tell(path)


MOST_FRAMES = 20_000
"""Frames of a film: a quarter of an hour at 20 a second."""


def check_frames(times: Any, hours: float | None) -> None:
    """Refuse a film of more frames than anybody will look at."""
    if hours is not None:
        length = float((times[-1] - times[0]).astype("timedelta64[s]").astype(float)) / 3600.0
        refuse_large(
            length / hours, MOST_FRAMES, "frames", where="--hours", remedy="Give more hours between frames",
            kind=InputError,
        )  # fmt: skip


def _film_run(
    dataset: Any, goal: Path, hours: float | None, fps: int | None, dpi: int | None, rings: Any,
    projection: Projection, quiet: bool,
) -> Path:  # fmt: skip
    from rich.console import Console
    from rich.progress import Progress

    from riftberg.viz.animate import write_film

    with Progress(console=Console(stderr=True), disable=quiet) as bar:
        task = bar.add_task("frames", total=None)
        return write_film(
            dataset, goal, hours=hours, fps=fps, dpi=dpi, observed=rings, projection=projection,
            progress=lambda finished, total: bar.update(task, completed=finished, total=total),
        )  # fmt: skip


@report_errors
def replay(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN.nc", help="Run file, or the folder that 'riftberg run' or 'riftberg forecast' made."
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Page.  [default: replay.html beside the run]")
    ] = None,
    title: Annotated[str, typer.Option("--title", help="Heading.")] = "",
    observed: ObservedFile = None,
    largest: Annotated[
        float, typer.Option("--largest", min=0.5, help="Size in MB above which records are thinned out.")
    ] = 10.0,
    show: Annotated[bool, typer.Option("--show", help="Open the page in the browser.")] = False,
) -> None:
    """Write one web page that plays the run offline, with scrubbing and zoom; of a forecast with all its members."""
    from riftberg.runs.run_file import open_run
    from riftberg.viz.replay import write_replay

    check_range(largest, "--largest", 0.5, 1000.0)
    if output is not None and output.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{output.name[:60]!r} is no name of a web page", where="--output", remedy="Name it PAGE.html")
    rings = outlines(observed)
    run, members = _split_forecast(run)
    with (
        open_run(run) as dataset,
        picture_path(run, output, "replay.html", observed=observed) as goal,
    ):
        path = write_replay(dataset, goal, title=title, observed=rings, largest=largest * 1e6, members=members)
    tell(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")
    if show:
        typer.launch(str(path))


def _split_forecast(run: Path) -> tuple[Path, ForecastMembers | None]:
    """Return the run to play, and the members around it where a forecast was named."""
    file = run / "forecast.nc" if is_folder(run) and not (run / "run.nc").exists() else run
    if file.name != "forecast.nc" or not file.exists():
        return run, None
    from riftberg.ensembles.member import CONTROL_RUN
    from riftberg.ensembles.probability import scenarios, told
    from riftberg.ensembles.result import open_sweep
    from riftberg.viz.replay import ForecastMembers

    control = file.with_name(CONTROL_RUN)
    if not control.exists():
        raise InputError(
            f"holds no {CONTROL_RUN}, the run of the control", where=str(file.parent), remedy="Make the forecast again"
        )
    result = open_sweep(file)
    if "presence" not in result:
        raise InputError(
            "no forecast in degrees with members that are done",
            where=str(file),
            remedy="Name a run, or another forecast",
        )
    rows = [(s.number, s.probability, s.told().partition(": ")[2]) for s in scenarios(result)]
    first, *chances = told(result)[:3]
    words = f"{first} {', '.join(line.strip() for line in chances)}"
    return control, ForecastMembers(result, rows, words)
