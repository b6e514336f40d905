"""How far two runs are apart: distance, heading, area and break-ups of the same berg in both, by time.

A run is read from its elements, a member of a sweep from the tracks that ``sweep.nc`` holds, which have no heading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError, nearest
from riftberg.ocean.grid import haversine
from riftberg.runs.checks import parameters_of
from riftberg.runs.tracks import tracks_of
from riftberg.state import Floats
from riftberg.system.input_files import value_shown

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Course:
    """One berg of a run over time, with the pieces that broke off any berg of the run."""

    berg: str  # Its name, empty for none
    times: NDArray[np.datetime64]
    x: Floats  # Centroid, degrees or m; no jump at the date line
    y: Floats
    azimuth: Floats  # Long axis, degrees clockwise from north, 0 to 180; NaN where unknown
    area: Floats  # m2
    births: list[dict[str, Any]]  # As break-ups in ``summary.json``, in order of time
    latlon: bool
    radius: float  # Of the sphere, m

    def at(self, times: NDArray[np.datetime64]) -> tuple[Floats, Floats, Floats, Floats]:
        """Return position, long axis and area at some times, linear between records; NaN outside of them."""
        mine, wanted = (t.astype("datetime64[ms]").astype(np.float64) for t in (self.times, times))
        x, y, area = (np.interp(wanted, mine, a, np.nan, np.nan) for a in (self.x, self.y, self.area))
        known = np.isfinite(self.azimuth)
        azimuth = np.full(times.shape, np.nan)
        if known.any():
            turning = np.unwrap(self.azimuth[known], period=180.0)
            azimuth = np.interp(wanted, mine[known], turning, np.nan, np.nan) % 180.0
        return x, y, azimuth, area


def course_of(run: xr.Dataset, berg: str | None = None) -> Course:
    """Return the course of a berg of a run, or of one member of a sweep: the one of a name, or the largest at the start."""
    if "parameters_json" not in run.attrs or ("member" in run.dims):
        raise InputError(
            f"{value_shown(run)} is no run", where="compare",
            remedy="Give what Model.run or riftberg.open_run return, or open_sweep(path).isel(member=3)",
        )  # fmt: skip
    earth = parameters_of(run).earth
    x, y = ("lon", "lat") if earth.latlon else ("x", "y")
    if "member" in run.coords:
        start = np.flatnonzero(run["fragment_parent"].values == 0.0)
        rows = start[np.argsort(-run["fragment_area"].values[start], kind="stable")]
        if not rows.size:
            raise InputError("the member has no tracks: it failed or was not run", where="compare")
        one = run.isel(fragment=rows[0])
        there = np.isfinite(one[x].values)
        tracks, name, azimuth = one.isel(time=there), "", np.full(int(there.sum()), np.nan)
    else:
        table = tracks_of(run)
        ends = np.cumsum(table["rowsize"].values)
        names, parents = (table[n].values.tolist() for n in ("name", "parent"))
        bergs = [k for k, parent in enumerate(parents) if parent <= 0]
        named = [k for k in bergs if names[k] == berg]
        if berg is not None and not named:
            known = [names[k] for k in bergs if names[k]]
            raise InputError(
                f"no berg {berg!r}", where="compare, berg",
                remedy=f"{nearest(berg, known)}Bergs are {', '.join(known) or 'without names'}",
            )  # fmt: skip
        row = max(named or bergs, key=lambda k: (float(table["area"].values[ends[k] - table["rowsize"].values[k]]), -k))
        tracks = table.isel(index=slice(int(ends[row] - table["rowsize"].values[row]), int(ends[row])))
        name, azimuth = names[row], tracks["azimuth"].values.astype(float)
    lon = np.unwrap(tracks[x].values, period=360.0) if earth.latlon else tracks[x].values
    return Course(
        name, tracks["time"].values, lon, tracks[y].values, azimuth, tracks["area"].values.astype(float),
        _births(run, x, y), earth.latlon, earth.radius,
    )  # fmt: skip


def _births(run: xr.Dataset, x: str, y: str) -> list[dict[str, Any]]:
    """Return the break-ups of a run."""
    columns = ("parent", "birth_time", x, y, "area", "bonds_broken", "grounded")
    rows = zip(*(run[f"fragment_{name}"].values.tolist() for name in columns), strict=True)
    dates = run["fragment_birth_time"].values.astype("datetime64[s]").astype(str)
    found = [
        {"time": date, "lon": lon, "lat": lat, "area_km2": area / 1e6, "bonds": int(bonds), "grounded": bool(ground)}
        for date, (parent, _, lon, lat, area, bonds, ground) in zip(dates, rows, strict=True) if parent > 0
    ]  # fmt: skip
    return sorted(found, key=lambda event: event["time"])


def apart(one: Course, other: Course) -> dict[str, NDArray[Any]]:
    """Return what differs between two courses at the records of the first that both have.

    ``time``; ``distance`` (m); ``rotation`` of the long axis, second less first (degrees, -90 to 90); ``area_first`` and
    ``area_second`` (m2).
    """
    if one.latlon != other.latlon:
        raise InputError("one run is in degrees, the other in metres", where="compare", remedy="Give two of a kind")
    shared = one.times[(one.times >= other.times[0]) & (one.times <= other.times[-1])]
    if not shared.size:
        spans = " and ".join(f"{str(c.times[0])[:16]} to {str(c.times[-1])[:16]}" for c in (one, other))
        raise InputError(f"the runs have no date in common: {spans}", where="compare", remedy="Give runs that overlap")
    (x1, y1, turn1, area1), (x2, y2, turn2, area2) = one.at(shared), other.at(shared)
    distance = haversine(x1, y1, x2, y2, one.radius) if one.latlon else np.hypot(x2 - x1, y2 - y1)
    rotation = (turn2 - turn1 + 90.0) % 180.0 - 90.0
    found = {"distance": np.asarray(distance), "rotation": rotation, "area_first": area1, "area_second": area2}
    return {"time": shared, **found}


def shown_records(times: NDArray[np.datetime64]) -> list[int]:
    """Return the records that a table shows: on whole days after the first, at most a dozen, and the last."""
    days = (times - times[0]) / np.timedelta64(1, "D")
    step = float(np.ceil(days[-1] / 12.0)) if days[-1] > 2.0 else float(days[-1]) / 6.0
    wanted = np.arange(0.0, days[-1], step) if step else np.zeros(1)
    return sorted({len(days) - 1, *(int(np.argmin(np.abs(days - day))) for day in wanted)})
