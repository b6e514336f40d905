"""The story of the built-in A68a and its controls: what breaks off, when, where, aground or afloat.

python benchmarks/story.py                   print the tables
python benchmarks/story.py --write           also put them into docs/evidence/a68a.md
python benchmarks/story.py --explicit        only the table of the explicit scheme
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from riftberg.diagnostics.summary import breakups, fragment_areas
from riftberg.experiments import Numerics, Options
from riftberg.experiments.a68a import A68A_OBSERVED, DAYS, ObservedDay, story_model
from riftberg.ocean.story import OWN, REFERENCE, StoryOcean
from riftberg.parameters import Packing
from riftberg.physics.floating import draft_of
from riftberg.plane import ConformalPlane
from riftberg.runs.model import Model
from riftberg.runs.scene import element_polygons
from riftberg.runs.tracks import Position, axis_difference, berg_position

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "a68a.md"
KM_PER_DEGREE = 111.07
"""Of latitude, on the sphere of the publication."""

MOMENTS = (93.6, 102.5, 111.1, 125.5, 140.2, 156.3, 168.0, 2.5, 6.2, 5.2, 6.2, 177.7, 169.8)
"""Azimuths of the axis of the largest second moment of the observed daily outlines, 9 to 21 December, degrees; computed as those
of the least rectangles in `A68A_OBSERVED`, from the same outlines."""

SMALL = 50.0
"""Pieces below this area (km2) are counted, not listed."""


@dataclass(frozen=True)
class Run:
    """One row of the table: what differs from the built-in run."""

    name: str
    without: frozenset[str] = frozenset()
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)
    numerics: Numerics = "own"
    radius: float = 1500.0
    packing: Packing = "square"
    moved: tuple[float, float] = (0.0, 0.0)  # of the start, degrees east and north
    eddy: float = 1.0  # factor on the spin of the eddy

    def model(self) -> Model:
        """Build the model of the row."""
        options = Options(self.changes, without=self.without, numerics=self.numerics)
        ocean = None
        if self.eddy != 1.0:
            ocean = StoryOcean(OWN._replace(eddy_spin=self.eddy * OWN.eddy_spin))
        model = story_model(options, radius=self.radius, packing=self.packing, ocean=ocean)
        model.elements.lon[:] += self.moved[0]
        model.elements.lat[:] += self.moved[1]
        return model


def strength(kilopascal: float) -> dict[str, dict[str, Any]]:
    """Change the strength of the ice; of the bonds in the explicit scheme."""
    return {"fracture": {"normal_strength": 1e3 * kilopascal}}


RUNS = (
    Run("`riftberg run a68a`"),
    Run("`--without shoal`", frozenset({"shoal"})),
    Run("`--without shear`", frozenset({"shear"})),
    Run("`--without shoal --without shear`", frozenset({"shoal", "shear"})),
    *(Run(f"strength {value} kPa", changes=strength(value)) for value in (9, 10, 12, 13, 14, 18)),
    *(Run(f"long step of {value} s", changes={"stepping": {"time_step": value}}) for value in (1800, 900, 450, 225)),
    Run("stiffness of ice, 9 GPa", changes={"bonds": {"youngs_modulus": 9e9}}),
    Run("start 1.3 km further east", moved=(0.02, 0.0)),
    Run("start 1.3 km further west", moved=(-0.02, 0.0)),
    Run("start 1.7 km further north", moved=(0.0, 0.015)),
    Run("start 1.7 km further south", moved=(0.0, -0.015)),
    Run("start 2.8 km further east", moved=(0.045, 0.0)),
    Run("start 2.8 km further west", moved=(-0.045, 0.0)),
    Run("start 3 km further north", moved=(0.0, 0.027)),
    Run("start 3 km further south", moved=(0.0, -0.027)),
    *(Run(f"eddy {part} % {'weaker' if sign < 0 else 'stronger'}", eddy=1.0 + 0.01 * sign * part)
      for part in (5, 10) for sign in (-1, 1)),
    *(Run(f"radius {1e-3 * radius:g} km", radius=radius) for radius in (1000.0, 750.0)),
    Run("radius 1.5 km, hexagonal packing", packing="hexagonal"),
    Run("hexagonal packing, strength 9 kPa", changes=strength(9), packing="hexagonal"),
)  # fmt: skip
"""The built-in run, by the quasi-static scheme, and what differs from it."""


def explicit(name: str, step: float = 1800.0, changes: dict[str, dict[str, Any]] | None = None, **others: Any) -> Run:
    """Return a row by the explicit scheme with a long step (s) in sub-steps of 20 s or just below, and published bonds."""
    stepping = {"scheme": "mts", "time_step": step, "substeps": math.ceil(step / 20.0)}
    return Run(name, changes={"stepping": stepping} | (changes or strength(16)), **others)


MTS: dict[str, dict[str, Any]] = {"stepping": {"scheme": "mts"}} | strength(16)
EXPLICIT = (
    explicit("long step of 1800 s"),
    explicit("`--without shoal`", without=frozenset({"shoal"})),
    explicit("`--without shear`", without=frozenset({"shear"})),
    *(explicit(f"strength {value} kPa", changes=strength(value)) for value in (14, 18, 20)),
    *(explicit(f"long step of {value} s", value) for value in (900, 600, 450, 150)),
    *(explicit(f"long step of 450 s, strength {value} kPa", 450, strength(value)) for value in (14, 18, 20)),
    Run("twice the sub-steps", changes={"stepping": {"scheme": "mts", "substeps": 180}} | strength(16)),
    Run("radius 1 km", changes=MTS, radius=1000.0),
    Run("hexagonal packing", changes=MTS, packing="hexagonal"),
    Run("radius 1 km, hexagonal packing", changes=MTS, radius=1000.0, packing="hexagonal"),
    explicit("long step of 450 s, hexagonal packing", 450, packing="hexagonal"),
    Run("`--numerics reference`, in the ocean fitted to it", numerics="reference"),
)
"""Rows with the explicit scheme."""

HEAD = (
    "run",
    "breaks off (area, day and hour of December, water)",
    "largest piece, km²",
    "bonds broken",
    "of them by 23 Dec",
)
ASKED = ("", "asked", "got")


def told(event: dict[str, Any]) -> str:
    """Return a break-up in words."""
    day, hour = event["time"][8:10], event["time"][11:16]
    return f"{event['area_km2']:.0f} km² {int(day)}. {hour} {'aground' if event['grounded'] else 'afloat'}"


def row(run: Run) -> tuple[str, ...]:
    """Run and return the cells of a row."""
    model = run.model()
    model.advance(DAYS)
    events = breakups(model)
    large = [told(event) for event in events if event["area_km2"] >= SMALL]
    small = Counter(event["area_km2"] >= SMALL for event in events)[False]
    words = ", ".join(large) or "nothing"
    return (
        run.name, words + (f" and {small} below {SMALL:g} km²" if small else ""), f"{fragment_areas(model)[0]:.0f}",
        str(model.bonds_broken), f"{broken_early(model)} = {100 * broken_early(model) / model.bonds.status.size:.1f} %",
    )  # fmt: skip


def broken_early(model: Model) -> int:
    """Bonds that broke before 23 December 00:00."""
    limit = (23 - model.start.day) * 86400.0 - model.start.hour * 3600.0
    return int((model.bonds.break_time < limit).sum())


def off(model: Model, seen: ObservedDay) -> tuple[float, float, float]:
    """Compare with an observed day, without the pieces that are off by then.

    The tip counts until it breaks off, the finger until 23 December: it lay beside the berg.

    Returns
    -------
    float
        Distance of the centroids, km.
    float
        Axis of the model's largest second moment minus the observed azimuth (long side of the least rectangle), degrees.
    float
        The same with the long side of the least rectangle of both.
    """
    e = model.elements
    gone = [f.number for f in model.fragments.breakups if f.grounded or seen.day > 23]
    on = ~np.isin(e.berg, gone)
    p = berg_position(e.lon[on], e.lat[on], (e.length * e.width)[on])
    east = ((p.lon - seen.lon + 180.0) % 360.0 - 180.0) * math.cos(math.radians(seen.lat))
    apart = KM_PER_DEGREE * math.hypot(east, p.lat - seen.lat)
    turns = (axis_difference(azimuth, seen.azimuth) for azimuth in (p.azimuth, long_side(model, on, p)))
    return apart, *turns


def long_side(model: Model, on: Any, here: Position) -> float:
    """Azimuth of the long side of the least rectangle around some elements, degrees clockwise from north."""
    e, p = model.elements, model.parameters
    corners = element_polygons(
        e.lon[on],
        e.lat[on],
        e.rotation[on],
        (e.length * e.width)[on],
        p.bonds.packing,
        latlon=True,
        radius=p.earth.radius,
    ).reshape(-1, 2)
    x, y = ConformalPlane(here.lon, here.lat, p.earth.radius).forward(*corners.T)
    return rectangle_azimuth(shapely.multipoints(np.column_stack([x, y])))


def rectangle_azimuth(shape: Any) -> float:
    """Return the azimuth of the long side of the least rectangle around a shape (m east and north), degrees, 0 to 180.

    `riftberg.experiments.a68a` gives it for the observed outlines. It goes by the outermost points, where the axis of
    the largest second moment (`riftberg.diagnostics.outlines.polygon_moments`) goes by the area: for outlines of A68a both
    differ by up to 10 degrees.
    """
    box = shape.minimum_rotated_rectangle
    if box.geom_type != "Polygon":
        return float("nan")
    corners = np.asarray(box.exterior.coords)
    (x, y) = max(np.diff(corners[:3], axis=0), key=lambda side: float(np.hypot(*side)))
    return float(np.degrees(np.arctan2(x, y)) % 180.0)


def fastest(ocean: StoryOcean) -> tuple[float, float, float, float]:
    """Search the fastest current within 150 km of the observed path, from 9 to 26 December 13:00.

    Every hour on a grid of 5 km; from the fastest point of each day on in steps of minutes and some ten metres.

    Returns
    -------
    speed, lon, lat, day : float
        m s-1, degrees, and days since the start.
    """
    best = (0.0, 0.0, 0.0, 0.0)
    for seen in A68A_OBSERVED[:-1]:
        sides, span = (np.linspace(-2.5, 2.5, 63), np.linspace(-1.4, 1.4, 63)), np.arange(25) / 24.0
        found = _fastest_of(ocean, seen.lon + sides[0], seen.lat + sides[1], seen.day - 9.0 + span)
        for _ in range(6):
            sides, span = (sides[0] / 4.0, sides[1] / 4.0), np.linspace(-1.0, 1.0, 9) * (span[1] - span[0])
            found = max(found, _fastest_of(ocean, found[1] + sides[0], found[2] + sides[1], found[3] + span))
        best = max(best, found)
    return best


def _fastest_of(ocean: StoryOcean, lon: Any, lat: Any, days: Any) -> tuple[float, float, float, float]:
    """Return the fastest current (m s-1) at some places and times, and where and when it is."""
    x, y = np.meshgrid(lon, lat)
    best = (0.0, 0.0, 0.0, 0.0)
    for day in days:
        speed = np.hypot(*ocean.currents(x, y, 86400.0 * day))
        k = np.unravel_index(int(np.argmax(speed)), speed.shape)
        best = max(best, (float(speed[k]), float(x[k]), float(y[k]), float(day)))
    return best


def contact_radius(ocean: StoryOcean, draft: float) -> float:
    """Radius (m) of the shoal within which a keel of a draft (m) touches the floor."""
    _, _, length, height, floor = ocean.numbers.shoal
    return length * math.sqrt(math.log(height / (floor - draft)))


def shoal_told() -> str:
    """Return the size of the shoal beside that of the shared description."""
    model = Run("").model()
    draft = draft_of(float(model.elements.thickness.max()), model.parameters.ice.density)
    here, there = (contact_radius(StoryOcean(numbers), draft) / 1e3 for numbers in (OWN, REFERENCE))
    east = (OWN.shoal[0] - REFERENCE.shoal[0]) * math.cos(math.radians(OWN.shoal[1]))
    apart = KM_PER_DEGREE * math.hypot(east, OWN.shoal[1] - REFERENCE.shoal[1])
    return (
        f"{here:.1f} km from its summit, {draft:.0f} m deep ({there:.1f} km in the description's); "
        f"the summit lies {apart:.1f} km from the description's"
    )


def storyline() -> list[tuple[str, ...]]:
    """Run the built-in experiment and return what was asked of it, and what came."""
    model = Run("").model()
    days: dict[int, tuple[float, float, float]] = {}
    beside = 0.0
    for seen in A68A_OBSERVED:
        days[seen.day] = off(model, seen)
        for _ in range(8 * (seen.day < 26)):
            model.advance(0.125)
            beside = max(beside, float(np.hypot(model.elements.uo, model.elements.vo).max()))
    early = np.array([days[day] for day in range(9, 22)])
    moments = [
        axis_difference(days[seen.day][1] + seen.azimuth, observed)
        for seen, observed in zip(A68A_OBSERVED, MOMENTS, strict=False)
    ]
    moment = float(np.sqrt(np.mean(np.square(moments))))
    distance, turn, rectangle = np.sqrt(np.mean(early**2, axis=0))
    large = [event for event in breakups(model) if event["area_km2"] >= SMALL]
    tip = next(event for event in large if event["grounded"])
    finger = max((event for event in large if not event["grounded"]), key=lambda event: event["area_km2"])
    there = model.elements.berg == next(
        f.number for f in model.fragments.breakups if f.grounded and f.area > 1e6 * SMALL
    )
    lat, lon = model.elements.lat[there].mean(), (model.elements.lon[there].mean() + 180.0) % 360.0 - 180.0
    away = KM_PER_DEGREE * math.hypot((lon + 36.72) * math.cos(math.radians(55.5)), lat + 55.56)
    speed, lon_fast, lat_fast, day = fastest(StoryOcean())
    return [
        ("centroid, 9 to 21 December, rms", "10 km", f"{distance:.1f} km (largest {early[:, 0].max():.1f})"),
        ("azimuth, 9 to 21 December, rms: second moments against the observed rectangle", "10°",
         f"{turn:.1f}° (largest {np.abs(early[:, 1]).max():.0f})"),
        ("the same, second moments of both", "", f"{moment:.1f}° (largest {np.abs(moments).max():.0f})"),
        ("the same, least rectangles of both", "", f"{rectangle:.1f}° (largest {np.abs(early[:, 2]).max():.0f})"),
        ("centroid on 22, 23, 25 and 26 December", "right", ", ".join(f"{days[d][0]:.1f}" for d in (22, 23, 25, 26)) + " km"),
        ("tip: aground, 16 to 18 December", "80 to 300 km²", told(tip)),
        ("tip (A68D) on 26 December", "stays behind", f"{-lat:.2f} S, {-lon:.2f} W: {away:.0f} km from where it was seen"),
        ("finger: afloat, 19 to 22 December", "450 to 900 km², near 600", told(finger)),
        ("largest piece", "2400 km² or more", f"{fragment_areas(model)[0]:.0f} km²"),
        ("bonds broken by 23 December", "less than 5 %", f"{100 * broken_early(model) / model.bonds.status.size:.1f} %"),
        ("fastest current", "about 0.5 m/s", f"{beside:.2f} m/s at the berg; {speed:.3f} m/s around it, at {-lat_fast:.2f} S, "
         f"{-lon_fast:.2f} W on day {day:.1f}"),
        ("shoal: where the keel touches", "5 km from its summit (shared description)", shoal_told()),
    ]  # fmt: skip


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def put(page: str, name: str, text: str) -> str:
    """Put a text between the marks of a page."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, _, rest = page.partition(begin)
    return f"{before}{begin}\n\n{text}\n\n{end}{rest.partition(end)[2]}"


def print_tables(page: Path, tables: Mapping[str, str], *, write: bool) -> None:
    """Print tables by their marks, and put them into a page where that is asked for."""
    text = page.read_text("utf-8")
    for name, made in tables.items():
        print(made, end="\n\n")
        text = put(text, name, made)
    if write:
        page.write_text(text, "utf-8")


def told_rows(runs: Iterable[Run]) -> Iterator[tuple[str, ...]]:
    """Run all rows, and say which is done."""
    for run in runs:
        cells = row(run)
        print(*cells, sep=" | ", file=sys.stderr, flush=True)
        yield cells


def main() -> int:
    """Run all, print the tables and perhaps write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="put the tables into the documentation")
    parser.add_argument("--explicit", action="store_true", help="only the table of the explicit scheme")
    asked = parser.parse_args()
    tables = {"explicit": table(HEAD, told_rows(EXPLICIT))}
    if not asked.explicit:
        tables |= {"storyline": table(ASKED, storyline()), "story": table(HEAD, told_rows(RUNS))}
    print_tables(PAGE, tables, write=asked.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
