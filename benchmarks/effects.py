"""What each option beyond the reference, and each quirk of it, changes for A68a.

    python benchmarks/effects.py             print the table
    python benchmarks/effects.py --write     also put it into the documentation

The built-in experiment ``a68a`` is run once for each row with one thing changed; the ocean is the same. About one to three
seconds of computing a row.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
from story import strength

from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.experiments import Options, build
from riftberg.parameters import PUBLISHED_SPRINGS, kid_quirks
from riftberg.runs.model import Model
from riftberg.runs.tracks import DailyTrack

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "evidence" / "effects.md"
BEGIN, END = "<!-- effects: begin -->", "<!-- effects: end -->"
SMALL = 50.0
"""Fragments below this area (km2) are counted, not listed."""

Shape = Callable[[Model], None]


@dataclass(frozen=True)
class Row:
    """One run of the table."""

    name: str
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)
    numerics: str = "own"
    shape: Shape | None = None
    against: str = "own"


@dataclass
class Result:
    """What a run came to."""

    row: Row
    substeps: int
    track: list[tuple[Any, Any]]
    events: list[tuple[Any, float, bool]]
    small: int
    broken: int
    left: float
    spinning: float
    wall: float


def uneven_thickness(model: Model) -> None:
    """Give the elements 150 to 250 m of ice at random (seed 1); the mass follows."""
    e = model.elements
    thickness = np.random.default_rng(1).uniform(150.0, 250.0, e.mass.size)
    e.mass[:] *= thickness / e.thickness
    e.thickness[:] = thickness


def uneven_size(model: Model) -> None:
    """Make the elements 0 to 0.2 % smaller at random (seed 1) where they stand; more would break the bonds at once."""
    e = model.elements
    factor = np.random.default_rng(1).uniform(0.998, 1.0, e.mass.size)
    e.length[:] *= factor
    e.width[:] *= factor
    e.mass[:] *= factor**2


def quirk(*names: str) -> dict[str, dict[str, Any]]:
    """Switch quirks on."""
    return {"compatibility": dict.fromkeys(names, True)}


THICK, SIZE = "uneven thickness", "uneven size"
OWN_SIZE = {"bonds": {"constant_size": False}}
REFERENCE = {
    "drag": {"rotational": False},
    "grounding": {"implicit": False},
    "bonds": {"objective_damping": False},
    "stepping": {"skip_first_long_force": True},
    **kid_quirks(),
}
ROWS = (
    Row("own"),
    Row("reference", REFERENCE),
    Row("reference, in the ocean fitted to it", numerics="reference"),
    Row("damper of the reference (Q43)", {"bonds": {"objective_damping": False}}),
    Row("no bond damping", {"bonds": {"damping": 0.0}}),
    Row("explicit grounding drag", {"grounding": {"implicit": False}}),
    Row("explicit grounding drag, 10 s", {"grounding": {"implicit": False}, "stepping": {"substeps": 180}}),
    Row("implicit grounding drag, 10 s", {"stepping": {"substeps": 180}}),
    Row("automatic sub-step", {"stepping": {"substeps": None}}),
    Row("automatic sub-step, half as long", {"stepping": {"substeps": None, "safety": 0.4}}),
    Row("no rotational water drag", {"drag": {"rotational": False}}),
    Row("long step of 15 min", {"stepping": {"time_step": 900.0, "substeps": 45}}),
    Row("uncentred half kicks", quirk("uncentred_half_kicks")),
    Row("velocities in bonds not in common axes", quirk("flat_relative_velocity")),
    Row("contact of pieces damped explicitly", quirk("explicit_contact_damping")),
    Row("lagged forcing (Q5)", quirk("forcing_lag")),
    Row("start of the reference (Q6, Q9)", quirk("zero_start", "inline_break_in_first_step")),
    Row("collision flags stay (Q2)", quirk("sticky_collision_flags")),
    Row(THICK, shape=uneven_thickness, against=THICK),
    Row(f"{THICK}, section of the reference (Q11)", quirk("bond_thickness_of_second"), "own", uneven_thickness, THICK),
    Row(SIZE, OWN_SIZE, "own", uneven_size, SIZE),
    Row(f"{SIZE}, lever of the reference (Q10)", {**OWN_SIZE, **quirk("shared_shear_lever")}, "own", uneven_size, SIZE),
)


def run(row: Row, days: float | None = None) -> Result:
    """Run the experiment with the changes of a row."""
    # Quirks are of the explicit scheme, whose bonds tell the story with 16 kPa (docs/evidence/a68a.md).
    usual: dict[str, Any] = {**PUBLISHED_SPRINGS, "stepping": {"scheme": "mts", "substeps": 90}}
    if row.numerics == "own":
        usual |= strength(16)
    changes = {group: {**usual.get(group, {}), **row.changes.get(group, {})} for group in {**usual, **row.changes}}
    model, info = build("a68a", Options(changes=changes, numerics=row.numerics))  # type: ignore[arg-type]
    if row.shape is not None:
        row.shape(model)
        fresh = build("a68a", Options(changes=changes))[0]
        berg = dataclasses.replace(_berg(fresh), elements=model.elements, bonds=model.bonds)
        model = Model(berg, model.forcing, model.parameters, model.start)
    track = DailyTrack()
    before = clock.perf_counter()
    model.advance(info.days if days is None else days, recorders=[track])
    wall = clock.perf_counter() - before
    born = [r for r in model.fragments.rows if r.parent > 0]
    events = [(model.start + timedelta(seconds=r.birth_time), r.area / 1e6, bool(r.grounded)) for r in born]
    large = [event for event in events if event[1] >= SMALL]
    e = model.elements
    areas = np.bincount(np.unique(e.berg, return_inverse=True)[1], weights=e.length * e.width) / 1e6
    return Result(
        row, model.substeps, list(track.rows), large, len(events) - len(large), model.bonds_broken, float(areas.max()),
        float(np.abs(e.spin).max()), wall,
    )  # fmt: skip


def _berg(model: Model) -> Any:
    from riftberg.bergs.iceberg import Iceberg

    p = model.parameters
    return Iceberg(
        elements=model.elements, bonds=model.bonds, packing=p.bonds.packing, radius=1500.0, report={},
        latlon=p.earth.latlon, earth_radius=p.earth.radius, density=p.ice.density,
    )  # fmt: skip


def apart(a: Result, b: Result, day: int) -> tuple[float, float]:
    """Distance (km) and difference of azimuth (degrees) of the main bergs at a day."""
    p, q = a.track[day][1], b.track[day][1]
    x = (p.lon - q.lon) * DEGREE * EARTH_RADIUS_A68 / 1e3 * np.cos(p.lat * DEGREE)
    y = (p.lat - q.lat) * DEGREE * EARTH_RADIUS_A68 / 1e3
    turned = (p.azimuth - q.azimuth + 90.0) % 180.0 - 90.0
    return float(np.hypot(x, y)), float(turned)


def cells(result: Result, results: dict[str, Result]) -> tuple[str, ...]:
    """Return the cells of a row."""
    events = ", ".join(
        f"{area:.0f} km² {when.day}. {when:%H:%M}{' aground' if grounded else ''}"
        for when, area, grounded in result.events[:4]
    )
    events += f" and {len(result.events) - 4} more" if len(result.events) > 4 else ""
    events += f" and {result.small} below {SMALL:g}" if result.small else ""
    other = results.get(result.row.against)
    differences = []
    for day in (7, 12):
        if other is result or other is None:
            differences.append("")
            continue
        distance, turned = apart(result, other, day)
        differences.append(f"{distance:.2g} km, {turned:+.2g}°")
    return (
        result.row.name, str(result.substeps), *differences, events or "none", str(result.broken), f"{result.left:.0f}",
        f"{result.spinning * 86400 / 6.283:.2g}",
    )  # fmt: skip


HEAD = (
    "run", "sub-steps", "16 Dec: off by", "21 Dec: off by", "broke off (December)", "bonds broken", "largest piece, km²",
    "fastest spin at the end, turns a day",
)  # fmt: skip


def markdown(results: dict[str, Result]) -> str:
    """Return the table."""
    lines = ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
    lines += ["| " + " | ".join(cells(r, results)) + " |" for r in results.values()]
    return "\n".join(lines)


def main() -> int:
    """Run all rows, print the table and perhaps write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="put the table into the documentation")
    write = parser.parse_args().write
    results: dict[str, Result] = {}
    for row in ROWS:
        results[row.name] = run(row)
        print(f"{row.name}: {results[row.name].wall:.1f} s", file=sys.stderr, flush=True)
    text = markdown(results)
    print(text)
    if write:
        before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
        PAGE.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}", "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
