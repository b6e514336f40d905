"""The results of a run, in one dictionary that is written as ``summary.json``.

Keys
----
experiment : name of the experiment
start, end : dates of the first and the last state (ISO 8601)
days : length of the run, days
elements : number of elements
bonds_total, bonds_broken : number of bonds, and of those that broke
fragments : number of fragments at the end
breakups : list, one entry per fragment that split from its parent:
    time, lon, lat, area_km2, bonds (broken to free it), grounded (true where a bond broke aground), fragment, parent,
    name and parent_name (empty for bergs without a name)
bergs : list, one entry per berg of the start, and per one added later: number, name, area_km2 (as it was then), fragments
    (how many pieces it is in at the end), largest_km2 (of these), areas_km2 (of the six largest), largest (number of that
    piece), largest_weight (N), melted_kg, and drift_east_km, drift_north_km (of the largest from where the berg began; round a
    periodic domain all of the way), lon, lat (of the largest), and of the ice of the largest (Pa): prestress (mean by area),
    largest_prestress, reserve (tension that it bears beside it), crevasse_strength (at the tips of its crevasses: given, or the
    meaning of fracture.normal_strength), front and foot (largest bending at its edges, by closed forms: stress (Pa, of the top at
    fronts, of the base at feet), inland (m from the edge), lon, lat, corner (angle of the ice, degrees; null along a straight
    edge); foot is null without footloose calving); all null where it is gone, reserve and crevasse_strength where the strength
    is none of the ice
crevasses : how far strengths at the tips of crevasses, pre-stress and reserve can be trusted
rifts : list, one entry per standing tip of a rift that was there from the start: crack (its number), lon, lat, length (m),
    spacing (of the elements beside it, m), opening and shearing (K_I and K_II, Pa m1/2), largest (largest hoop intensity since it
    came to stand there), of_toughness and largest_of_toughness (hoop intensity now, and that, over fracture.toughness; null
    without one); all from opening on null where the rift is too short, or its tip too near to the outline or another crack
collisions : list, one entry per collision of two bergs or fragments: time, end, bergs (their names or numbers), lon, lat,
    speed (relative speed before they touched, m s-1)
track : list, one entry per day at the hour of the start: time, lon, lat, azimuth, area_km2 of the largest fragment;
    azimuth of its long axis in degrees clockwise from north, 0 to 180, null where it has none
largest_km2, areas_km2 : area of the largest fragment, and of all, largest first, at the end
ground : effects of the sea floor: law, least_clearance (m, water under the keel at the least; in the explicit schemes
    negative where it stands deeper than the floor), bathymetry_spacing (m between the nodes of the chart under the berg,
    null for formulas), first (date of the first touch, null where none), stays: list, one entry per stay of a berg, or of a
    fragment of 5 % of its berg or more: number, name, first, last, lasts (aground at the end), lon, lat, towards (degrees
    from north, of the side that touched, null for the middle), hours, times (touches), elements, load (N), capacity (N,
    friction that could hold it), pressing (N, force of the sea), lift (m, largest rise of the keel), bending_stress (Pa,
    largest of the ice that the floor lifts), gouge (m, how deep a bed that yields was pressed), way_aground (m),
    stopped_within (m, null where it did not stop), held_since (date, null while it slides), sea_level (m above the zero of
    the depth, at the first touch). elements_of_small_pieces: aground at the end, of pieces without a stay. For all of them
    together: hours, times, elements, load, capacity, pressing, lift, bending_stress, gouge, way_aground (the longest); with
    the law seabed the sediment, and capacity_on: capacity of the same load on clay and on rock (N)
ledger : ice (kg) at start and end, melt water (kg) and its heat (J) by process, other gains (kg), and the part of the
    turnover by which the ledgers of mass and heat do not close; by_fragment: melt water (kg) by process of each fragment;
    null where nothing melts
motion : momentum (N s, east and north) at start and end, impulse of each force; kinetic energy (J) at start and end,
    work of each force; energy in bonds, dissipated (null where bonds do not vibrate), released by cracks, and
    crushed: plastic work and friction of faces that crush each other, rubbed: friction of grounding.law seabed
wall_seconds : wall time of the whole run, s
seconds_per_day : wall time per simulated day without the first step and without compilation, s; null in runs of one step
steps : long steps taken
numerics : all parameters of the run by group
forcing : description of the forcing
riftberg : version of Riftberg
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from riftberg import constants
from riftberg.bergs.bonding import Metric, separations
from riftberg.config.units import area_text, count_text
from riftberg.config.values import finding_text
from riftberg.engines.common.fragments.tree import centroid
from riftberg.engines.common.reserves import CAVEAT, Reserve, berg_reserve
from riftberg.errors import InputError
from riftberg.life.feet import edge_moduli, find_growth
from riftberg.life.ledger import PROCESSES, read_melt
from riftberg.runs.groundings import summarize_ground
from riftberg.runs.layout import label_fragment, read_start
from riftberg.runs.progress import Stopwatch
from riftberg.runs.tracks import Position, by_area, track_table
from riftberg.state.variables import LARGEST
from riftberg.system.input_files import MOST_TEXT, check_file, reading, shown
from riftberg.version import __version__

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.model import BareModel


MOST_FRAGMENTS: Final = 100
"""Fragments in the ledger of a summary, those that lost most; the run file has all."""


def summarize(
    model: BareModel,
    *,
    experiment: str = "",
    track: Sequence[tuple[datetime, Position]] = (),
    stopwatch: Stopwatch | None = None,
) -> dict[str, Any]:
    """Return the summary of a run; its keys are documented at the top of this file."""
    areas = fragment_areas(model)
    speed = math.nan if stopwatch is None else stopwatch.seconds_per_day
    return {
        "experiment": experiment,
        "start": model.start.isoformat(),
        "end": (model.start + timedelta(seconds=model.time)).isoformat(),
        "days": model.time / constants.SECONDS_PER_DAY,
        "elements": len(model.elements.id),
        "bonds_total": len(model.bonds.status),
        "bonds_broken": bonds_broken(model),
        "fragments": len(areas),
        "breakups": breakups(model),
        "bergs": berg_entries(model),
        "crevasses": CAVEAT,
        "rifts": [tip.as_dict(model.parameters) for tip in model.rift_tips],
        "collisions": collisions(model),
        "ground": summarize_ground(model),
        "track": track_table(track),
        "largest_km2": areas[0] if areas else 0.0,
        "areas_km2": areas,
        "ledger": ledger_entry(model),
        "motion": motion_entry(model),
        "wall_seconds": None if stopwatch is None else stopwatch.wall_seconds,
        "seconds_per_day": None if math.isnan(speed) else speed,
        "steps": model.step_number,
        "numerics": model.parameters.model_dump(mode="json"),
        "forcing": model.forcing.describe(),
        "riftberg": __version__,
    }


def ledger_entry(model: BareModel) -> dict[str, Any] | None:
    """Return the ledger of melt as the summary holds it."""
    if model.life is None:
        return None
    balance = model.life.balance(model)
    rows = model.fragments.rows
    water = read_melt(model.remembered, np.array([row.number for row in rows], np.int64))
    order = np.argsort(-water.sum(axis=1), kind="stable")[:MOST_FRAGMENTS].tolist()
    by_fragment = [
        {
            "fragment": rows[k].number,
            "name": label_fragment(rows[k].number, rows[k].parent, rows[k].name),
            **dict(zip(PROCESSES, water[k].tolist(), strict=True)),
        }
        for k in order
        if water[k].any()
    ]
    return {
        **balance._asdict(), "error": balance.error, "heat_error": balance.heat_error, "by_fragment": by_fragment,
        "lines": balance.lines(),
    }  # fmt: skip


def motion_entry(model: BareModel) -> dict[str, Any] | None:
    """Return the ledger of momentum and mechanical energy as the summary holds it."""
    if model.motion is None:
        return None
    balance = model.motion.balance(model, model.remembered)
    return {**balance.as_dict(), "closing": balance.closing(), "lines": balance.lines()}


def bonds_broken(model: BareModel) -> int:
    """Return the number of bonds that broke since the start."""
    return int(np.isfinite(model.bonds.break_time).sum())


def fragment_areas(model: BareModel) -> list[float]:
    """Return the areas of all fragments, km2, largest first."""
    e = model.elements
    return [area / 1e6 for area in by_area(e.berg, e.length * e.width).values()]


def breakups(model: BareModel) -> list[dict[str, Any]]:
    """Return one entry per fragment that split from its parent, in order of time."""
    rows = model.fragments.rows
    names = {row.number: row.name for row in rows}
    return [
        {
            "time": (model.start + timedelta(seconds=row.birth_time)).isoformat(),
            "lon": row.lon,
            "lat": row.lat,
            "area_km2": row.area / 1e6,
            "bonds": row.bonds_broken,
            "grounded": row.grounded,
            "fragment": row.number,
            "parent": row.parent,
            "name": row.name,
            "parent_name": names.get(row.parent, ""),
        }
        for row in sorted(rows, key=lambda row: row.birth_time)
        if row.parent > 0
    ]


def berg_entries(model: BareModel) -> list[dict[str, Any]]:
    """Return one entry per berg of the start, and per one that was added later."""
    from riftberg.life.edges import berg_edges  # with shapely, half a second

    rows = {row.number: row for row in model.fragments.rows}
    e, p = model.elements, model.parameters
    youngs = edge_moduli(e, p, find_growth(e, model.remembered)[0]) if p.footloose.enabled else None
    area, earth, origin = e.length * e.width, model.parameters.earth, model.fragments.origin
    unwrapped = e.lon + earth.period * model.turns if earth.period > 0.0 else e.lon

    pieces: dict[int, list[tuple[float, int]]] = {}
    for number, size in by_area(e.berg, area).items():
        pieces.setdefault(origin(number), []).append((size / 1e6, number))
    melted: dict[int, float] = {}
    if model.life is not None:
        for number, water in zip(
            rows, read_melt(model.remembered, np.array(list(rows), np.int64)).sum(axis=1), strict=True
        ):
            melted[origin(number)] = melted.get(origin(number), 0.0) + float(water)
    entries: list[dict[str, Any]] = []
    for number, row in rows.items():
        if row.parent > 0:
            continue
        mine = sorted(pieces.get(number, []), reverse=True)
        entry = {
            "number": number, "name": row.name, "area_km2": row.area / 1e6,
            "fragments": len(mine), "largest_km2": mine[0][0] if mine else 0.0, "areas_km2": [size for size, _ in mine[:NAMED]],
            "melted_kg": melted.get(number, 0.0), "largest": mine[0][1] if mine else 0, "largest_weight": 0.0,
            **dict.fromkeys(("drift_east_km", "drift_north_km", "lon", "lat", *Reserve._fields, "front", "foot")),
        }  # fmt: skip
        if mine:
            inside = e.berg == mine[0][1]
            lon, lat = centroid(e.lon[inside], e.lat[inside], area[inside], earth.period)
            # From where it began all the way that it went, be it more than once round.
            gone, _ = centroid(unwrapped[inside], e.lat[inside], area[inside], earth.period)
            here = np.array([gone]), np.array([lat]), np.array([row.lon]), np.array([row.lat])
            east, north = separations(Metric(earth.latlon, earth.radius), *here)
            entry |= {
                "largest_weight": float(e.mass[inside].sum()) * constants.GRAVITY,
                "drift_east_km": float(east[0]) / 1e3,
                "drift_north_km": float(north[0]) / 1e3,
                "lon": lon,
                "lat": lat,
                **berg_reserve(e.thickness[inside], area[inside], model.parameters).as_dict(),
                **berg_edges(e, inside, p, youngs).as_dict(),
            }
        entries.append(entry)
    return entries


def collisions(model: BareModel) -> list[dict[str, Any]]:
    """Return one entry per collision of two bergs or fragments, in order of time."""
    names = {row.number: label_fragment(row.number, row.parent, row.name) for row in model.fragments.rows}
    return [
        {
            "time": (model.start + timedelta(seconds=row.time)).isoformat(),
            "end": (model.start + timedelta(seconds=row.end)).isoformat(),
            "bergs": [names.get(number, str(number)) for number in (row.first, row.second)],
            "lon": row.lon,
            "lat": row.lat,
            "speed": row.speed,
        }
        for row in model.contacts.rows
    ]


NAMED: Final = 6
"""Fragments that are listed one by one; the others together."""

LEAST: Final = 1e-3
"""Parts of a loss below this are not listed."""


def melt_by_fragment(run: xr.Dataset) -> dict[int, dict[str, float]]:
    """Return the melt water (kg) by process of each fragment that lost any, the one that lost most first."""
    if "fragment_melt_water" not in run:
        return {}
    water = run["fragment_melt_water"].transpose("fragment", "process").values
    numbers = run["fragment_number"].values
    processes = [str(name) for name in run["process"].values]
    order = np.argsort(-water.sum(axis=1), kind="stable")
    return {
        int(numbers[k]): dict(zip(processes, water[k].tolist(), strict=True))
        for k in order.tolist()
        if water[k].sum() > 0.0
    }


def melted_words(run: xr.Dataset) -> dict[int, str]:
    """Return the melt of each fragment, in words."""
    return {number: _amounts(water) for number, water in melt_by_fragment(run).items()}


def melt_lines(run: xr.Dataset) -> list[str]:
    """Return the melt of all fragments and of each of the largest losers in words; nothing where nothing melts.

    The first line counts bits that have not melted yet too, and of bergs born on the way: children of footloose calving
    and of land.
    """
    lost = melt_by_fragment(run)
    if not lost:
        return []
    every = {name: sum(water[name] for water in lost.values()) for name in next(iter(lost.values()))}
    clauses = [f"Melted: {_amounts(every)}"]
    # Ice afloat as bits at the last record; older files lack it.
    ice = float(run["ice_in_bits"].isel(time=-1).sum()) if "ice_in_bits" in run and run.sizes["time"] else 0.0
    if ice > LEAST * sum(every.values()):
        clauses.append(f"{ice / 1e12:.3g} Gt more are afloat as bits")
    lines = ["; ".join([*clauses, *_births(run)]) + "."]
    if len(lost) > 1:
        largest = list(lost.items())[:NAMED]
        rest = sum(sum(water.values()) for water in list(lost.values())[NAMED:])
        more = f"; {len(lost) - NAMED} others {rest / 1e12:.3g} Gt" if len(lost) > NAMED else ""
        from riftberg.runs.scene import Scene  # the geometry of maps

        scene = Scene(run)
        lines.append(
            "Of this " + "; ".join(f"{scene.name(number)} {_amounts(water)}" for number, water in largest) + more + "."
        )
    return lines


def _births(run: xr.Dataset) -> list[str]:
    """Return how many bergs were born after the first record without breaking off from one."""
    if not run.sizes["time"]:
        return []
    added = (run["fragment_parent"].values <= 0) & (run["fragment_birth_time"].values > run["time"].values[0])
    count, area = int(added.sum()), area_text(float(run["fragment_area"].values[added].sum()))
    return [f"{count_text(count, 'berg')} of {area} calved or added later"] if count else []


def _amounts(water: dict[str, float]) -> str:
    total = sum(water.values())
    shares = [f"{name.replace('_', ' ')} {w / 1e12:.3g}" for name, w in water.items() if w > LEAST * total]
    return f"{total / 1e12:.3g} Gt ({', '.join(shares)})"


_Number = Annotated[float, Field(gt=-LARGEST, lt=LARGEST)]
_Count = Annotated[int, Field(ge=0)]


class _Entries(BaseModel):
    """Entries of ``summary.json`` that readers use; there are more."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _BreakupEntry(_Entries):
    time: str
    lon: _Number
    lat: _Number
    area_km2: Annotated[float, Field(gt=0, lt=LARGEST)]
    bonds: _Count
    grounded: bool


