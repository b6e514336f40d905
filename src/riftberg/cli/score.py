"""``riftberg score``: a run against observations."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from riftberg.cli.options import OutputBeside, results_folder, within
from riftberg.cli.pictures import Format, Run, check_picture_format, folder_beside
from riftberg.cli.terminal import console, reported, say, table
from riftberg.errors import InputError
from riftberg.system.input_files import value_shown

if TYPE_CHECKING:
    from rich.table import Table

    from riftberg.diagnostics.score import Match, Score


@reported
def score(
    run: Run,
    observed: Annotated[
        Path,
        typer.Argument(
            metavar="OBSERVED",
            help="Outlines (GeoJSON, KML, shapefile, CSV, masks in NetCDF) or tracks (BYU/NIC and other CSV).",
        ),
    ],
    output: OutputBeside = None,
    hour: Annotated[
        float | None,
        typer.Option(
            "--hour", min=0.0, max=24.0, help="Hour (UTC) for days without a time.  [default: that of the start]"
        ),
    ] = None,
    date: Annotated[
        str | None,
        typer.Option("--date", "-d", help="Date of outlines whose file gives none (KML, shapefile, NetCDF)."),
    ] = None,
    variable: Annotated[
        str | None, typer.Option("--variable", help="Name of the mask variable, in a NetCDF file that has several.")
    ] = None,
    between: Annotated[str | None, typer.Option("--between", metavar="FIRST,LAST", help="Dates to compare.")] = None,
    together: Annotated[
        str | None,
        typer.Option(
            "--together",
            metavar="N,N,...",
            help="Fragments that make up the berg, instead of matching them automatically.",
        ),
    ] = None,
    interpolated: Annotated[bool, typer.Option("--interpolated", help="Include interpolated positions.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw score.png.")] = True,
    picture: Format = "png",
) -> None:
    """Compare a run with observations, day by day: distance, heading, area, overlap, fragments."""
    import json

    from riftberg.diagnostics.observed import read_observed
    from riftberg.diagnostics.score import score_run
    from riftberg.runs.run_file import open_run
    from riftberg.viz.plots import figure_title

    within(hour, "--hour", 0.0, 24.0)
    check_picture_format(picture)
    names = ("score.json", f"score.{picture}") if figure else ("score.json",)
    with open_run(run) as dataset, results_folder(folder_beside(run, output), names, taken=names) as folder:
        seen = read_observed(observed, date=date, variable=variable)
        result = score_run(
            dataset, seen, hour=hour, between=_span(between), together=_numbers(together), interpolated=interpolated
        )
        title = figure_title(dataset, f"run against {observed.name}")
        if as_json:
            typer.echo(json.dumps(result.as_dict(), indent=1))
        else:
            _print_score(result)
        written = [result.write(folder / "score.json")]
        if figure:
            from riftberg.runs.background import stored_water
            from riftberg.viz.score import draw_score

            water = stored_water(dataset)
            written.append(draw_score(result, folder / f"score.{picture}", title=title, water=water))
    say("Written: " + ", ".join(str(path) for path in written))


def _span(text: str | None) -> tuple[datetime, datetime] | None:
    from riftberg.cli.options import dates

    span = dates(text, "--between")
    if span is None:
        return None
    first, last = (datetime.fromisoformat(part) for part in span)
    # A day alone is meant to its end.
    return first, last + timedelta(days=1, seconds=-1) if last.time() == last.min.time() else last


def _numbers(text: str | None) -> list[int]:
    try:
        return [int(part) for part in (text or "").split(",") if part.strip()]
    except ValueError as error:
        raise InputError(
            f"{value_shown(text)} are no numbers", where="--together", remedy="For example --together 1,6"
        ) from error


MOST_SHOWN = 500
"""Most times in a table."""


def table_of(result: Score) -> Table:
    """Return the table of a score."""
    from riftberg.config.units import minute_text

    days = table(
        f"Run against {result.observed}",
        ("time", "piece", "fragments", "distance km", "azimuth", "observed", "diff", "area km2", "observed", "IoU"),
        texts=("time", "piece", "fragments"),
    )
    for day in result.days[:MOST_SHOWN]:
        for k, match in enumerate(day.matches):
            days.add_row(
                minute_text(day.time) if k == 0 else "",
                *_match_cells(match),
                style="bold" if match is day.berg else "",
            )
    return days


def _match_cells(m: Match) -> list[str]:
    def text(value: float | None, form: str) -> str:
        return "" if value is None else format(value, form)

    return [
        m.observed, ", ".join(map(str, m.fragments)) or "none", text(m.distance_km, ".1f"), text(m.azimuth, ".0f"),
        text(m.azimuth_observed, ".0f"), text(m.azimuth_difference, "+.0f"), text(m.area_km2, ".0f"),
        text(m.area_observed_km2, ".0f"), text(m.iou, ".2f"),
    ]  # fmt: skip


def sentence(result: Score) -> str:
    """Return the summary in a sentence."""
    s = result.summary()
    if not s["days"]:
        return "The berg itself was not observed during the run."
    parts = [f"centroid {s['distance_km_rms']:.1f} km off (rms; at most {s['distance_km_max']:.1f} km)"]
    if s["azimuth_rms"] is not None:
        parts.append(f"long axis {s['azimuth_rms']:.0f} degrees off (rms)")
    if s["area_ratio_mean"] is not None:
        parts.append(f"area {s['area_ratio_mean']:.2f} of the observed one")
    if s["iou_mean"] is not None:
        parts.append(f"overlap {s['iou_mean']:.2f}")
    return f"{s['days']} time{'s' if s['days'] != 1 else ''}: " + ", ".join(parts) + "."


def _print_score(result: Score) -> None:
    out = console(120)
    out.print(table_of(result))
    if len(result.days) > MOST_SHOWN:
        out.print(f"and {len(result.days) - MOST_SHOWN} times more, see score.json")
    for line in (sentence(result), *result.melt):
        out.print(line, highlight=False)
