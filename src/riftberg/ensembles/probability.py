"""Statistics of an ensemble: probabilities with intervals, places of break-up, scenarios, and sources of the spread."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
import xarray as xr

from riftberg.compiled.kernels import kernel
from riftberg.config.units import box_text, count_text, duration_text, minute_text, place_text
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.ensembles.member import broken_off
from riftberg.ensembles.result import MEANS, MOST_LISTED, STATUS
from riftberg.plane import near
from riftberg.runs.scene import SMALL
from riftberg.state import Floats

LEVEL: Final = 0.9
"""Of the intervals."""

AREA_CLASSES: Final = (1e5, 1e6, 1e7, 1e8, 1e9, 1e12)
"""Bounds of the classes of fragments, m2."""

CONES: Final = (0.5, 0.9)
"""Parts of the probability that the ellipses of the position hold."""

ENOUGH: Final = 10.0
"""Effective members below which an ensemble says nothing of a spread: no ellipse, radius, limit of ice, date of a share."""

FEW: Final = 50.0
"""Members below which the part of the spread that a source explains is off by 0.1 and more."""

MOST_CELLS: Final = 120
"""Cells of the map of presence along its longer side."""

_ABOUT: Final = {
    "p_broken": f"probability that a piece of {100.0 * SMALL:g} % of its berg or more has broken off until then",
    "p_aground": "probability that the sea floor has acted until then",
    "p_area": "probability that a fragment of the class exists then",
}


def wilson(share: Any, number: float) -> tuple[Any, Any]:
    """Return Wilson's interval (`LEVEL`) of a probability from the share of ``number`` members."""
    from scipy.stats import norm

    z2 = float(norm.ppf(0.5 + 0.5 * LEVEL)) ** 2
    if number <= 0.0:
        return np.zeros_like(share), np.ones_like(share)
    middle = (share + 0.5 * z2 / number) / (1.0 + z2 / number)
    half = np.sqrt(z2) / (1.0 + z2 / number) * np.sqrt(share * (1.0 - share) / number + 0.25 * z2 / number**2)
    return np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0)


def quantiles(values: Floats, weight: Floats, levels: Any) -> Floats:
    """Return quantiles of weighted numbers; missing ones count in none."""
    finite = np.isfinite(values)
    order = np.argsort(values[finite], kind="stable")
    below = np.cumsum(weight[finite][order])
    rank = np.searchsorted(below, np.asarray(levels) * below[-1] * (1.0 - 1e-12))
    return np.asarray(values[finite][order][np.minimum(rank, len(order) - 1)])


def counted(ds: xr.Dataset, *also: str) -> tuple[xr.Dataset, Floats]:
    """Return the members that came to their end, or have another status too, and their weights, which add up to 1."""
    rows = np.flatnonzero(np.isin(ds["status"].values, [STATUS[name] for name in ("done", *also)]))
    ended = ds if rows.size == ds.sizes["member"] else ds.isel(member=rows)
    weight = np.asarray(ended["weight"].values if "weight" in ended.coords else np.ones(ended.sizes["member"]), float)
    total = weight.sum()
    return ended, weight / total if total > 0.0 else weight


def iterate_blocks(members: xr.Dataset, weight: Floats) -> Iterator[tuple[Floats, xr.Dataset]]:
    """Give some members at a time, with their weights."""
    for first in range(0, members.sizes["member"], 100):
        yield weight[first : first + 100], members.isel(member=slice(first, first + 100))


def ellipse_axes(ds: xr.Dataset) -> tuple[Floats, Floats, Floats]:
    """Return semi-axes (m) and azimuth (degrees) of ellipses with the areas and lengths of the fragments."""
    area, ratio = ds["area"].values, np.nan_to_num(ds["elongation"].values, nan=1.0)
    return np.sqrt(area * ratio / np.pi), np.sqrt(area / ratio / np.pi), np.nan_to_num(ds["azimuth"].values)


def effective(weight: Floats) -> float:
    """Return the number of equal members that would be as good as these."""
    return float(weight.sum() ** 2 / (weight**2).sum()) if weight.size else 0.0


def enough(weight: Floats) -> bool:
    """Whether members of these weights count as many (`ENOUGH`)."""
    return effective(weight) >= ENOUGH - 1e-6


