"""The most used tables of a run: bergs, fragments and elements, as ``run.riftberg`` of an `xarray.Dataset`.

How far two runs are apart by time is found from the courses of the same berg in both: of a run from its elements, of a
member of a sweep from the tracks that ``sweep.nc`` holds, which have no heading.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import InputError, nearest
from riftberg.ocean.grid import haversine
from riftberg.plane import near
from riftberg.runs.layout import label_fragment, run_parameters
from riftberg.runs.tracks import GOES_ON, axis_difference, build_tracks, is_channel, zonal_period
from riftberg.state import Floats
from riftberg.system.input_files import value_shown


class Table:
    """A dataset with a data frame and a picture that suit it; it forwards everything else to the dataset."""

    picture = ""

    def __init__(self, dataset: xr.Dataset, run: xr.Dataset) -> None:
        self.dataset, self._run = dataset, run

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the dataset."""
        if name.startswith("__") or name == "dataset":
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def __getitem__(self, name: Any) -> Any:
        """Return a variable of the dataset."""
        return self.dataset[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether the dataset has a variable."""
        return name in self.dataset

    def __iter__(self) -> Iterator[Hashable]:
        """Give the names of the variables."""
        return iter(self.dataset)

    def __dir__(self) -> list[str]:
        """List the names of the dataset too."""
        return sorted({*super().__dir__(), *dir(self.dataset)})

    def __repr__(self) -> str:
        return repr(self.dataset)

    def _repr_html_(self) -> str:
        return self.dataset._repr_html_()

    def to_dataframe(self) -> Any:
        """Return the table as a data frame."""
        return self.dataset.to_dataframe()

    def plot(self, *args: Any, **options: Any) -> Any:
        """Draw the picture of the table; arguments as for ``riftberg.draw_tracks`` and its like."""
        # The package offers pictures by name; runs are below them.
        return getattr(importlib.import_module("riftberg"), self.picture)(self._run, *args, **options)


class Tracks(Table):
    """Bergs and fragments over time: a CF contiguous ragged array, one after the other along ``index``."""

    picture = "draw_tracks"

    def to_dataframe(self) -> Any:
        """Return one row for each berg or fragment and time, indexed by both: ``.loc["A68a"]`` is the track of one."""
        import pandas as pd  # type: ignore[import-untyped]

        tracks, size = self.dataset, self.dataset["rowsize"].values
        names = [
            label_fragment(*row)
            for row in zip(*(tracks[k].values.tolist() for k in ("trajectory", "parent", "name")), strict=True)
        ]
        index = pd.MultiIndex.from_arrays(
            [np.repeat(np.array(names, object), size), tracks["time"].values], names=["berg", "time"]
        )
        columns = {str(name): v.values for name, v in tracks.data_vars.items() if v.dims == ("index",)}
        return pd.DataFrame(columns, index=index)


class Fragments(Table):
    """The family tree: one entry for each berg and fragment, with its birth."""

    picture = "draw_fragments"


class ElementTable(Table):
    """The elements over time."""

    picture = "draw_map"


@xr.register_dataset_accessor("riftberg")  # type: ignore[no-untyped-call]
class RunAccessor:
    """A run by bergs, by fragments and by elements.

    Attributes
    ----------
    tracks : Tracks
        Bergs and fragments over time: position, velocity, spin, area, mass, length, width, azimuth, largest stress over
        strength, aground or not.
    fragments : Fragments
        The family tree, with date, place and size of each birth.
    elements : ElementTable
        The elements over time.

    Examples
    --------
    >>> run = riftberg.open_run("riftberg-out/a68a")        # doctest: +SKIP
    >>> run.riftberg.tracks.to_dataframe()                  # doctest: +SKIP
    >>> run.riftberg.tracks.plot("tracks.png")              # doctest: +SKIP
    """

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run
        self._tracks: tuple[Mapping[Hashable, Any], Tracks] | None = None

    @property
    def tracks(self) -> Tracks:
        """Bergs and fragments over time, made from the elements of this dataset; so a part of a run has its own."""
        variables = dict(self._run.variables)
        # xarray keeps this accessor with the dataset, whose variables may be replaced.
        if self._tracks is None or not _same(self._tracks[0], variables):
            self._tracks = variables, Tracks(build_tracks(self._run), self._run)
        return self._tracks[1]

    def compare(self, other: xr.Dataset, berg: str | None = None) -> xr.Dataset:
        """Compare a berg of this run with the same berg of another run.

        Parameters
        ----------
        other : xarray.Dataset
            Another run, or a member of a sweep: ``riftberg.open_sweep(path).isel(member=3)``.
        berg : str, optional
            Name of the berg; by default the largest at the start of each run.

        Returns
        -------
        xarray.Dataset
            At the dates of this run that both have: ``distance`` of the centroids (m), ``rotation`` of the long axis
            (degrees, clockwise, NaN for members of a sweep), ``area`` of both (m2); and date and area of the break-ups, the
            same event of both in one column.

        Raises
        ------
        InputError
            If the runs have no date in common, or no such berg.
        """
        courses = [find_course(run, berg) for run in (self._run, other)]
        by_time = compare_courses(*courses)
        earth = {name: getattr(courses[0], name) for name in ("latlon", "radius", "period")}
        events = align_breakups([course.births for course in courses], earth)

        def column(key: str, missing: Any) -> list[list[Any]]:
            return [[missing if event is None else event[key] for event in row] for row in events]

        area = np.array([by_time["area_first"], by_time["area_second"]])
        dates = np.array(column("time", "NaT"), "datetime64[ns]").reshape(2, -1)
        sizes = 1e6 * np.array(column("area_km2", np.nan), float).reshape(2, -1)
        return xr.Dataset(
            {
                "distance": ("time", by_time["distance"], {"units": "m", "long_name": "distance between the centroids"}),
                "rotation": ("time", by_time["rotation"], {
                    "units": "degrees",
                    "long_name": "angle from the long axis in the first run to that in the second, clockwise",
                }),
                "area": (("run", "time"), area, {"units": "m2", "long_name": "plan area"}),
                "breakup_time": (("run", "breakup"), dates, {"long_name": "date of the same break-up in both runs"}),
                "breakup_area": (("run", "breakup"), sizes, {"units": "m2", "long_name": "area that broke off"}),
            },
            {"time": by_time["time"], "run": ["first", "second"]}, {"berg": courses[0].berg},
        )  # fmt: skip

    @property
    def fragments(self) -> Fragments:
        """The family tree of bergs and fragments."""
        run = self._run
        names = [
            str(name) for name in run.variables if str(name).startswith("fragment_") and run[name].dims == ("fragment",)
        ]
        table = run[names].rename({name: name.removeprefix("fragment_") for name in names}).reset_coords()
        return Fragments(table.set_coords("number").swap_dims(fragment="number"), run)

    @property
    def elements(self) -> ElementTable:
        """The elements over time."""
        run = self._run
        along = {"trajectory"}, {"trajectory", "time"}
        names = [name for name, v in run.data_vars.items() if set(v.dims) in along]
        return ElementTable(run[names].rename(trajectory="element"), run)


def _same(first: Mapping[Hashable, Any], second: Mapping[Hashable, Any]) -> bool:
    """Whether two datasets share their variables, none of them replaced by another."""
    return first.keys() == second.keys() and all(first[name] is second[name] for name in first)


# ---- the same berg of two runs ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Course:
    """One berg of a run over time, with the pieces that broke off any berg of the run."""

    berg: str  # Its name, empty for none
    times: NDArray[np.datetime64]
    x: Floats  # Centroid, degrees or m; no jump at the date line or the end of a channel, however often it went round
    y: Floats
    azimuth: Floats  # Long axis, degrees clockwise from north, 0 to 180; NaN where unknown
    area: Floats  # m2
    births: list[dict[str, Any]]  # As break-ups in ``summary.json``, in order of time
    latlon: bool
    radius: float  # Of the sphere, m
    period: float = 0.0  # Length of a periodic channel, m; 0 for none

    def at(self, times: NDArray[np.datetime64]) -> tuple[Floats, Floats, Floats, Floats]:
        """Return position, long axis and area at some times, linear between records; NaN outside of them."""
        record_seconds, query_seconds = (t.astype("datetime64[ms]").astype(np.float64) for t in (self.times, times))
        x, y, area = (np.interp(query_seconds, record_seconds, a, np.nan, np.nan) for a in (self.x, self.y, self.area))
        has_azimuth = np.isfinite(self.azimuth)
        azimuth = np.full(times.shape, np.nan)
        if has_azimuth.any():
            turning = np.unwrap(self.azimuth[has_azimuth], period=180.0)
            azimuth = np.interp(query_seconds, record_seconds[has_azimuth], turning, np.nan, np.nan) % 180.0
        return x, y, azimuth, area


def own_dates(member: xr.Dataset) -> NDArray[np.datetime64]:
    """Return the dates of the tracks of a member; where a sweep varies ``start``, ``time`` has the dates of member 0."""
    later = 1e9 * float(member["start_after"]) if "start_after" in member.coords else 0.0
    return np.asarray(member["time"].values.astype("datetime64[ns]") + np.timedelta64(round(later), "ns"))


def find_course(run: xr.Dataset, berg: str | None = None) -> Course:
    """Return the course of a berg of a run, or of one member of a sweep: the one of a name, or the largest at the start."""
    if "parameters_json" not in run.attrs or ("member" in run.dims):
        raise InputError(
            f"{value_shown(run)} is no run", where="compare",
            remedy="Give what Model.run or riftberg.open_run return, or open_sweep(path).isel(member=3)",
        )  # fmt: skip
    earth = run_parameters(run).earth
    x, y = ("lon", "lat") if earth.latlon else ("x", "y")
    if "member" in run.coords:
        start = np.flatnonzero(run["fragment_parent"].values == 0.0)
        rows = start[np.argsort(-run["fragment_area"].values[start], kind="stable")]
        if not rows.size:
            raise InputError("the member has no tracks: it failed or was not run", where="compare")
        fragment = run.isel(fragment=rows[0])
        has_position = np.isfinite(fragment[x].values)
        tracks, name, azimuth = fragment.isel(time=has_position), "", np.full(int(has_position.sum()), np.nan)
        tracks = tracks.assign_coords(time=own_dates(tracks))
    else:
        table = build_tracks(run)
        ends = np.cumsum(table["rowsize"].values)
        names, parents = (table[n].values.tolist() for n in ("name", "parent"))
        bergs = [k for k, parent in enumerate(parents) if parent <= 0]
        matches = [k for k in bergs if names[k] == berg]
        if berg is not None and not matches:
            berg_names = [names[k] for k in bergs if names[k]]
            raise InputError(
                f"no berg {berg!r}", where="compare, berg",
                remedy=f"{nearest(berg, berg_names)}Bergs are {', '.join(berg_names) or 'without names'}",
            )  # fmt: skip
        row = max(
            matches or bergs, key=lambda k: (float(table["area"].values[ends[k] - table["rowsize"].values[k]]), -k)
        )
        tracks = table.isel(index=slice(int(ends[row] - table["rowsize"].values[row]), int(ends[row])))
        name, azimuth = names[row], tracks["azimuth"].values.astype(float)
    zonal_span = zonal_period(run_parameters(run))
    lon = tracks[x].values
    if zonal_span > 0.0 and run[x].attrs.get("comment") != GOES_ON:
        lon = np.unwrap(lon, period=zonal_span)
    columns = ("parent", "birth_time", x, y, "area", "bonds_broken", "grounded")
    births = zip(*(run[f"fragment_{column}"].values.tolist() for column in columns), strict=True)
    dates = run["fragment_birth_time"].values.astype("datetime64[s]").astype(str)
    breakups = [
        {"time": date, "lon": lon, "lat": lat, "area_km2": area / 1e6, "bonds": int(bonds), "grounded": bool(ground)}
        for date, (parent, _, lon, lat, area, bonds, ground) in zip(dates, births, strict=True) if parent > 0
    ]  # fmt: skip
    if is_channel(run_parameters(run)):  # births lie beside the track, however often that went round
        at = tracks["time"].values.astype("datetime64[s]").astype(np.float64)
        for event in breakups:
            when = np.datetime64(event["time"], "s").astype(np.float64)
            event["lon"] = float(near(event["lon"], np.interp(float(when), at, lon), zonal_span))
    return Course(
        name, tracks["time"].values, lon, tracks[y].values, azimuth, tracks["area"].values.astype(float),
        sorted(breakups, key=lambda event: event["time"]), earth.latlon, earth.radius, earth.period,
    )  # fmt: skip


def compare_courses(first: Course, second: Course) -> dict[str, NDArray[Any]]:
    """Return the differences between two courses at the records of the first that both have.

    ``time``; ``distance`` (m); ``rotation`` of the long axis, second less first (degrees, -90 to 90); ``area_first`` and
    ``area_second`` (m2).
    """
    if first.latlon != second.latlon:
        raise InputError("one run is in degrees, the other in metres", where="compare", remedy="Give two of a kind")
    shared = first.times[(first.times >= second.times[0]) & (first.times <= second.times[-1])]
    # Between records six hours apart a berg that oscillates with the inertial period is a kilometre off the straight line.
    common = shared[np.isin(shared, second.times)]
    shared = common if common.size > 1 else shared
    if not shared.size:
        spans = " and ".join(f"{str(c.times[0])[:16]} to {str(c.times[-1])[:16]}" for c in (first, second))
        raise InputError(f"the runs have no date in common: {spans}", where="compare", remedy="Give runs that overlap")
    (x1, y1, turn1, area1), (x2, y2, turn2, area2) = first.at(shared), second.at(shared)
    # One of two bergs that began side by side may have gone round the channel more often.
    offset = x2[0] - x1[0] - _short_way(x2[0] - x1[0], first.period)
    on_plane = np.hypot(x2 - x1 - offset, y2 - y1)
    distance = haversine(x1, y1, x2, y2, first.radius) if first.latlon else on_plane
    rotation = axis_difference(turn2, turn1)
    differences = {"distance": np.asarray(distance), "rotation": rotation, "area_first": area1, "area_second": area2}
    return {"time": shared, **differences}


def _short_way(dx: Any, period: float) -> Any:
    """Return ways along x (m) the short way round a channel of some length; 0 for none."""
    return near(dx, 0.0, period) if period > 0.0 else dx


Event = dict[str, Any]

DAYS_APART: Final = 4.0
KILOMETRES_APART: Final = 150.0
TIMES_AS_LARGE: Final = 4.0
"""Break-ups further apart in time or place, or with areas that differ by more, are not the same event."""

WORST: Final = 3.0
"""Cost of a pair at all three limits, and of an event without a partner."""


def align_breakups(runs: Sequence[Sequence[Event]], earth: dict[str, Any]) -> list[list[Event | None]]:
    """Return the break-ups of each run in rows: each row holds the same event of all runs, or None.

    ``earth``: parameters of the Earth, as in ``summary.json``: whether places are degrees, its radius and the length of a
    periodic channel (m).
    """
    longest = max(range(len(runs)), key=lambda k: len(runs[k]), default=0)
    rows: list[Event] = list(runs[longest]) if runs else []
    placed: list[dict[int, Event]] = []
    for k, events in enumerate(runs):
        if k == longest:
            placed.append(dict(enumerate(rows)))
            continue
        costs = np.array([[_cost(event, row, earth) for row in rows] for event in events])
        pairs = dict(best_pairs(costs.reshape(len(events), len(rows)), alone=WORST)) if rows and events else {}
        mine: dict[int, Event] = {}
        for number, event in enumerate(events):
            if number not in pairs:
                rows.append(event)
                pairs[number] = len(rows) - 1
            mine[pairs[number]] = event
        placed.append(mine)
    return [[mine.get(row) for row in range(len(rows))] for mine in placed]


def _cost(first: Event, second: Event, earth: dict[str, Any]) -> float:
    """How unlike two break-ups are, 0 to 3; infinite beyond the limits. Grounded and afloat are never the same."""
    times = [datetime.fromisoformat(event["time"]) for event in (first, second)]
    days = abs((times[1] - times[0]).total_seconds()) / 86400.0
    positions = [(event["lon"], event["lat"]) for event in (first, second)]
    if earth["latlon"]:
        metres = float(haversine(*positions[0], *positions[1], earth["radius"]))
    else:
        (x1, y1), (x2, y2) = positions
        metres = math.hypot(_short_way(x2 - x1, earth.get("period", 0.0)), y2 - y1)
    larger = abs(math.log(first["area_km2"] / second["area_km2"])) / math.log(TIMES_AS_LARGE)
    differences = days / DAYS_APART, metres / 1e3 / KILOMETRES_APART, larger
    return sum(differences) if max(differences) <= 1.0 and first["grounded"] == second["grounded"] else math.inf


def best_pairs(cost: Floats, alone: float) -> list[tuple[int, int]]:
    """Return the pairs of the least total cost, where each row that stays alone costs ``alone``.

    ``cost``: cost of each pair, not negative (shape (rows, columns)); returns row and column of each pair, by row.
    """
    rows, columns = cost.shape
    # Loaded here: it takes a third of a second, and few commands need it.
    from scipy.optimize import linear_sum_assignment

    # Each row gets a column of its own on which it stays alone.
    table = np.full((rows, columns + rows), np.inf)
    table[:, :columns] = cost
    table[np.arange(rows), columns + np.arange(rows)] = alone
    pairs = zip(*linear_sum_assignment(table), strict=True)
    return [(int(row), int(column)) for row, column in pairs if column < columns]