class _Earth(_Entries):
    latlon: bool
    radius: _Number


class _Numerics(_Entries):
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, Any]]

    earth: _Earth


class _Summary(_Entries):
    experiment: str
    start: str
    end: str
    days: _Number
    elements: _Count
    bonds_total: _Count
    bonds_broken: _Count
    fragments: _Count
    breakups: list[_BreakupEntry]
    largest_km2: _Number
    numerics: _Numerics
    seconds_per_day: _Number | None = None


def read_summary(path: Path) -> dict[str, Any]:
    """Read ``summary.json`` and check its entries."""
    remedy = "Make the run again: 'riftberg run' writes summary.json beside run.nc"
    check_file(path, remedy="Name folders that 'riftberg run' made", most=MOST_TEXT, missing="no summary.json")
    with reading(path, "not JSON, or a damaged file", remedy):
        summary: Any = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(summary, dict):
        raise InputError("no summary of a run", where=shown(path), remedy=remedy)
    try:
        _Summary.model_validate(summary)
    except ValidationError as error:
        first = error.errors()[0]
        location = f"{shown(path)}, key {'.'.join(map(str, first['loc']))}"
        raise InputError(finding_text(first), where=location, remedy=remedy) from error
    for event in summary["breakups"]:
        read_start(event["time"], path)
    return {"seconds_per_day": None, **summary}