def with_probabilities(
    ds: xr.Dataset, breaks: Breaks, weight: Sequence[float] | None = None
) -> xr.Dataset:  # fmt: skip
    """Add to the result of a forecast the statistics of all members.

    ``breaks``: sums over the members, of the same ``weight`` (of each member, by default 1).
    """
    ds = ds.copy()
    time = ds["time"].values
    weights = np.ones(ds.sizes["member"]) if weight is None else np.asarray(weight, float)
    ds.coords["weight"] = ("member", weights, {"units": "1", "long_name": "weight of the member"})
    ds.coords["init"] = time[0]
    ds["init"].attrs = {"long_name": "start of the forecast", "standard_name": "forecast_reference_time"}
    hours = (time - time[0]) / np.timedelta64(1, "h")
    ds.coords["lead"] = (
        "time",
        hours.astype(float),
        {"units": "hours", "standard_name": "forecast_period", "long_name": "lead time"},
    )
    members, share_of = counted(ds)
    if not members.sizes["member"]:
        return ds
    number = effective(share_of)
    ds.attrs["effective_members"] = number
    ds.attrs["interval"] = f"Wilson, {100 * LEVEL:.0f} %"
    ds.attrs["not_covered"] = f"ice smaller than an element, {breaks.side**2 / 1e6:.3g} km2"
    unfinished = int((ds["status"].values == STATUS["unfinished"]).sum())
    if unfinished:
        ds.attrs["not_covered"] += f"; {count_text(unfinished, 'unfinished member')}"
    started = counted(ds, "unfinished")[0]
    listed = (started["fragment_parent"].values > 0).sum(axis=1)
    cut = int((started["breakups"].values > listed).sum())
    if cut:
        ds.attrs["not_covered"] += f"; pieces beyond the {MOST_LISTED} largest in {count_text(cut, 'member')}"
    _add_dated(ds)
    bounds = np.array(AREA_CLASSES)
    ds["area_class_lower"] = ("area_class", bounds[:-1], {"units": "m2", "long_name": "least area of the class"})
    ds["area_class_upper"] = ("area_class", bounds[1:], {"units": "m2", "long_name": "largest area of the class"})
    share = np.zeros((bounds.size - 1, time.size))
    for w, block in iterate_blocks(members, share_of):
        area = block["area"].values
        share += [w @ ((area >= low) & (area < high)).any(axis=1) for low, high in pairwise(bounds)]
    _add(ds, "p_area", ("area_class", "time"), share, number, _unfinished_share(ds))
    if "lat" in members:
        _add_presence(ds, *counted(ds, "unfinished"))
        _add_cones(ds, members, share_of)
    return breaks.extend_forecast(ds)


def _add_dated(ds: xr.Dataset) -> None:
    """Add the probabilities of events with a date; a member that never breaks has none and stays in the denominator.

    An unfinished member counts up to its last position; its later path is unknown.
    """
    of, weight = counted(ds, "unfinished")
    for name, when in (("p_broken", "first_breakup"), ("p_aground", "first_aground")):
        share, unknown = share_until(of, weight, of[when].values[:, None] <= ds["time"].values)
        _add(ds, name, ("time",), share, effective(weight), unknown)


def share_until(members: xr.Dataset, weight: Floats, yes: Any) -> tuple[Floats, Floats]:
    """Return by date the share of members to which it has happened by then, and the weight of those of which it is unknown.

    ``yes``: whether it has happened to each member (members, times). Of an unfinished one that it has not happened to, nothing
    is known after its last position.
    """
    unknown = weight @ (beyond_last_position(members) & ~yes)
    return weight @ yes / np.maximum(1.0 - unknown, 1e-300), unknown


def beyond_last_position(members: xr.Dataset) -> Any:
    """Return which members are unfinished and beyond their last position, by date (members, times)."""
    beyond = np.zeros((members.sizes["member"], members.sizes["time"]), bool)
    for k in np.flatnonzero(members["status"].values == STATUS["unfinished"]):
        has_area = np.isfinite(members["area"].isel(member=k).values).any(axis=0)
        beyond[k] = np.cumsum(has_area[::-1])[::-1] == 0
    return beyond


def _unfinished_share(ds: xr.Dataset) -> float:
    """Return the weight of unfinished members among those that did not fail."""
    of, weight = counted(ds, "unfinished")
    return float(weight[of["status"].values == STATUS["unfinished"]].sum())


def with_interval(share: Floats, number: float, unknown: float | Floats) -> tuple[Floats, Floats, Floats]:
    """Return a probability and the ends of its interval, which count members of which it is unknown as no and as yes.

    ``unknown``: weight of the members of which it is not known; ``share``: of the others.
    """
    share = np.clip(share, 0.0, 1.0)
    least = share * (1.0 - unknown)
    return share, wilson(least, number)[0], wilson(np.minimum(least + unknown, 1.0), number)[1]


