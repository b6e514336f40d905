"""The slope of the sea surface where no sea level is given: it balances the current, as geostrophic balance has it.

The slope is ``d(eta)/dx = f v / g``, ``d(eta)/dy = -f u / g``, with ``f = 2 Omega sin(latitude)``: it fades towards the equator.
Tides and inertial motion have no such slope, and a large berg, which turns at the inertial period itself, would resonate with
one. So the current is averaged over 25 hours, twice, which leaves 1 % of a motion of 13.8 hours (a mean over a day leaves 14 %).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple, get_args

import numpy as np

from riftberg.config.values import number as checked_number
from riftberg.constants import DEGREE, EARTH_ROTATION, GRAVITY, SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.ocean.needs import DEPTH, SeaLevel
from riftberg.physics.drag import ocean_drag
from riftberg.physics.elementary import sin, sin_array
from riftberg.physics.floating import draft_of
from riftberg.state import Elements, Floats, Ints

if TYPE_CHECKING:
    from collections.abc import Collection

    from riftberg.config.parameter_groups import Drag
    from riftberg.ocean.forcing import Forcing
    from riftberg.parameters import Parameters

MEAN: Final = 25.0 * 3600.0
"""Length (s) of each of the two means: two periods of the lunar tide, nearly two of inertial motion at 60 degrees."""

APART: Final = 5.0 * 3600.0
"""Means are taken at records about so far apart (s), and are linear between: their remainder changes over days."""


def decided(choice: str, fields: Collection[str], *, where: str, level_wanted: str, currents_wanted: str) -> SeaLevel:
    """Return ``files``, ``geostrophic`` or ``none``: the meaning of a choice for data that give these fields.

    ``level_wanted``, ``currents_wanted``: remedies where no data give the field that the choice needs.

    Raises
    ------
    ForcingError
        If there is no such choice, or the data lack the field that it needs.
    """
    if choice not in get_args(SeaLevel):
        raise ForcingError(f"{choice!r} is no choice", where=where, remedy="auto, files, geostrophic or none")
    if choice == "auto":
        return "files" if "ssh" in fields else "geostrophic" if "uo" in fields else "none"
    if choice == "files" and "ssh" not in fields:
        raise ForcingError("nothing gives a sea level (ssh)", where=f"{where}: files", remedy=level_wanted)
    if choice == "geostrophic" and "uo" not in fields:
        raise ForcingError(
            "nothing gives currents, which the sea surface could balance",
            where=f"{where}: geostrophic",
            remedy=currents_wanted,
        )
    return choice  # type: ignore[return-value]


def balancing_slope(lat: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return the slope of the sea surface to the east and north that balances a current.

    Parameters
    ----------
    lat : array
        Latitudes, degrees.
    u, v : array
        Eastward and northward current, m s-1.
    """
    per_speed = 2.0 * EARTH_ROTATION * sin_array(lat * DEGREE) / GRAVITY
    return per_speed * v, -per_speed * u


def wind_drift(lat: Floats, ua: Floats, va: Floats, share: float) -> tuple[Floats, Floats]:
    """Return the current (m s-1) of the wind's own layer: a share of the wind, 45 degrees to its right in the north.

    In the south to its left. No keel of 200 m feels it, and it has no slope.

    Parameters
    ----------
    lat : array
        Latitudes, degrees.
    ua, va : array
        Eastward and northward wind at 10 m, m s-1.
    share : float
        Speed of the layer over the speed of the wind.
    """
    turn = np.where(np.asarray(lat) < 0.0, 1.0, -1.0)
    component = share * math.sqrt(0.5)
    return component * (ua - turn * va), component * (va + turn * ua)


MOST_OF_WIND: Final = 0.05
"""Share of the wind that no drift of the sea surface exceeds."""


def checked_wind_layer(value: Any) -> float:
    """Return the share of the wind whose layer is taken out of the current."""
    share = checked_number(value, "1", where="wind_layer", kind=ForcingError)
    if not 0.0 <= share <= MOST_OF_WIND:
        raise ForcingError(
            f"{share:g} is no share of the wind", where="wind_layer", remedy=f"0 to {MOST_OF_WIND:g}, such as 0.005"
        )
    return share


def layer_text(share: float) -> str:
    """Return the notice that a wind layer is taken out of the current."""
    return (
        f"wind_layer: {share:g} of the wind, 45 degrees to its left in the south and to its right in the north, is taken out of "
        "the current and of the slope that balances it"
    )


class Shares(NamedTuple):
    """Weights of neighbouring records in a mean; their sum is 1."""

    first: int  # Number of the first record
    weights: Floats


