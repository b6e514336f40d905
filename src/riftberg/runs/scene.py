"""Geometry of a run for maps: shapes of the elements at chosen dates, tracks and names of the fragments, extents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from riftberg import constants
from riftberg.engines.common.rift_tips import RiftTip
from riftberg.errors import InputError
from riftberg.parameters import Packing
from riftberg.physics.floating import draft_of
from riftberg.runs.bond_history import BondHistory, read_rift_tips
from riftberg.runs.groundings import Stay, read_stays
from riftberg.runs.layout import label_fragment, run_parameters
from riftberg.runs.positions import filled_forward, read_thickness, stretch, unwrap_positions
from riftberg.runs.tracks import FLOOR_LOAD, GOES_ON, aground_in_file, by_area, read_family, zonal_period
from riftberg.state import Floats, Ints

if TYPE_CHECKING:
    import xarray as xr

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

    def grown(self, fraction: float, *, latlon: bool) -> Box:
        """Return the box with a margin of ``fraction`` of its longer side all around; ``latlon``: its units are degrees."""
        wider = stretch(0.5 * (self.south + self.north), latlon)
        margin = fraction * max(self.north - self.south, (self.east - self.west) / wider)
        wide = margin * wider
        return Box(self.west - wide, self.east + wide, self.south - margin, self.north + margin)


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
    def bonds(self) -> BondHistory:
        """Stress, strength and damage of the bonds at each record."""
        return BondHistory(self.run, self.times, self.parameters)

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

    @cached_property
    def _thickness(self) -> Floats:
        return read_thickness(self.run)

    def thickness(self, record: int) -> Floats:
        """Return the thickness (m) of the elements at a record."""
        thickness: Floats = self._thickness[min(record, len(self._thickness) - 1)]
        return thickness

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
        return read_rift_tips(self.run)

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
