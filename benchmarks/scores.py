"""A68a against observations: place, heading, area, overlap and pieces by day, and the berg made from the observed mask.

python benchmarks/scores.py             print the tables
python benchmarks/scores.py --write     also put them into docs/evidence/scores.md

Needs the data of the A68a publication and the tables made from it: a folder named in RIFTBERG_SHARED, or ../shared.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import xarray as xr

from riftberg import Observations, Outline, read_observed, score_run
from riftberg.bergs.iceberg import Iceberg
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.diagnostics.outlines import aligned_overlap, intersection_over_union
from riftberg.diagnostics.score import Match, Score, ScoredDay
from riftberg.diagnostics.summary import breakups
from riftberg.experiments import Options, build
from riftberg.experiments.a68a import A68A_OBSERVED, PARTIAL
from riftberg.ocean.grid import haversine
from riftberg.plane import AzimuthalPlane
from riftberg.runs.run_file import open_run
from riftberg.state import Floats

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "evidence" / "scores.md"
BEGIN, END = "<!-- scores: begin -->", "<!-- scores: end -->"
MASK = "a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc"
REFERENCE_LATITUDE, SHIFT = -55.2, (0.0, -0.1)
"""How the publication placed its berg: latitude that scales longitudes, and the shift of the mask (degrees)."""

PIECES = ((2000.0, "A68a"), (500.0, "finger (A68E)"), (180.0, "fragment (A68F)"), (0.0, "tip (A68D)"))
"""Names of the outlines of 17 to 26 December by their least area, km2."""

TRACKED = ("A68A", "A68D", "A68E", "A68F")
"""Bergs of the BYU and NIC table that were part of A68a on 9 December; A68C had left in April."""


@dataclass(frozen=True)
class OrthographicPlane(AzimuthalPlane):
    """The sphere seen from far above the point of contact: lengths within r**2 / 2 R**2."""

    def _stretch(self, cosine: Floats) -> Floats:
        return np.ones(np.shape(cosine))

    def _angle(self, rho: Floats) -> Floats:
        return np.asarray(np.arcsin(np.minimum(rho, 1.0)))


@dataclass(frozen=True)
class Told:
    """One run and its scores."""

    name: str
    title: str
    daily: Score
    pieces: Score
    tracks: Score
    events: list[dict[str, Any]]
    bonds_broken: int


RUNS = (("a68a", "own"), ("a68a", "reference"), ("a68a-oras5", "own"), ("a68a-oras5", "reference"))
"""Experiments and numerics; tables by day are of Riftberg's own."""


def shared_folder() -> Path | None:
    """Return the folder of the data, None where there is none."""
    named = os.environ.get("RIFTBERG_SHARED")
    folder = (Path(named) if named else ROOT.parent / "shared") / "data"
    return folder if (folder / "observed").is_dir() else None


# --- observations ------------------------------------------------------------------------------------------------------


def daily_outlines(data: Path) -> Observations:
    """Return the daily outlines of A68a itself, without the days on which only a part was seen."""
    found = read_observed(data / "observed" / "a68a_daily_outlines.geojson")
    days = [o for o in found.outlines if not (o.when.month == 12 and o.when.day in PARTIAL)]
    return dataclasses.replace(found, outlines=[dataclasses.replace(o, name="A68a") for o in days])


def piece_outlines(data: Path) -> Observations:
    """Return the outlines of all pieces from 17 December; where the main one was not drawn, its daily outline is added."""
    found = read_observed(data / "observed" / "a68_fragments_20201217_26.geojson")
    named = [dataclasses.replace(o, name=piece_name(area_km2(o))) for o in found.outlines]
    whole = {o.when for o in named if o.name == "A68a"}
    missing = [o for o in daily_outlines(data).outlines if o.when in {n.when for n in named} - whole]
    return dataclasses.replace(found, outlines=[*missing, *named])


def byu_positions(data: Path) -> Observations:
    """Return the positions of A68a and of what broke off it in December."""
    found = read_observed(data / "observed" / "a68_tracks_20201101_20210131_byu.csv")
    return dataclasses.replace(found, fixes=[f for f in found.fixes if f.name in TRACKED])


def area_km2(outline: Outline) -> float:
    """Return the area of an outline on the sphere, km2."""
    x, y = OrthographicPlane(*outline.ring.mean(axis=0), EARTH_RADIUS_A68).forward(*outline.ring.T)
    return 0.5e-6 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def piece_name(area: float) -> str:
    """Return which piece an outline of an area (km2) is."""
    return next(name for least, name in PIECES if area >= least)