def _add(
    ds: xr.Dataset, name: str, dims: tuple[str, ...], share: Floats, number: float, unknown: float | Floats
) -> None:  # fmt: skip
    """Add a probability and its interval."""
    share, low, high = with_interval(share, number, unknown)
    about = {"units": "1", "long_name": _ABOUT[name]}
    ds[name] = (dims, share, about)
    ds[f"{name}_low"] = (dims, low, {**about, "long_name": f"{_ABOUT[name]}: lower end of the interval"})
    ds[f"{name}_high"] = (dims, high, {**about, "long_name": f"{_ABOUT[name]}: upper end of the interval"})


@kernel
def add_ellipses(
    position: tuple[Any, Any], axes: tuple[Any, Any, Any], weight: Floats, cells: tuple[Floats, Floats], cosine: float,
    presence: Any, passes: Floats,
) -> None:  # fmt: skip
    """Add the weight of each member to the cells on which it has ice, by time and ever; fragments are ellipses.

    ``position``: longitudes and latitudes; ``axes``: semi-axes (degrees of latitude) and azimuth of the longer one (rad), each
    (members, fragments, times); ``cells``: their middles; ``presence``: (times, y, x); ``passes``: (y, x). A cell counts where
    its middle lies in an ellipse, and where the middle of the ellipse lies in the cell.
    """
    (lon, lat), (major, minor, azimuth), (x, y) = position, axes, cells
    members, fragments, times = lon.shape
    dx, dy = x[1] - x[0] if x.size > 1 else 1.0, y[1] - y[0] if y.size > 1 else 1.0
    # Which member and time had ice on the cell last: the fragments of one member hold a cell once.
    latest, ever = np.full(passes.shape, -1), np.full(passes.shape, -1)
    for m in range(members):
        for k in range(times):
            for p in range(fragments):
                u, v, r = lon[m, p, k], lat[m, p, k], major[m, p, k]
                if not np.isfinite(u):
                    continue
                own_i = min(math.floor((u - x[0]) / dx + 0.5), x.size - 1)
                own_j = min(math.floor((v - y[0]) / dy + 0.5), y.size - 1)
                reach_i, reach_j = int(r / cosine / dx) + 1, int(r / dy) + 1
                sine, cos = math.sin(azimuth[m, p, k]), math.cos(azimuth[m, p, k])
                for j in range(max(own_j - reach_j, 0), min(own_j + reach_j + 1, y.size)):
                    for i in range(max(own_i - reach_i, 0), min(own_i + reach_i + 1, x.size)):
                        east, north = (x[i] - u) * cosine, y[j] - v
                        along, across = east * sine + north * cos, east * cos - north * sine
                        inside = (along / r) ** 2 + (across / minor[m, p, k]) ** 2 <= 1.0
                        if not inside and not (i == own_i and j == own_j):
                            continue
                        if latest[j, i] != m * times + k:
                            latest[j, i] = m * times + k
                            presence[k, j, i] += weight[m]
                        if ever[j, i] != m:
                            ever[j, i] = m
                            passes[j, i] += weight[m]


def _add_presence(ds: xr.Dataset, members: xr.Dataset, weight: Floats) -> None:
    """Add the probability that any ice lies over a cell: fragments as ellipses.

    Unfinished members count as in `share_until`: as far as they came, and where they had ice by then.
    """
    degree = DEGREE * EARTH_RADIUS_A68
    finished = members["status"].values == STATUS["done"]
    first = float(members["lon"].isel(member=int(finished.argmax()), fragment=0, time=0))
    west, south, east, north, reach = np.inf, np.inf, -np.inf, -np.inf, 0.0
    for _, block in iterate_blocks(members, weight):
        lon, lat = near(block["lon"].values, first), block["lat"].values
        west, east = min(west, np.nanmin(lon)), max(east, np.nanmax(lon))
        south, north = min(south, np.nanmin(lat)), max(north, np.nanmax(lat))
        reach = max(reach, np.nanmax(ellipse_axes(block)[0]))
    reach /= degree
    cosine = float(np.cos(0.5 * (south + north) * DEGREE))
    west, east, south, north = west - reach / cosine, east + reach / cosine, south - reach, north + reach
    step = max((east - west) * cosine, north - south) / MOST_CELLS
    x = np.arange(west + 0.5 * step / cosine, east, step / cosine)
    y = np.arange(south + 0.5 * step, north, step)
    presence, passed = np.zeros((members.sizes["time"], y.size, x.size)), np.zeros((2, y.size, x.size))
    for w, block in iterate_blocks(members, weight):
        for passes, status in zip(passed, ("done", "unfinished"), strict=True):
            rows = np.flatnonzero(block["status"].values == STATUS[status])
            subset = block.isel(member=rows)
            major, minor, azimuth = ellipse_axes(subset)
            axes, position = (
                (major / degree, minor / degree, np.radians(azimuth)),
                (near(subset["lon"].values, first), subset["lat"].values),
            )
            add_ellipses(position, axes, w[rows], (x, y), cosine, presence, passes)
    presence /= np.maximum(1.0 - weight @ beyond_last_position(members), 1e-300)[:, None, None]
    passes = passed.sum(axis=0) / (1.0 - (weight[~finished].sum() - passed[1]))
    ds.coords["cell_lon"] = ("cell_lon", x, {"units": "degrees_east", "standard_name": "longitude"})
    ds.coords["cell_lat"] = ("cell_lat", y, {"units": "degrees_north", "standard_name": "latitude"})
    about = {
        "units": "1",
        "long_name": "probability that ice lies over the cell then, fragments as ellipses of their areas and axes",
    }
    # Dates first: GDAL, and so QGIS, takes the last two dimensions for those of a map.
    ds["presence"] = (("time", "cell_lat", "cell_lon"), np.clip(presence, 0.0, 1.0), about)
    about = {"units": "1", "long_name": "probability that ice lies over the cell at one of the times"}
    ds["passes"] = (("cell_lat", "cell_lon"), np.clip(passes, 0.0, 1.0), about)


