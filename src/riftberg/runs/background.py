"""The water around a run, for maps: currents every few hours and the sea floor, coarsely, in the run file.

It lies in a group of its own (``background``), so that the main group of the file stays a plain trajectory file. It is for
looking at; the forces on the elements are recorded with the elements.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg import constants
from riftberg.errors import RiftbergError
from riftberg.plane import near
from riftberg.runs.positions import filled_forward, stretch, unwrap_positions
from riftberg.runs.tracks import is_channel, zonal_period
from riftberg.state import Floats
from riftberg.system.netcdf_lock import open_lazily, open_netcdf

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

    from riftberg.model import BareModel
    from riftberg.ocean.forcing import Forcing

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