# --- runs --------------------------------------------------------------------------------------------------------------


def run_experiment(name: str, numerics: str, data: Path, path: Path) -> tuple[xr.Dataset, Any]:
    """Run an experiment and return its run file and the model at the end."""
    model, info = build(name, Options(data=data / "a68a", numerics=numerics))  # type: ignore[arg-type]
    model.run(info.days, output=path, every_hours=1.0)
    return open_run(path), model


def told(name: str, numerics: str, data: Path) -> Told:
    """Run an experiment and score it."""
    with tempfile.TemporaryDirectory() as scratch:
        run, model = run_experiment(name, numerics, data, Path(scratch) / "run.nc")
        with run:
            daily = score_run(run, daily_outlines(data))
            pieces = score_run(run, piece_outlines(data))
            tracks = score_run(run, byu_positions(data))
    title = f"`riftberg run {name}`" + (" `--numerics reference`" if numerics == "reference" else "")
    return Told(name, title, daily, pieces, tracks, breakups(model), int(model.bonds_broken))


# --- tables ------------------------------------------------------------------------------------------------------------


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, words: int = 1) -> str:
    """Return a Markdown table; the first ``words`` columns are text, the others numbers."""
    rule = "|" + "".join("---|" if k < words else "---:|" for k in range(len(head)))
    return "\n".join(["| " + " | ".join(head) + " |", rule, *("| " + " | ".join(row) + " |" for row in rows)])


def number(value: float | None, form: str = ".0f") -> str:
    """Return a number, or nothing where there is none; nought has no sign."""
    if value is None or math.isnan(value):
        return ""
    text = format(value, form)
    return (text if float(text) else text.lstrip("+-")).replace("-", "−")


def counted(count: int, what: str) -> str:
    """Return a count with its noun in the right number."""
    return f"{count} {what}" + ("" if count == 1 else "s")


def short(time: str) -> str:
    """Return the day of a time as ``17 Dec``."""
    return f"{int(time[8:10])} Dec"


def overall(runs: Sequence[Told]) -> str:
    """Return the table of all runs against the daily outlines."""
    head = (
        "run", "last day", "days with an answer", "centroid off, km rms", "at most", "long axis off, ° rms",
        "area, model/observed", "mean IoU",
    )  # fmt: skip
    rows = []
    for run in runs:
        s = run.daily.summary()
        rows.append((
            run.title, short(run.daily.days[-1].time), f"{s['days']} of {len(run.daily.days)}",
            number(s["distance_km_rms"], ".1f"), number(s["distance_km_max"], ".1f"), number(s["azimuth_rms"]),
            number(s["area_ratio_mean"], ".2f"), number(s["iou_mean"], ".2f"),
        ))  # fmt: skip
    return table(head, rows)


def by_day(run: Told) -> str:
    """Return the table of a run by day."""
    head = (
        "day, 13:00", "observed distance from the start, km", "centroid off, km", "long axis, °", "observed", "off", "area, km²",
        "observed", "IoU",
    )  # fmt: skip
    rows = []
    for day, m in bergs(run.daily):
        rows.append((
            short(day.time), number(drift(m)), number(m.distance_km, ".1f"), number(m.azimuth), number(m.azimuth_observed),
            number(m.azimuth_difference, "+.0f"), number(m.area_km2), number(m.area_observed_km2), number(m.iou, ".2f"),
        ))  # fmt: skip
    return table(head, rows)


def bergs(score: Score) -> list[tuple[ScoredDay, Match]]:
    """Return the comparisons of the main berg by day."""
    return [(day, day.berg) for day in score.days if day.berg is not None]


def drift(match: Match) -> float:
    """Return how far from its first place the berg was seen, km."""
    first = A68A_OBSERVED[0]
    return haversine(match.lon_observed, match.lat_observed, first.lon, first.lat, EARTH_RADIUS_A68) / 1e3


