"""Contents of a map, read from a run: shapes of the elements at chosen dates, tracks and names of the fragments, and the water.

The water around a run is kept coarsely in the run file: currents every few hours, and the sea floor. It lies in a group of its
own (``background``), so that the main group of the file stays a plain trajectory file. It is for looking at; the forces on the
elements are recorded with the elements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from riftberg import constants
from riftberg.engines.common.reserves import bond_strengths, reserve_lines
from riftberg.engines.common.rift_tips import RiftTip
from riftberg.errors import InputError, RiftbergError
from riftberg.parameters import Packing
from riftberg.physics.crevasses import prestress
from riftberg.physics.floating import draft_of
from riftberg.plane import near
from riftberg.runs.groundings import Stay, read_stays
from riftberg.runs.layout import label_fragment, run_parameters
from riftberg.runs.tracks import FLOOR_LOAD, GOES_ON, aground_in_file, by_area, is_channel, read_family, zonal_period
from riftberg.state import Floats, Ints
from riftberg.system.netcdf_lock import open_lazily, open_netcdf

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

    from riftberg.model import BareModel
    from riftberg.ocean.forcing import Forcing
    from riftberg.plane import ConformalPlane


def corner_offsets(packing: Packing) -> Floats:
    """Return the corners of an element of area 1, shape (corners, 2), metres east and north.

    Squares have sides along the axes. The lattice of hexagons has columns along y, so a hexagon has flat sides in the
    north and south and corners in the east and west.
    """
    if packing == "square":
        return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    angle = np.arange(6) * math.pi / 3.0
    corner = math.sqrt(2.0 / (3.0 * math.sqrt(3.0)))  # distance to a corner of a hexagon of area 1
    return corner * np.column_stack([np.cos(angle), np.sin(angle)])


def element_polygons(
    lon: Floats, lat: Floats, rotation: Floats, area: Floats, packing: Packing, *, latlon: bool, radius: float
) -> NDArray[np.float64]:
    """Return the corners of elements in the units of their positions.

    ``lon``, ``lat``: centres, degrees (metres where ``latlon`` is false) (shape (n,)); ``rotation``: angle turned since
    the start, counter-clockwise, rad (shape (n,)); ``area``: plan areas, m2 (shape (n,)); ``radius``: radius of the
    sphere, m.
    """
    offset = corner_offsets(packing)
    c, s = np.cos(rotation)[:, None], np.sin(rotation)[:, None]
    size = np.sqrt(area)[:, None]
    east = size * (c * offset[:, 0] - s * offset[:, 1])
    north = size * (s * offset[:, 0] + c * offset[:, 1])
    if latlon:
        metres = constants.DEGREE * radius
        north = north / metres
        east = east / (metres * np.cos(np.radians(lat))[:, None])
    return np.stack([lon[:, None] + east, lat[:, None] + north], axis=-1)


SMALL = 0.01
"""Fragments below this part of the area of the berg that they come from have neither track nor entry in the legend."""

MOST_BERGS = 12
"""Bergs, the largest of a run, that have them."""


@dataclass(frozen=True)
class Box:
    """Extent of a map in the units of the positions."""

    west: float
    east: float
    south: float
    north: float


def stretch(y: float, latlon: bool) -> float:
    """Return the units of x for one unit of y that make the same distance at ``y``."""
    return 1.0 / max(0.05, math.cos(math.radians(y))) if latlon else 1.0


def filled_forward(values: Floats) -> Floats:
    """Fill the records (rows) before an element is there with its first value, and those after its end with its last."""
    has_value = np.isfinite(values)
    if has_value.all():
        return values
    records = np.arange(len(values))[:, None]
    # Number of the last known record up to each record; -1 before the first.
    last = np.maximum.accumulate(np.where(has_value, records, -1), axis=0)
    first = np.argmax(has_value, axis=0)[None, :]
    filled: Floats = np.take_along_axis(values, np.where(last < 0, first, last), axis=0)
    return filled


def unwrap_positions(x: Floats, present: NDArray[np.bool_], period: float, *, goes_on: bool = False) -> Floats:
    """Put zonal positions on one branch: no element jumps by a period, and none stands a period away from the others.

    ``x``: positions without gaps (shape (time, trajectory)); ``present``: whether the element is there (shape (time,
    trajectory)); ``goes_on``: whether the positions of an element do not jump; returns positions that differ from those
    given by whole periods.
    """
    if period <= 0.0 or not x.size:
        return x
    path: Floats = x.copy() if goes_on else np.unwrap(x, period=period, axis=0)
    born = np.argmax(present, axis=0)
    path[:, born == 0] -= period * np.round((path[0, born == 0] - path[0, 0]) / period)
    # In order of birth: each newborn is put beside those that are there already.
    for record in np.unique(born[born > 0]):
        new = born == record
        others = path[record, present[record] & (born < record)]
        home = float(others.mean()) if len(others) else float(path[record, 0])
        path[:, new] -= period * np.round((path[record, new] - home) / period)
    return path


class Scene:
    """Geometry of a run for drawing.

    Shape (time, trajectory): positions ``x``, ``y``; ``berg``, the number of the fragment; ``there``, whether the element is
    there; ``areas``, plan areas in m2. ``area``: the first of them.
    """

    def __init__(self, run: xr.Dataset) -> None:
        if "parameters_json" not in run.attrs:
            raise InputError(
                "this dataset is no run of Riftberg",
                where="attribute parameters_json",
                remedy="Give what Model.run or riftberg.open_run returns",
            )
        self.run = run
        self.parameters = run_parameters(run)
        self.latlon = self.parameters.earth.latlon
        self.radius = self.parameters.earth.radius
        x, y = ("lon", "lat") if self.latlon else ("x", "y")
        east, north = (run[name].transpose("time", "trajectory").values for name in (x, y))
        self.there: NDArray[np.bool_] = np.isfinite(north)
        goes_on = run[x].attrs.get("comment") == GOES_ON
        self.x: Floats = unwrap_positions(
            filled_forward(east), self.there, zonal_period(self.parameters), goes_on=goes_on
        )
        self.y: Floats = filled_forward(north)
        berg = run["berg"].transpose("time", "trajectory").values
        self.berg: Ints = berg if self.there.all() else np.where(self.there, berg, 0).astype(np.int64)
        area = (run["length"] * run["width"]).transpose(..., "trajectory").values
        self.areas: Floats = np.broadcast_to(filled_forward(area) if area.ndim > 1 else area, self.x.shape)
        self.area = self.areas[0]
        self.times: NDArray[np.datetime64] = run["time"].values
        self.plane: ConformalPlane | None = None  # Of a polar map, on which x and y are metres

    def placed(self, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
        """Return a place, given in the units of the run, on the map."""
        return lon, lat

    @property
    def seconds(self) -> Floats:
        """Times of the records, s since the start of the run."""
        start = np.datetime64(self.run.attrs["start"])
        seconds: Floats = (self.times - start) / np.timedelta64(1, "s")
        return seconds

    @cached_property
    def unbroken(self) -> NDArray[np.bool_]:
        """Which bonds hold at each record, (time, bond)."""
        return self._holding(self.times)

    def crack_lines(self, record: int) -> list[tuple[Ints, Floats]]:
        """Crack lines at a record: bonds that each crosses (rows) in their order, and where (x, y); those it will cross, too."""
        run = self.run
        if "crack" not in run:
            return []
        first, second, fraction = run["bond_first"].values, run["bond_second"].values, run["crack_part"].values
        lines = []
        for number in np.unique(run["crack"].values[run["crack"].values > 0]):
            rows = np.flatnonzero(run["crack"].values == number)
            rows = rows[np.argsort(run["crack_order"].values[rows])]
            ends = [np.stack([self.x[record][k[rows]], self.y[record][k[rows]]], axis=-1) for k in (first, second)]
            lines.append((rows, np.asarray(ends[0] + fraction[rows, None] * (ends[1] - ends[0]))))
        return lines

    def _holding(self, moments: NDArray[np.datetime64]) -> NDArray[np.bool_]:
        """Which bonds hold at moments, (moment, bond)."""
        broken_at = self.run["break_time"].values
        holds: NDArray[np.bool_] = np.isnat(broken_at)[None, :] | (broken_at[None, :] > moments[:, None])
        return holds

    def tension(self) -> Floats:
        """Largest tensile stress (Pa) of each bond since the record before, (time, bond); 0 for bonds broken earlier.

        Files without ``peak_stress`` give the stress at the records, of the bonds that hold then.
        """
        if "peak_stress" in self.run:
            # A bond that broke since the record before had its largest stress in that interval: it still counts.
            intact = self._holding(np.r_[self.times[:1], self.times[:-1]])
            stress = self.run["peak_stress"].transpose("time", "bond").values
        else:
            intact, stress = self.unbroken, self.run["normal_stress"].transpose("time", "bond").values
        return np.where(intact & np.isfinite(stress), np.maximum(stress, 0.0), 0.0)

    def bond_damage(self) -> Floats | None:
        """Damage of the bonds at each record, (time, bond), 0 for broken ones; None in a run without damage."""
        if "damage" not in self.run:
            return None
        damage: Floats = np.nan_to_num(self.run["damage"].transpose("time", "bond").values)
        return np.where(self.unbroken, damage, 0.0)

    @cached_property
    def strengths(self) -> Floats:
        """Tensile strength (Pa) of the ice of each bond, without the factors of its rift, scatter and damage; (time, bond)."""
        first, second = self.run["bond_first"].values, self.run["bond_second"].values
        strengths = bond_strengths(self._thickness, first, second, self.parameters.kernel_values())
        return np.broadcast_to(strengths, (len(self.times), first.size))

    @cached_property
    def strength(self) -> float:
        """Lowest of them (Pa) in the run, where the ice is thickest."""
        elements = np.arange(self._thickness.shape[1])
        return float(bond_strengths(self._thickness, elements, elements, self.parameters.kernel_values()).min())

    @cached_property
    def _thickness(self) -> Floats:
        """Thickness of the elements (m): (time, trajectory), of one record alone where it does not change."""
        thickness = filled_forward(self.run["thickness"].transpose("time", "trajectory").values.astype(np.float64))
        return thickness[:1] if (thickness == thickness[:1]).all() else thickness

    def thickness(self, record: int) -> Floats:
        """Return the thickness (m) of the elements at a record."""
        thickness: Floats = self._thickness[min(record, len(self._thickness) - 1)]
        return thickness

    def prestress(self, record: int) -> Floats:
        """Return the pre-stress (Pa) of the elements at a record."""
        return prestress(self.thickness(record), self.parameters.ice.density)

    def reserves(self) -> list[str]:
        """Return pre-stress and reserve of the bergs at the start, in sentences."""
        present = self.there[0]
        numbers = self.berg[0][present]
        names = {number: self.name(number) for number in np.unique(numbers).tolist()}
        return reserve_lines(numbers, self.thickness(0)[present], self.area[present], names, self.parameters)

    def lowest_strength(self) -> Floats | None:
        """Lowest normal strength (Pa) that damage has left to a bond at each record, NaN where none holds.

        Bonds of a rift without any strength do not count. None in a run without damage.
        """
        damage = self.bond_damage()
        if damage is None:
            return None
        relative_strength = self.run["strength"].values
        left = self.strengths * relative_strength * (1.0 - damage)
        lowest = np.where(self.unbroken & (relative_strength > 0.0), left, np.inf).min(axis=1, initial=np.inf)
        return np.where(np.isfinite(lowest), lowest, np.nan)

    def grown(self, box: Box, fraction: float) -> Box:
        """Return a box with a margin of ``fraction`` of its longer side all around."""
        wider = stretch(0.5 * (box.south + box.north), self.latlon)
        margin = fraction * max(box.north - box.south, (box.east - box.west) / wider)
        wide = margin * wider
        return Box(box.west - wide, box.east + wide, box.south - margin, box.north + margin)

    def units_per_km(self) -> float:
        """Units of y in a kilometre."""
        return 1e3 / (constants.DEGREE * self.radius) if self.latlon else 1e3

    @cached_property
    def sides(self) -> Ints:
        """Sides of the elements: 4 or 6."""
        packing = 6 if self.parameters.bonds.packing == "hexagonal" else 4
        if "corners" not in self.run:
            return np.full(self.run.sizes["trajectory"], packing)
        stored = self.run["corners"]
        corners = (
            filled_forward(stored.transpose("time", "trajectory").values)[0] if "time" in stored.dims else stored.values
        )
        return np.where(corners > 0, corners, packing).astype(np.int64)

    @cached_property
    def lattice_angle(self) -> Floats:
        """Angle (rad) by which the lattice of each element was turned when its berg was made.

        From the bonds of the first record; 0 for bergs without any.
        """
        angle = np.zeros(self.run.sizes["trajectory"])
        first, second = self.run["bond_first"].values, self.run["bond_second"].values
        present = self.there[0, first] & self.there[0, second]
        first, second = first[present], second[present]
        if not len(first):
            return angle
        y = 0.5 * (self.y[0, first] + self.y[0, second])
        dx = (self.x[0, second] - self.x[0, first]) * (np.cos(np.radians(y)) if self.latlon else 1.0)
        dy = self.y[0, second] - self.y[0, first]
        turned = 0.5 * (self.rotation(0)[first] + self.rotation(0)[second])
        folds = self.sides[first]
        # Neighbours of hexagons lie at 30, 90, ... degrees, those of squares at 0, 90, ...
        rest = np.where(folds == 6, math.pi / 6.0, 0.0)
        # The mean of an angle that comes again after a turn by 2 pi / folds.
        phase = np.exp(1j * folds * (np.arctan2(dy, dx) - turned - rest))
        for number in np.unique(self.berg[0]):
            rows = self.berg[0, first] == number
            if rows.any():
                angle[self.berg[0] == number] = float(np.angle(phase[rows].mean())) / int(folds[rows][0])
        return angle

    def rotation(self, record: int) -> Floats:
        """Return the angles the elements have turned (rad)."""
        return np.nan_to_num(self.run["rotation"].isel(time=record).values.astype(np.float64))

    def polygons(self, record: int) -> Floats:
        """Return the corners of all elements at a record, shape (elements, corners, 2).

        Where bergs of both packings are in a run, squares repeat corners to have as many as hexagons.
        """
        x, y = np.where(self.there[record], self.x[record], np.nan), self.y[record]
        turned, area = self.rotation(record) + self.lattice_angle, self.areas[record]
        most = int(self.sides.max(initial=4))
        corners = np.empty((x.size, most, 2))
        kinds: tuple[tuple[int, Packing], ...] = ((4, "square"), (6, "hexagonal"))
        for sides, packing in kinds:
            rows = self.sides == sides
            if rows.any():
                polygons = element_polygons(
                    x[rows], y[rows], turned[rows], area[rows], packing, latlon=self.latlon, radius=self.radius
                )
                corners[rows] = polygons[:, np.minimum(np.arange(most), sides - 1)]
        return corners

    @cached_property
    def numbers(self) -> list[int]:
        """Numbers of the fragments that are large enough to be named, largest first at the end of the run; at least one."""
        sizes: dict[int, float] = {}
        # Three moments are enough to find all that were ever large, and cheap in long runs.
        for record in sorted({0, len(self.times) // 2, len(self.times) - 1}):
            for number, area in self.fragment_areas(record).items():
                sizes[number] = area
        ranked = sorted(sizes, key=lambda n: (-sizes[n], n))
        large = set(sorted(self.berg_areas, key=lambda n: (-self.berg_areas[n], n))[:MOST_BERGS])
        berg_area = {n: self.berg_areas.get(self.origin(n), 0.0) for n in ranked}
        large_enough = [
            n for n in ranked if sizes[n] >= SMALL * berg_area[n] and self.origin(n) in large - self.children
        ]
        return large_enough or ranked[:1]

    @cached_property
    def children(self) -> set[int]:
        """Numbers of small bergs that were born on the way, as by footloose calving: they are drawn and not named."""
        least = SMALL * max(self.berg_areas.values(), default=0.0)
        started = set(np.unique(self.berg[0]).tolist())
        return {number for number, area in self.berg_areas.items() if number not in started and area < least}

    @cached_property
    def berg_areas(self) -> dict[int, float]:
        """Plan area (m2) of each berg that was there at the start or came later, by its number, as it was then."""
        return {number: float(row["area"]) for number, row in self.family.items() if row["parent"] <= 0}

    @cached_property
    def family(self) -> dict[int, dict[str, Any]]:
        """Data of each berg and fragment in the file, by its number."""
        return read_family(self.run)

    def parent(self, number: int) -> int:
        """Return the number of the fragment that one broke off; 0 for a berg, and for a number that is not in the file."""
        return int(self.family[number]["parent"]) if number in self.family else 0

    def origin(self, number: int) -> int:
        """Return the number of the berg that a fragment comes from; itself for a berg."""
        seen = {number}
        # A damaged file may hold a circle of parents.
        while (parent := self.parent(number)) > 0 and parent not in seen:
            seen.add(parent)
            number = parent
        return number

    def name(self, number: int) -> str:
        """Return a berg or fragment in words: its name, or its number."""
        return label_fragment(number, self.parent(number), str(self.family.get(number, {}).get("name", "")))

    def fragment_areas(self, record: int) -> dict[int, float]:
        """Return the plan area (m2) of each fragment at a record by its number, the largest first."""
        present = self.there[record]
        return by_area(self.berg[record][present], self.areas[record][present])

    def final_area(self, number: int) -> float:
        """Return the area (m2) of a fragment at the last record."""
        return float(self.areas[-1][self.berg[-1] == number].sum())

    def track(self, number: int) -> tuple[Floats, Floats, Ints]:
        """Return the centroid of a fragment at all records at which it exists, and the numbers of these records."""
        weight = np.where(self.berg == number, self.areas, 0.0)
        total = weight.sum(axis=1)
        records = np.flatnonzero(total > 0.0)
        x = (weight * self.x).sum(axis=1)[records] / total[records]
        y = (weight * self.y).sum(axis=1)[records] / total[records]
        return x, y, records

    def track_line(self, number: int, until: int | None = None) -> tuple[Floats, Floats]:
        """Return the track of a fragment as a line to draw, up to a record.

        There is a gap (NaN) where the fragment lost or gained a part that is large enough to be named, or was away:
        the centroid jumps there, and no ice moved along that jump.
        """
        x, y, records = self.track(number)
        # With the areas that the elements had first: ice that melts bit by bit does not make the centroid jump.
        area = np.where(self.berg[records] == number, self.area, 0.0).sum(axis=1)
        jumps = (np.abs(np.diff(area)) > SMALL * area[:-1]) | (np.diff(records) > 1)
        if until is not None:
            before_end = records <= until
            x, y, jumps = x[before_end], y[before_end], jumps[before_end[1:]]
        gaps = np.flatnonzero(jumps) + 1
        return np.insert(x, gaps, np.nan), np.insert(y, gaps, np.nan)

    @cached_property
    def has_floor(self) -> bool:
        """Whether the sea floor acts on the ice at all in this run."""
        p = self.parameters.kernel_values()
        bed = self.parameters.grounding.law == "seabed"
        return not p.only_interactions and bool(bed or p.ground_coefficient > 0.0 or p.ground_quadratic > 0.0)

    def chosen_records(self, count: int) -> list[int]:
        """Return records from the first to the last, evenly spaced, on whole days where the run is long enough."""
        seconds = self.seconds - self.seconds[0]
        moments = np.linspace(0.0, seconds[-1], min(count, len(seconds)))
        day = constants.SECONDS_PER_DAY
        if seconds[-1] >= count * day:
            moments[1:-1] = day * np.round(moments[1:-1] / day)
        return sorted({int(np.argmin(np.abs(seconds - moment))) for moment in moments})

    def telling_records(self, count: int) -> list[int]:
        """Return the first and the last record, those 6 h after large break-ups, and evenly spaced ones between."""
        births = [birth[0] + np.timedelta64(6, "h") for n in self.numbers if (birth := self.birth(n)) is not None]
        after = [int(np.argmin(np.abs(self.times - birth))) for birth in births]
        records = {0, len(self.times) - 1, *after[: count - 2]}
        spacing = len(self.times) / (2.5 * count)
        for record in self.chosen_records(count):
            if len(records) < count and all(abs(record - other) >= spacing for other in records):
                records.add(record)
        return sorted(records)

    def shape(self, margin: float) -> float:
        """Return width over height of the extent of the run on the ground, with a margin of a part of the longer side."""
        box = self.box()
        wide, high = (box.east - box.west) / stretch(0.5 * (box.south + box.north), self.latlon), box.north - box.south
        more = 2.0 * margin * max(wide, high)
        return (wide + more) / (high + more)

    def box(self, record: int | None = None) -> Box:
        """Return the extent of bergs and named fragments, at a record or over the whole run."""
        chosen = range(0, len(self.times), max(1, len(self.times) // 50)) if record is None else [record]
        # A map of one date is about the bergs, one of the whole run about their children too.
        fragments = (
            [*self.numbers, *self.berg_areas]
            if record is None
            else [*self.numbers, *self.berg_areas.keys() - self.children]
        )
        rows = [np.isin(self.berg[k], fragments) for k in (*chosen, -1 if record is None else record)]
        # A berg that shattered has no fragment with a name; then all of its elements count.
        rows = [row if row.any() else ~row for row in rows]
        x = np.concatenate([self.x[k][r] for k, r in zip((*chosen, chosen[-1]), rows, strict=True)])
        y = np.concatenate([self.y[k][r] for k, r in zip((*chosen, chosen[-1]), rows, strict=True)])
        half = 0.5 * math.sqrt(float(self.area.max())) / 1e3 * self.units_per_km()
        wide = half * stretch(float(y.mean()), self.latlon)
        return Box(x.min() - wide, x.max() + wide, y.min() - half, y.max() + half)

    def aground(self, records: Sequence[int] | None = None) -> NDArray[np.bool_]:
        """Return which elements the sea floor acts on, at some records or at all: shape (records, elements)."""
        names = ["thickness", "depth", *([FLOOR_LOAD] if FLOOR_LOAD in self.run else [])]
        state = self.run[names].transpose("time", "trajectory")
        if records is not None:
            state = state.isel(time=list(records))
        thickness, depth = (state[name].values.astype(np.float64) for name in ("thickness", "depth"))
        return aground_in_file(
            thickness, depth, state[FLOOR_LOAD].values if FLOOR_LOAD in state else None, self.parameters
        )

    @cached_property
    def rift_tips(self) -> list[RiftTip]:
        """Tips of rifts that stand at the end of the run."""
        run = self.run
        if "rift_tip_crack" not in run:
            return []
        coordinates = {} if "rift_tip_lon" in run else {"lon": "x", "lat": "y"}
        columns = [
            run[f"rift_tip_{coordinates.get(name, name)}"].values.tolist() for name in RiftTip.__dataclass_fields__
        ]
        return [RiftTip(int(crack), *values) for crack, *values in zip(*columns, strict=True) if crack > 0]

    @cached_property
    def stays(self) -> list[Stay]:
        """Stays of bergs and fragments on the sea floor, in order of time."""
        return read_stays(self.run, self.name)

    def draft(self) -> float:
        """Return the draft (m) of the thickest element at the start."""
        thickness = float(self.run["thickness"].isel(time=0).max())
        return float(draft_of(thickness, self.parameters.ice.density))

    def ancestor(self, number: int, record: int) -> int:
        """Return the fragment of which this one was a part at a record: itself once it is there."""
        seen = {number}
        while not (self.berg[record] == number).any():
            parent = self.parent(number)
            if parent <= 0 or parent in seen:
                break
            number = parent
            seen.add(number)
        return number

    def birth(self, number: int) -> tuple[np.datetime64, bool] | None:
        """Return when a fragment broke off and whether aground; None for a berg of the start."""
        if self.parent(number) <= 0:
            return None
        row = self.family[number]
        return row["birth_time"], bool(row["grounded"])


# ---- the water around a run --------------------------------------------------------------------------------------------

GROUP: Final = "background"
POINTS: Final = 56
"""Points of the currents along the longer side of the map."""

FLOOR_POINTS: Final = 420
"""Points of the sea floor along the longer side."""

INTERVAL: Final = 21_600.0
"""Seconds between two currents."""

MOST_TIMES: Final = 80
"""Largest number of currents; a longer run has them at longer intervals."""

_KEPT: Final = "water"
"""Place in the encoding of a run in memory."""

_SILENT: Final = (RiftbergError, AttributeError, NotImplementedError)
"""Errors of a forcing that cannot be asked for maps."""

_MARGIN: Final = 0.3
_HEIGHT = 0.85
"""Least height of the box over the width of the drawn area, before it is widened."""
_SQUARE = 1.35
"""Side of the square around the berg at a record over its length: more than maps of single dates show."""
_SHAPE = 2.0
"""Least width of the box over its height: screens are wide."""


def add_background(run: netCDF4.Dataset, model: BareModel) -> None:
    """Add the background to an open run file that has all its records; none where the forcing cannot be asked for maps."""
    seconds = np.asarray(run["time"][:])
    names = ("lon", "lat") if "lon" in run.variables else ("x", "y")
    x, y = (run[name][:].astype(np.float64).T for name in names)
    units = {axis: str(run[name].units) for axis, name in zip(("time", "x", "y"), ("time", *names))}
    # A track that crosses the seam must not make a box around the whole Earth.
    period, goes_on = zonal_period(model.parameters), is_channel(model.parameters)
    x = unwrap_positions(filled_forward(x), np.isfinite(y), period, goes_on=goes_on)
    axes, fine = (_axes(x, filled_forward(y), names[0] == "lon", points) for points in (POINTS, FLOOR_POINTS))
    length = float(seconds[-1] - seconds[0])
    count = min(MOST_TIMES, max(1, round(length / INTERVAL))) + 1
    times = np.linspace(seconds[0], seconds[-1], count if length > 0.0 else 1)
    try:
        currents = [model.forcing.currents(*np.meshgrid(*axes), float(t)) for t in times]
        depth = model.forcing.depth(*np.meshgrid(*fine))
    except _SILENT:
        return  # a picture without water is better than no run
    if np.isfinite(np.array(currents)).any() or np.isfinite(depth).any():
        _write_background(run.createGroup(GROUP), axes, fine, times, np.array(currents), np.asarray(depth), units)


def _axes(x: Floats, y: Floats, latlon: bool, points: int) -> tuple[Floats, Floats]:
    """Return the axes of a grid around all positions (record, element) of a run.

    The box holds a square around the berg at each record, for the maps of single dates are squares.
    """
    south, north, west, east = (float(f(a)) for a in (y, x) for f in (np.nanmin, np.nanmax))
    wider = stretch(0.5 * (south + north), latlon)
    smallest = 20e3 / (constants.DEGREE * constants.EARTH_RADIUS_KID) if latlon else 20e3
    margin = _MARGIN * max(north - south, (east - west) / wider, smallest)
    (low_x, high_x), (low_y, high_y) = ((np.nanmin(a, axis=1), np.nanmax(a, axis=1)) for a in (x, y))
    across, along = (high_x - low_x) / wider, high_y - low_y
    half = _SQUARE * 0.5 * float(np.maximum(across, along).max())
    middle_x, middle_y = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y)
    south = min(south - margin, float(middle_y.min()) - half)
    north = max(north + margin, float(middle_y.max()) + half)
    west = min(west - margin * wider, float(middle_x.min()) - half * wider)
    east = max(east + margin * wider, float(middle_x.max()) + half * wider)
    # The map of the drift is about as high as it is wide.
    short = 0.5 * max(0.0, _HEIGHT * (east - west) / wider - (north - south))
    south, north = south - short, north + short
    wide = max(east - west, _SHAPE * (north - south) * wider)
    if latlon:
        wide = min(wide, 350.0)
    west, east = 0.5 * (west + east - wide), 0.5 * (west + east + wide)
    if latlon:
        south, north = max(south, -89.9), min(north, 89.9)
    step = max(north - south, (east - west) / wider) / (points - 1)
    count = [max(2, round(length / step) + 1) for length in ((east - west) / wider, north - south)]
    return np.linspace(west, east, count[0]), np.linspace(south, north, count[1])


def _write_background(
    group: Any, axes: tuple[Floats, Floats], fine: tuple[Floats, Floats], times: Floats, currents: Floats,
    depth: Floats, units: dict[str, str],
) -> None:  # fmt: skip
    group.comment = "coarse picture of the forcing, for maps"
    sizes = {"time": times, "y": axes[1], "x": axes[0], "floor_y": fine[1], "floor_x": fine[0]}
    for name, values in sizes.items():
        group.createDimension(name, len(values))
        variable = group.createVariable(name, "f8", (name,), fletcher32=True)
        variable.units = units[name.removeprefix("floor_")]
        variable[:] = values
    options = {"compression": "zlib", "complevel": 4, "shuffle": True, "fill_value": np.float32(np.nan)}
    options["fletcher32"] = True
    for k, (name, standard) in enumerate(
        (("uo", "eastward_sea_water_velocity"), ("vo", "northward_sea_water_velocity"))
    ):
        # 1 mm/s is finer than any arrow; rounding makes the file small.
        variable = group.createVariable(name, "f4", ("time", "y", "x"), **options)
        variable.setncatts({"units": "m s-1", "standard_name": standard})
        variable[:] = np.round(currents[:, k], 3)
    variable = group.createVariable("depth", "f4", ("floor_y", "floor_x"), **options)
    variable.setncatts({"units": "m", "standard_name": "sea_floor_depth_below_sea_surface"})
    variable[:] = np.round(depth, 1)


class StoredWater:
    """Currents and sea floor of a run, as far as its file keeps them; offers the methods of a forcing that maps call."""

    def __init__(self, background: xr.Dataset) -> None:
        self.x: Floats = background["x"].values
        self.y: Floats = background["y"].values
        self.times: Floats = background["time"].values
        self.u: Floats = background["uo"].values
        self.v: Floats = background["vo"].values
        self.floor_x: Floats = background["floor_x"].values
        self.floor_y: Floats = background["floor_y"].values
        self.floor: Floats = background["depth"].values
        self.degrees = str(background["x"].attrs.get("units", "")).startswith("degree")

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at points, ``time`` seconds after the start; NaN outside the stored box."""
        # Before the first and after the last record the nearest one holds.
        upper = int(np.clip(np.searchsorted(self.times, time), 1, max(1, len(self.times) - 1)))
        lower = upper - 1
        if len(self.times) == 1:
            return self._at(self.u[0], lon, lat), self._at(self.v[0], lon, lat)
        weight = float(np.clip((time - self.times[lower]) / (self.times[upper] - self.times[lower]), 0.0, 1.0))
        u, v = ((1.0 - weight) * field[lower] + weight * field[upper] for field in (self.u, self.v))
        return self._at(u, lon, lat), self._at(v, lon, lat)

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at points; NaN outside the stored box."""
        return interpolate_evenly(self.floor_x, self.floor_y, self.floor, self._near(lon), np.asarray(lat))

    def _at(self, field: Floats, lon: Floats, lat: Floats) -> Floats:
        return interpolate_evenly(self.x, self.y, field, self._near(lon), np.asarray(lat))

    def _near(self, lon: Floats) -> Floats:
        """Bring longitudes to the branch of the stored ones."""
        lon = np.asarray(lon, np.float64)
        middle = 0.5 * (self.x[0] + self.x[-1])
        return near(lon, middle) if self.degrees else lon


def interpolate_evenly(x_axis: Floats, y_axis: Floats, field: Floats, x: Floats, y: Floats) -> Floats:
    """Interpolate on an even grid; NaN outside and beside missing values.

    ``field``:  (shape (len(y_axis)).
    """
    fx = (x - x_axis[0]) / (x_axis[1] - x_axis[0])
    fy = (y - y_axis[0]) / (y_axis[1] - y_axis[0])
    # The last point of an even axis may be missed by round-off.
    small = 1e-9
    inside = (fx >= -small) & (fx <= len(x_axis) - 1 + small) & (fy >= -small) & (fy <= len(y_axis) - 1 + small)
    i = np.clip(np.floor(np.where(inside, fx, 0.0)).astype(int), 0, len(x_axis) - 2)
    j = np.clip(np.floor(np.where(inside, fy, 0.0)).astype(int), 0, len(y_axis) - 2)
    a, b = fx - i, fy - j
    low = (1.0 - a) * field[j, i] + a * field[j, i + 1]
    high = (1.0 - a) * field[j + 1, i] + a * field[j + 1, i + 1]
    return np.where(inside, (1.0 - b) * low + b * high, np.nan)


def stored_water(run: xr.Dataset | str | Path) -> StoredWater | None:
    """Return the background of a run file, or None where it has none."""
    source = run if isinstance(run, str | Path) else run.encoding.get("source")
    if source is None or not Path(source).exists():
        return None
    with open_netcdf(source) as file:
        if GROUP not in file.groups:
            return None
    with open_lazily(source, group=GROUP, decode_times=False) as background:
        return StoredWater(background.load())


class KeptWater:
    """Forcing of a run that lives in memory alone, as maps need it; NaN where it has no answer.

    Copies of the run share it; a pickled run does without.
    """

    def __init__(self, forcing: Forcing | None = None) -> None:
        self._forcing = forcing

    def __deepcopy__(self, memo: object) -> KeptWater:
        """Return itself: a forcing may hold open files."""
        return self

    def __reduce__(self) -> tuple[type[KeptWater], tuple[()]]:
        """Leave the forcing behind."""
        return KeptWater, ()

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at points, ``time`` seconds after the start."""
        try:
            return self._forcing.currents(lon, lat, time)  # type: ignore[union-attr]
        except _SILENT:
            nothing = np.full(np.shape(lon), np.nan)
            return nothing, nothing

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at points."""
        try:
            return self._forcing.depth(lon, lat)  # type: ignore[union-attr]
        except _SILENT:
            return np.full(np.shape(lon), np.nan)


def keep_water(run: xr.Dataset, forcing: Forcing) -> None:
    """Let maps of a run that lives in memory alone ask its forcing."""
    run.encoding[_KEPT] = KeptWater(forcing)


def find_water(run: xr.Dataset) -> KeptWater | StoredWater | None:
    """Return the water around a run, as far as it is stored, or None."""
    water = run.encoding.get(_KEPT)
    return water if isinstance(water, KeptWater) else stored_water(run)