def mean_record_weights(times: Floats, middle: float) -> Shares:
    """Return the weights of records in the mean over 25 hours around a time (s), of a series that is linear between them.

    At the ends of the series the mean shifts inwards; a shorter series is averaged as a whole.
    """
    begin = min(max(middle - 0.5 * MEAN, times[0]), max(times[-1] - MEAN, times[0]))
    end = min(begin + MEAN, times[-1])
    first = max(int(np.searchsorted(times, begin, side="right")) - 1, 0)
    last = max(int(np.searchsorted(times, end, side="left")), first + 1)
    node_times = times[first : last + 1]
    low, high = np.maximum(node_times[:-1], begin), np.minimum(node_times[1:], end)
    length, after = high - low, (0.5 * (low + high) - node_times[:-1]) / np.diff(node_times)
    weights = np.zeros(node_times.size)
    weights[:-1] += length * (1.0 - after)
    weights[1:] += length * after
    return Shares(first, weights / (end - begin))


def slow_current_weights(times: Floats) -> tuple[list[int], list[Shares]]:
    """Return the records at which the current that the sea surface balances is taken, and the weights of all records in each.

    It is the mean over 25 hours, taken twice; ``times``: of the records, s.
    """
    numbers = [0]
    while numbers[-1] < times.size - 1:
        within = int(np.searchsorted(times, times[numbers[-1]] + APART, side="right")) - 1
        numbers.append(max(within, numbers[-1] + 1))
    once = [mean_record_weights(times, float(time)) for time in times]
    twice = []
    for number in numbers:
        outer = once[number]
        inner = once[outer.first : outer.first + outer.weights.size]
        first = inner[0].first
        weights = np.zeros(max(share.first + share.weights.size for share in inner) - first)
        for weight, share in zip(outer.weights, inner, strict=True):
            weights[share.first - first : share.first - first + share.weights.size] += weight * share.weights
        twice.append(Shares(first, weights))
    return numbers, twice


# ---- notices on the slope ----------------------------------------------------------------------------------------------------

SHOWN_SPEED: Final = 0.2
"""Current (m s-1) in which `slope_notice` says how far a berg drifts."""

SHOWN_DAYS: Final = 2.0
"""And for how many days."""


def drift_in_current(size: float, thickness: float, density: float, lat: float, *, slope: bool, drag: Drag) -> float:
    """Return how far (m) a square berg that was at rest goes with a steady current of 0.2 m/s in two days.

    Water drag and Coriolis act on it, and the slope that balances the current, if ``slope``.

    Parameters
    ----------
    size, thickness : float
        Side and thickness, m.
    density : float
        kg m-3.
    lat : float
        Latitude, degrees.
    drag : Drag
        Coefficients of the water's drag.
    """
    mass = density * size * size * thickness
    draft, scale = float(draft_of(thickness, density)), drag.ocean_scale
    coefficient = ocean_drag(mass, size, size, size, draft, 1.0, scale, drag.water_side, drag.water_base)  # m-1
    turning = 2.0j * EARTH_ROTATION * sin(lat * DEGREE)  # Velocities are complex: east + i north
    step, speed, distance = 600.0, 0.0j, 0.0
    for _ in range(round(SHOWN_DAYS * SECONDS_PER_DAY / step)):
        rate = coefficient * abs(speed - SHOWN_SPEED)
        push = (turning * slope + rate) * SHOWN_SPEED
        after = ((1.0 - 0.5 * step * turning) * speed + step * push) / (1.0 + 0.5 * step * turning + step * rate)
        distance += 0.5 * step * (speed + after).real
        speed = after
    return distance


def slope_notice(forcing: Forcing, elements: Elements, largest: Ints, parameters: Parameters) -> str:
    """Return the sea level that `auto` assumes and its effect on a berg, or that the given one has gaps.

    ``largest``: rows of the elements of the largest berg.
    """
    if not forcing.assumes_slope or largest.size == 0:
        return forcing.level_gaps
    body, lat = elements.body, float(np.mean(elements.place.lat[largest]))
    area, density = float((body.length[largest] * body.width[largest]).sum()), parameters.ice.density
    size, thickness = math.sqrt(area), float(body.mass[largest].sum()) / (density * area)
    distances = [
        drift_in_current(size, thickness, density, lat, slope=slope, drag=parameters.drag) for slope in (True, False)
    ]
    with_it, without = (
        f"{distance / 1e3:.3g}" if abs(distance) >= 1e3 else f"{distance / 1e3:.1f}" for distance in distances
    )
    big = f"{size / 1e3:.3g} km" if size >= 1e3 else f"{size:.3g} m"
    message = (
        f"no sea level is given: its slope balances the current (in {SHOWN_SPEED:g} m/s a berg of {big} moves {with_it} km in "
        f"two days with it, {without} without)"
    )
    clauses = list(forcing.slope_remarks)
    depth = np.asarray(forcing.depth(elements.place.lon[largest[:1]], elements.place.lat[largest[:1]]), float)
    if (depth >= DEPTH.default).all():
        clauses.append("no depth is given either, so the berg runs aground nowhere")
    return "; ".join([message, *clauses, "sea_level says otherwise: files, geostrophic or none"])