def by_piece(run: Told) -> str:
    """Return the table of the observed pieces and what the run has for them."""
    rows = []
    for day in run.pieces.days:
        for k, m in enumerate(day.matches):
            made = " + ".join(map(str, m.fragments)) or "none"
            rows.append((
                short(day.time) if k == 0 else "", m.observed, number(m.area_observed_km2), made, number(m.area_km2),
                number(m.distance_km, ".1f"), number(m.azimuth_difference, "+.0f"), number(m.iou, ".2f"),
            ))  # fmt: skip
    head = (
        "day, 13:00", "observed piece", "area, km²", "fragments of the model", "their area, km²", "centroid off, km",
        "long axis off, °", "IoU",
    )  # fmt: skip
    return table(head, rows, words=2)


def pieces_told(run: Told) -> str:
    """Return how many pieces the run has an answer to, and which fragments answer to nothing."""
    matches = [m for day in run.pieces.days for m in day.matches]
    answered = sum(1 for m in matches if m.fragments)
    touching = sum(1 for m in matches if (m.iou or 0.0) > 0.0)
    return (
        f"Of {len(matches)} observed pieces on {len(run.pieces.days)} days (a piece counts on each day) "
        f"{answered} have a fragment of the model, {touching} of them one that overlaps."
    )


def by_track(runs: Sequence[Told]) -> str:
    """Return the table of all runs against the positions of BYU."""
    rows = []
    for run in runs:
        apart: dict[str, list[float | None]] = {}
        for day in run.tracks.days:
            for m in day.matches:
                apart.setdefault(m.observed, []).append(m.distance_km)
        for k, name in enumerate(sorted(apart)):
            there = [d for d in apart[name] if d is not None]
            rms = math.sqrt(sum(d * d for d in there) / len(there)) if there else None
            rows.append((
                run.title if k == 0 else "", name, str(len(apart[name])), str(len(there)), number(rms, ".1f"),
                number(max(there, default=math.nan), ".1f"),
            ))  # fmt: skip
    head = ("run", "berg", "days seen", "days with a fragment", "off, km rms", "at most")
    return table(head, rows, words=2)


def reading(run: Told) -> str:
    """Return what a run came to, in sentences made of its figures."""
    rows = bergs(run.daily)
    last_day, last = rows[-1]
    until, observed, made = turns(rows)
    worst = max((m.distance_km or 0.0) / drift(m) for _, m in rows if drift(m) > 20.0)
    return (
        f"{run.title}: from 9 to {until}ember it rotates by {number(made, '+.0f')}°, "
        f"the real berg by {number(observed, '+.0f')}° (clockwise positive). "
        f"The centroid is off by up to {100.0 * worst:.0f} % of the observed distance from the start, "
        f"and on {short(last_day.time)} by {last.distance_km:.0f} km of {drift(last):.0f} km. {broken_off(run)}"
    )


def broken_off(run: Told) -> str:
    """Return what broke off, in a sentence."""
    large = [e for e in run.events if e["area_km2"] >= 50.0]
    parts = [
        f"{e['area_km2']:.0f} km² on {short(e['time'])} {e['time'][11:16]} {'aground' if e['grounded'] else 'afloat'}"
        for e in large[:3]
    ]
    more = [f"{len(large) - 3} more of 50 km² or more"] if len(large) > 3 else []
    small = [counted(len(run.events) - len(large), "smaller piece")] if len(run.events) > len(large) else []
    words = ", ".join([*(parts or ["nothing of 50 km² or more"]), *more, *small])
    return f"Breaks off: {words}; {counted(run.bonds_broken, 'bond')} broken."


def turns(rows: list[tuple[ScoredDay, Match]]) -> tuple[str, float, float]:
    """Return the last day up to 17 December, and the turns of the real long axis and the model's until then, degrees."""
    until = [(day, m) for day, m in rows if day.time <= "2020-12-17T23"]
    found = []
    for name in ("azimuth_observed", "azimuth"):
        # Followed day by day, because an axis comes back after 180 degrees.
        angles = np.unwrap(np.array([getattr(m, name) for _, m in until], np.float64), period=180.0)
        found.append(float(angles[-1] - angles[0]))
    return short(until[-1][0].time), found[0], found[1]


# --- the berg of the mask ----------------------------------------------------------------------------------------------