def _add_cones(ds: xr.Dataset, members: xr.Dataset, weight: Floats) -> None:
    """Add mean and range of the position of the first berg, and its ellipses where enough members count.

    Of a normal distribution with the members' mean and covariance.
    """
    times, metres = members.sizes["time"], DEGREE * EARTH_RADIUS_A68
    first = float(members["lon"].isel(member=0, fragment=0, time=0))
    total, middle, squares = np.zeros((2, times)), np.zeros((2, times)), np.zeros((times, 2, 2))
    least, most = np.full((2, times), np.inf), np.full((2, times), -np.inf)

    def positions() -> Iterator[tuple[Floats, Floats]]:
        for w, block in iterate_blocks(members, weight):
            lon, lat = (block[name].isel(fragment=0).values for name in ("lon", "lat"))
            valid = np.isfinite(lon)
            position = np.stack([near(lon, first), lat])
            yield w[:, None] * valid, np.where(valid, position, middle[:, None])  # nothing where nobody is

    for w, position in positions():
        total += [w.sum(axis=0), (w**2).sum(axis=0)]
        middle = middle + (w * position).sum(axis=1)
        least = np.minimum(least, np.where(w > 0.0, position, np.inf).min(axis=1))
        most = np.maximum(most, np.where(w > 0.0, position, -np.inf).max(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.where(total[0] > 0.0, middle / total[0], np.nan)
        reliable = total[0] ** 2 / total[1] >= ENOUGH - 1e-6
    for w, position in positions():
        offset = metres * (position - middle[:, None])
        offset[0] *= np.cos(middle[1] * DEGREE)
        squares += np.einsum("mt,imt,jmt->tij", w, np.nan_to_num(offset), np.nan_to_num(offset))
    axes = np.full((3, times), np.nan)
    values, vectors = np.linalg.eigh(squares[reliable] / total[0, reliable, None, None])
    axes[:2, reliable] = np.sqrt(np.maximum(values[:, ::-1].T, 0.0))
    axes[2, reliable] = np.rad2deg(np.arctan2(vectors[:, 0, 1], vectors[:, 1, 1])) % 180.0
    # Within r standard deviations of a normal distribution in two dimensions lies 1 - exp(-r2 / 2).
    factor = np.sqrt(-2.0 * np.log(1.0 - np.array(CONES)))
    ds.coords["cone"] = (
        "cone",
        np.array(CONES),
        {"units": "1", "long_name": "part of the probability inside of the ellipse"},
    )
    for name, values, unit, word in (
        ("cone_lon", middle[0], "degrees_east", "longitude"), ("cone_lat", middle[1], "degrees_north", "latitude"),
    ):  # fmt: skip
        ds[name] = (
            "time",
            values,
            {"units": unit, "standard_name": word, "long_name": f"mean {word} of the first berg"},
        )
    for side, ends, unit, word in (
        ("west", least[0], "degrees_east", "longitude"), ("east", most[0], "degrees_east", "longitude"),
        ("south", least[1], "degrees_north", "latitude"), ("north", most[1], "degrees_north", "latitude"),
    ):  # fmt: skip
        about = {"units": unit, "long_name": f"range of the members: {side}ernmost {word} of the first berg"}
        ds[f"members_{side}"] = ("time", np.where(np.isfinite(ends), ends, np.nan), about)
    for name, row, word in (("cone_major", 0, "major"), ("cone_minor", 1, "minor")):
        about = {"units": "m", "long_name": f"semi-{word} axis of the ellipse of the position",
                 "comment": f"missing where fewer than {ENOUGH:.0f} members count (effective number)"}  # fmt: skip
        ds[name] = (("cone", "time"), factor[:, None] * axes[row], about)
    about = {"units": "degree", "long_name": "direction of the major axis, clockwise from north"}
    ds["cone_azimuth"] = ("time", axes[2], about)


class Breaks:
    """Where members break, on a grid in the berg's own axes, and which pieces they lose; of a member next to nothing is kept.

    ``ice``: places (m) of the elements of the control about its middle, and their side (m); ``weight``: of each member, by
    default 1.
    """

    def __init__(self, ice: tuple[Floats, Floats, float], weight: Sequence[float] | None = None) -> None:
        x, y, self.side = ice
        # Finer than the lattice, a crack would miss cells that it crosses.
        self.cell = max(max(np.ptp(x), np.ptp(y), self.side) / 40.0, 1.5 * self.side)
        self.edges = [np.arange(a.min() - self.side, a.max() + self.side + self.cell, self.cell) for a in (x, y)]
        self.has_ice = np.histogram2d(y, x, bins=self.edges[::-1])[0] > 0
        self.density, self.share = np.zeros(self.has_ice.shape), np.zeros(self.has_ice.shape)
        self.weight, self.total = weight, 0.0
        self.leaders: list[list[Floats]] = []  # Of each scenario the pieces of its first member
        self.numbers: list[Any] = []  # Scenario of each member, in order of the first; of each block an array

    def add(self, ds: xr.Dataset, cracks: Mapping[int, Any]) -> None:
        """Add a block of members, the first ones first; ``cracks``: broken bonds of each, as `Outcome` has them."""
        numbers = np.full(ds.sizes["member"], -1, dtype="i4")
        wholes = np.nansum(ds["area"].isel(time=0).values, axis=1)
        number_of, parent, areas = (ds[f"fragment_{name}"].values for name in ("number", "parent", "area"))
        births = (ds["fragment_birth_time"].values - ds["time"].values[0]) / np.timedelta64(1, "s")
        for k in np.flatnonzero(ds["status"].values == 0).tolist():
            number = int(ds["member"].values[k])
            weight = 1.0 if self.weight is None else float(self.weight[number])
            rows = np.array(cracks.get(number, []), float).reshape(-1, 4)
            length = np.histogram2d(rows[:, 2], rows[:, 1], bins=self.edges[::-1], weights=rows[:, 3])[0]
            self.density += weight * length / self.cell**2
            self.share += weight * (length > 0.0)
            self.total += weight
            large = broken_off(zip(number_of[k], parent[k], areas[k], births[k], strict=True))[:3]
            numbers[k] = self._scenario(
                [_sign(rows, float(births[k, p]), float(areas[k, p]), float(wholes[k])) for p in large]
            )
        self.numbers.append(numbers)

    def _scenario(self, sign: list[Floats]) -> int:
        """Return the scenario of a member: which pieces broke off, in which order, as far as three of them."""
        alike = next((g for g, other in enumerate(self.leaders) if _alike(sign, other)), None)
        if alike is None:
            self.leaders.append(sign)
        return len(self.leaders) - 1 if alike is None else alike

    def extend_forecast(self, ds: xr.Dataset) -> xr.Dataset:
        """Return a forecast with length of crack per area, probability of a crack, and the scenarios, the likeliest first."""
        for name, edge, word in (("own_x", self.edges[0], "east"), ("own_y", self.edges[1], "north")):
            about = {"units": "m", "long_name": f"{word} of the berg's middle at the start"}
            ds.coords[name] = (name, 0.5 * (edge[:-1] + edge[1:]), about)
        total = self.total or 1.0
        for name, values, unit, meaning in (
            ("ice", self.has_ice.astype("i1"), "1", "1 where the control has ice at the start"),
            ("crack_density", self.density / total, "m-1", "mean length of crack per area"),
            ("crack_probability", np.clip(self.share / total, 0.0, 1.0), "1", "probability of a crack in the cell"),
        ):
            ds[name] = (("own_y", "own_x"), values, {"units": unit, "long_name": meaning})
        number = np.concatenate(self.numbers)
        has_scenario = number >= 0
        weight = np.ones(number.size) if self.weight is None else np.asarray(self.weight, float)
        weighs = np.bincount(number[has_scenario], weight[has_scenario], minlength=len(self.leaders))
        rank = np.argsort(np.argsort(-weighs, kind="stable"))
        number[has_scenario] = rank[number[has_scenario]]
        about = {"long_name": "scenario of the member, 0 the likeliest; -1 for none"}
        ds["scenario"] = ("member", number.astype("i4"), about)
        return ds


# ---- scenarios --------------------------------------------------------------------------------------------------------


def _sign(rows: Floats, birth: float, area: float, berg_area: float) -> Floats:
    """Return where the crack that freed a piece lay in the berg, in lengths of the berg, and how large the piece was.

    ``rows``: cracks of the member; ``birth``: of the piece, s after the start.
    """
    crack = rows[np.abs(rows[:, 0] - birth) < 43200.0]
    middle = crack[:, 1:3].mean(axis=0) if crack.size else np.zeros(2)
    return np.array([*(middle / np.sqrt(berg_area)), area / berg_area])


def _alike(first: list[Floats], other: list[Floats]) -> bool:
    """Whether two members lost the same pieces in the same order: cracks near each other, areas within a factor of two."""
    return len(first) == len(other) and all(
        np.hypot(*(a[:2] - b[:2])) < 0.3 and 0.5 <= a[2] / b[2] <= 2.0 for a, b in zip(first, other, strict=True)
    )


@dataclass(frozen=True)
class Scenario:
    """Members that lost the same pieces in the same order."""

    number: int
    probability: float
    representative: int  # The member whose track is nearest to the mean of the scenario
    pieces: tuple[float, ...]  # Areas that broke off in it, m2
    cause: str  # Input that sets it apart most, or nothing

    def told(self) -> str:
        """Return it in a line."""
        course = (
            "no piece breaks off"
            if not self.pieces
            else "breaks off " + ", then ".join(f"{a / 1e6:.0f} km2" for a in self.pieces)
        )
        return f"{100 * self.probability:.0f} %: {course} (member {self.representative}{self.cause})"


def scenarios(ds: xr.Dataset) -> list[Scenario]:
    """Return the scenarios of a forecast, the likeliest first."""
    ended, weight = counted(ds)
    result = []
    inputs = differing_inputs(ended)
    ends = np.column_stack(
        [ended[name].isel(fragment=0, time=-1).values for name in (("lon", "lat") if "lat" in ended else ("x", "y"))]
    )
    if "lat" in ended and np.isfinite(ends).any():
        ends[:, 0] = near(ends[:, 0], float(ends[np.isfinite(ends[:, 0]), 0][0])) * np.cos(
            np.nanmean(ends[:, 1]) * DEGREE
        )
    for number in np.unique(ended["scenario"].values):
        rows = np.flatnonzero(ended["scenario"].values == number)
        rows = rows[weight[rows] > 0.0] if weight[rows].any() else rows  # after sightings the others stand for nothing
        end = ends[rows]
        index = int(np.nanargmin(np.hypot(*(end - np.nanmean(end, axis=0)).T))) if np.isfinite(end).any() else 0
        member = int(rows[index])
        columns = [
            ended[f"fragment_{name}"].isel(member=member).values for name in ("number", "parent", "area", "birth_time")
        ]
        sizes = columns[2][broken_off(zip(*columns, strict=True))[:3]]
        cause = _apart(inputs, rows)
        result.append(Scenario(
            int(number), float(weight[rows].sum()), int(ended["member"].values[member]), tuple(map(float, sizes)), cause
        ))  # fmt: skip
    return sorted(result, key=lambda s: -s.probability)


def _apart(inputs: Mapping[str, Floats], rows: Any) -> str:
    best, text = 0.8, ""
    for name, values in inputs.items():
        inside, outside = values[rows], np.delete(values, rows)
        spread = float(np.std(values))
        if inside.size < 3 or outside.size < 3 or spread == 0.0:
            continue
        shift = float((inside.mean() - outside.mean()) / spread)
        if abs(shift) > best:
            best, text = abs(shift), f", {name.replace('_', ' ')} {'high' if shift > 0 else 'low'}"
    return text


# ---- what makes the spread --------------------------------------------------------------------------------------------

GROUPS: Final = {
    "start": ("start_east", "start_north", "start_turn"),
    "thickness and size": ("start_thickness", "start_size"),
    "strength": (
        "start_strength", "fracture_normal_strength", "fracture_crevasse_strength", "fracture_shear_strength",
    ),
    "current": ("current_error_east", "current_error_north"),
    "wind": ("wind_error_east", "wind_error_north"),
    "floor": ("floor_error_mean", "floor_error_offset", "floor_error_scale"),
}  # fmt: skip


def differing_inputs(ended: xr.Dataset) -> dict[str, Floats]:
    """Return all inputs of the members that are numbers and differ, drawn ones and means of random fields."""
    names = [str(name) for name in ended.coords if "parameter" in ended[name].attrs] + [
        name for name in MEANS if name in ended
    ]
    inputs = {
        name: np.asarray(ended[name].values, float) for name in names
        if ended[name].dtype.kind in "fi" and np.ptp(ended[name].values) > 0.0 and np.isfinite(ended[name].values).all()
    }  # fmt: skip
    factor = inputs.pop("start_error", 1.0)  # of starts with errors of their own
    return {
        name: values * factor if name in ("start_east", "start_north") else values for name, values in inputs.items()
    }


def sources(ds: xr.Dataset) -> dict[str, float]:
    """Return the part of the spread of the last position that each source of error explains alone, by linear regression.

    The means of current and wind along the track stand for their fields. Adjusted for the number of inputs, so that sources
    of no effect come out near 0; the rest is not linear.
    """
    members, weight = counted(ds)
    if "lat" not in members:
        return {}
    inputs = differing_inputs(members)
    lon, lat = (members[name].isel(fragment=0, time=-1).values for name in ("lon", "lat"))
    valid = np.isfinite(lon) & (weight > 0.0)
    number = effective(weight[valid])
    if not enough(weight[valid]):  # of fewer anything explains the spread
        return {}
    lon, root = near(lon[valid], float(lon[valid][0])), np.sqrt(weight[valid] / weight[valid].sum())
    target = np.column_stack([lon * np.cos(np.mean(lat[valid]) * DEGREE), lat[valid]])
    grouped = {name: [n for n in names if n in inputs] for name, names in GROUPS.items()}
    others = set(inputs) - {n for names in grouped.values() for n in names}
    grouped |= {name.replace("_", " "): [name] for name in sorted(others)}
    shares = {}
    for name, group in grouped.items():
        if group:
            columns = np.column_stack([inputs[n][valid] for n in group])
            shares[name] = _explained(columns, target, root, number)
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def _explained(columns: Floats, target: Floats, root: Floats, n: float) -> float:
    """Return the coefficient of determination of a weighted linear regression, adjusted for ``n`` members that count."""

    def centred(a: Floats) -> Floats:
        return np.asarray((a - (root**2) @ a) * root[:, None])

    x, y = centred(columns / np.maximum(columns.std(axis=0), 1e-300)), centred(target)
    rest = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    total, p = float((y**2).sum()), x.shape[1]
    if total == 0.0 or n <= p + 1:
        return 0.0
    return float(max(0.0, 1.0 - (rest**2).sum() / total * (n - 1.0) / (n - p - 1.0)))


def notes(ds: xr.Dataset) -> list[str]:
    """Return the likeliest scenarios in a few short lines."""
    return [scenario.told().split(" (")[0] for scenario in scenarios(ds)[:3]]


# ---- in words ---------------------------------------------------------------------------------------------------------


def range_text(ds: xr.Dataset) -> str:
    """Return the range of the members' last positions."""
    lon, lat = (
        [float(ds[f"members_{side}"].values[-1]) for side in ends] for ends in (("west", "east"), ("south", "north"))
    )
    return f"range of the members {box_text(*(round(c, 2) for c in (*lon, *lat)))}"


def fates(ds: xr.Dataset) -> str:
    """Return how many members failed, and how many are unfinished."""
    failed, unfinished = (int((ds["status"].values == STATUS[name]).sum()) for name in ("failed", "unfinished"))
    return f"{failed} failed" + (f", {unfinished} unfinished" if unfinished else "")


def reasons(ds: xr.Dataset) -> list[str]:
    """Return why members failed or are unfinished: the commonest reason of each in a line, whatever numbers it holds."""
    lines = []
    for status in ("failed", "unfinished"):
        messages = [str(text) for text in ds["message"].values[ds["status"].values == STATUS[status]]]
        kinds = [re.sub(r"[\d.]+", "#", text) for text in messages]
        if messages:
            kind, number = Counter(kinds).most_common(1)[0]
            lines.append(f"  {number} of {len(messages)} {status}: {messages[kinds.index(kind)]}")
    return lines


def _first_touch(done: xr.Dataset, weight: Floats) -> list[str]:
    """Return when and where members run aground first, in a line; nothing where none does, or where a file does not say."""
    if "aground_lon" not in done:
        return []
    lon, lat, when = (done[name].values for name in ("aground_lon", "aground_lat", "first_aground"))
    touched = np.isfinite(lon) & ~np.isnat(when) & (weight > 0.0)
    if not touched.any() or "cone_lon" not in done:
        return []
    lon, lat, when, share_of = near(lon[touched], float(lon[touched][0])), lat[touched], when[touched], weight[touched]
    if not enough(share_of):
        ends = f"{minute_text(when.min())} to {minute_text(when.max())}" if when.size > 1 else minute_text(when[0])
        sides = (round(float(side), 2) for side in (lon.min(), lon.max(), lat.min(), lat.max()))
        position = box_text(*sides) if when.size > 1 else place_text(lon[0], lat[0], latlon=True, digits=2)
        of = count_text(int((weight > 0.0).sum()), "member")
        return [f"  {when.size} of {of} ran aground, {ends}, {position}"]
    middle = float(quantiles(lon, share_of, 0.5)), float(quantiles(lat, share_of, 0.5))
    offset = np.hypot((lon - middle[0]) * math.cos(middle[1] * DEGREE), lat - middle[1])
    km = float(quantiles(offset, share_of, 0.5)) * DEGREE * EARTH_RADIUS_A68 / 1e3
    hours = (when - when.min()) / np.timedelta64(1, "h")
    date = when[int(np.argmin(np.abs(hours - quantiles(hours, share_of, 0.5))))]
    return [
        f"  of {count_text(when.size, 'member')} that ran aground half did by {minute_text(date)}, "
        f"about {place_text(*middle, latlon=True, digits=2)}, half of them within {km:.0f} km of it"
    ]


def told(ds: xr.Dataset) -> list[str]:
    """Return a forecast in a few lines."""
    done, weight = counted(ds)
    number = done.sizes["member"]
    if not number:
        return ["no member came to its end", *reasons(ds)]
    last = {
        name: [100.0 * float(ds[f"{name}{end}"].values[-1]) for end in ("", "_low", "_high")]
        for name in ("p_broken", "p_aground")
    }
    days = float(ds["lead"].values[-1]) / 24.0
    counting = effective(weight)
    members = count_text(number, "member")
    members += f", {counting:.1f} of them count" if counting < 0.995 * number else ""
    lines = [f"{members}, {fates(ds)}; after {duration_text(days)}, with intervals of {100 * LEVEL:.0f} %:"]
    for name, word in (("p_broken", "broken up"), ("p_aground", "been aground")):
        p, low, high = last[name]
        lines.append(f"  {p:.0f} % ({low:.0f} to {high:.0f} %) that it has {word}")
    lines += _first_touch(done, weight)
    at_start = 100.0 * float(ds["p_aground"].values[0])
    if at_start > 5.0:
        doubt = "is that so, or are errors of floor and thickness too large?"
        lines.append(f"  {at_start:.0f} % of the members are aground at the start: {doubt}")
    started, share_of = counted(ds, "unfinished")
    dates = started["first_breakup"].values
    order = np.argsort(dates)
    half = np.flatnonzero((np.cumsum(share_of[order]) >= 0.5) & ~np.isnat(dates[order]))
    broke = dates[~np.isnat(dates) & (share_of > 0.0)]
    if not enough(share_of) and broke.size:
        count = f"{broke.size} of {count_text(int((share_of > 0.0).sum()), 'member')}"
        dates_text = " to ".join(dict.fromkeys(minute_text(date) for date in (broke.min(), broke.max())))
        lines.append(f"  first break-up in {count}, {dates_text}")
    elif half.size:
        lines.append(f"  first break-up by {minute_text(dates[order][half[0]])} with 50 %")
    if _unfinished_share(ds) > 0.0:
        lines.append("  unfinished members count above as far as they came, then both ways; below are the others")
    if "cone_major" in ds:
        major, minor = (float(ds[name].sel(cone=0.9).values[-1]) / 1e3 for name in ("cone_major", "cone_minor"))
        lat, lon = (float(ds[name].values[-1]) for name in ("cone_lat", "cone_lon"))
        if math.isfinite(major) and counting >= ENOUGH - 1e-6:
            spread = f"90 % within an ellipse of {major:.0f} by {minor:.0f} km (semi-axes)"
        else:
            spread = (
                f"{range_text(ds)}: too few members count for an ellipse"
                if number > 1
                else "one member says nothing of the spread"
            )
        bergs = int((done["fragment_parent"].isel(member=0).values == 0.0).sum())
        whose = f" of the first of {bergs} bergs" if bergs > 1 else ""
        lines.append(f"  position{whose} {place_text(lon, lat, latlon=True, digits=2)}; {spread}")
    best = np.unravel_index(int(ds["crack_probability"].values.argmax()), ds["crack_probability"].shape)
    share = float(ds["crack_probability"].values[best])
    if share >= 0.005:  # else it would be given as 0 %
        x, y = float(ds["own_x"].values[best[1]]) / 1e3, float(ds["own_y"].values[best[0]]) / 1e3
        lines.append(
            f"  likeliest place of a crack: {x:+.0f} km east, {y:+.0f} km north of the middle at the start ({100 * share:.0f} %)"
        )
    lines += [f"  scenario {s.number + 1}, {s.told()}" for s in scenarios(ds)[:4]]
    if shares := sources(ds):
        parts = ", ".join(f"{name} {100 * share:.0f} %" for name, share in list(shares.items())[:4])
        doubt = "; with so few members partly by chance" if counting < FEW else ""
        lines.append(f"  spread of the position that each source explains by itself: {parts}{doubt}")
    return lines + reasons(ds)