def mask_table(data: Path) -> str:
    """Return the table of bergs made from the mask of 9 December against the published elements."""
    start, _ = build("a68a-oras5", Options(data=data / "a68a"))
    published, bonds = start.elements, start.bonds
    common: dict[str, Any] = {"variable": "b_id", "thickness": 200.0, "shift": SHIFT}
    made = {
        "`from_mask(mask, …)`": Iceberg.from_mask(data / "a68a" / MASK, **common),
        '`from_mask(mask, …, packing="hexagonal")`': Iceberg.from_mask(
            data / "a68a" / MASK, packing="hexagonal", **common
        ),
        f'`from_mask(mask, …, rules="makeberg", reference_latitude={REFERENCE_LATITUDE})`': Iceberg.from_mask(
            data / "a68a" / MASK, rules="makeberg", reference_latitude=REFERENCE_LATITUDE, **common
        ),
    }
    rows = [("published `icebergs.res.nc`", *sizes(published, bonds), "", "", "", "", "")]
    for name, berg in made.items():
        rows.append((name, *sizes(berg.elements, berg.bonds), *apart(berg.elements, published)))
    head = (
        "berg", "elements", "bonds", "area, km²", "mass, Gt", "nearest element, m rms", "at most", "centroid off, m", "IoU",
        "IoU, centroids laid on each other",
    )  # fmt: skip
    call = ", ".join(f'{key}="{v}"' if isinstance(v, str) else f"{key}={v}" for key, v in common.items())
    return f"{table(head, rows).rstrip()}\n\nHere … is `{call}`."


def sizes(elements: Any, bonds: Any) -> tuple[str, ...]:
    """Return number of elements and bonds, area and mass."""
    area = float((elements.length * elements.width).sum()) / 1e6
    return (
        str(len(elements.lon)), str(len(bonds.first)), number(area), number(float(elements.mass.sum()) / 1e12, ".1f"),
    )  # fmt: skip


def apart(elements: Any, published: Any) -> tuple[str, ...]:
    """Return distances from each published element to the nearest one, of the centroids, and the overlap."""
    here, there = plane(published), plane(elements)
    nearest = np.hypot(here[0][:, None] - there[0], here[1][:, None] - there[1]).min(axis=1)
    area = elements.length * elements.width
    centre = [float(np.average(c, weights=area)) - float(p.mean()) for c, p in zip(there, here, strict=True)]
    shapes = squares(here, published), squares(there, elements)
    rms = math.sqrt(float((nearest**2).mean()))
    lengths = (number(value) for value in (rms, float(nearest.max()), math.hypot(*centre)))
    return *lengths, number(intersection_over_union(*shapes), ".3f"), number(aligned_overlap(*shapes), ".3f")


def plane(elements: Any) -> tuple[Any, Any]:
    """Return positions in metres about the place of 9 December, with the longitudes on one branch."""
    lon = (np.asarray(elements.lon) + 180.0) % 360.0 - 180.0
    first = A68A_OBSERVED[0]
    return OrthographicPlane(first.lon, first.lat, EARTH_RADIUS_A68).forward(lon, np.asarray(elements.lat))


def squares(places: tuple[Any, Any], elements: Any) -> Any:
    """Return the union of squares of the elements' area; the seams between them are closed."""
    half = 0.5 * np.sqrt(elements.length * elements.width)
    boxes = shapely.box(places[0] - half, places[1] - half, places[0] + half, places[1] + half)
    return shapely.buffer(shapely.union_all(shapely.buffer(boxes, 60.0, join_style="mitre")), -60.0, join_style="mitre")


# --- page --------------------------------------------------------------------------------------------------------------


def text_of(data: Path) -> str:
    """Run everything and return the generated part of the page."""
    runs = []
    for name, numerics in RUNS:
        runs.append(told(name, numerics, data))
        print(f"{name}, {numerics}", file=sys.stderr, flush=True)
    parts = ["## All runs against the daily outlines", overall(runs), *(reading(run) for run in runs)]
    for run in runs:
        if "reference" not in run.title:
            parts += [
                f"## {run.name} by day",
                by_day(run),
                f"## {run.name}: the pieces",
                by_piece(run),
                pieces_told(run),
            ]
    parts += [
        "## Positions of BYU and NIC",
        by_track(runs),
        "## The berg made from the mask of 9 December",
        mask_table(data),
    ]
    return "\n\n".join(parts)


def main() -> int:
    """Print the tables and perhaps write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="put the tables into the documentation")
    write = parser.parse_args().write
    data = shared_folder()
    if data is None:
        print("no data: put the folder at ../shared or name it in RIFTBERG_SHARED", file=sys.stderr)
        return 2
    text = text_of(data)
    print(text)
    if write:
        before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.partition(END)[2]}", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
