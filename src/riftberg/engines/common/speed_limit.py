"""A speed that no ice reaches ends a run, in every scheme, and so does a position that is no number.

What such a run would give next is worth nothing, so the reason is given here: the element, its speed, what pushes it, and
the forcing where that is at fault.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.config.units import place_text
from riftberg.engines.common.forces.media import CORIOLIS, FORCES
from riftberg.engines.common.run_state import RunState
from riftberg.errors import InputError, RunError, SpeedError
from riftberg.parameters import Parameters
from riftberg.state import Elements, Environment, Floats

DEBRIS_SPEED: Final = 1000.0
"""Speed (m s-1) that debris may have in runs with the reference's contact; its own output has 100 m s-1."""

MAX_DOT: Final = 10_000
"""Length of vectors above which NumPy may split their product among threads."""

_PUSH: Final = {
    "water": "the drag of the water", "slope": "the slope of the sea surface", "air": "the drag of the wind",
    "sea_ice": "the drag of the sea ice", "waves": "the waves", "sea_floor": "the sea floor",
}  # fmt: skip

EXPONENT: Final = 0x7FF0000000000000
"""Bits of the exponent of a number with double precision."""

KEEL_TEMPERATURE, KEEL_SALINITY = map(Environment._fields.index, ("keel_temperature", "keel_salinity"))

_GIVEN: Final = tuple(n for k, n in enumerate(Environment._fields) if k not in (KEEL_TEMPERATURE, KEEL_SALINITY))
"""What the forcing gives as finite numbers; at the keel NaN means that the value of the surface holds there too."""


def refuse_fast_start(el: Elements, p: Parameters) -> None:
    """Refuse elements that are too fast before the first step, and a velocity to be imposed that is."""
    fixed, limit = p.stepping.fixed_velocity, p.stepping.speed_limit
    remedy = f"No ice is faster than {limit:g} m/s: give m/s, or set stepping.speed_limit if it is meant"
    if fixed is not None and math.hypot(*fixed) > limit:
        raise InputError(f"fixed_velocity of {math.hypot(*fixed):g} m/s", where="stepping", remedy=remedy)
    speed = np.hypot(el.u, el.v)
    if p.quirks.flung_debris and el.size and np.median(speed) <= limit:  # some may be debris, not most
        limit = max(limit, DEBRIS_SPEED)
    if (fast := speed > limit).any():
        k = int(np.argmax(fast))
        raise InputError(
            f"it begins with a speed of {speed[k]:g} m/s",
            where=f"element {int(el.id[k])} (row {k}) at "
            + place_text(float(el.lon[k]), float(el.lat[k]), latlon=p.earth.latlon, digits=5),
            remedy=remedy,
        )


def check_speed(run: RunState, previous: Elements, applied: Floats) -> None:
    """Raise `SpeedError` where an element is faster than ``stepping.speed_limit``, or is nowhere.

    Where all is well, that takes three products of vectors, and four passes more for large bergs.

    ``applied``: mean accelerations (m s-2) over the step, see `riftberg.engines.common.stepper.Stepper`.
    """
    el, limit = run.elements, run.parameters.stepping.speed_limit
    u, v = el.motion.u, el.motion.v
    # A product is finite where all numbers are: infinity times nothing is no number.
    if math.isfinite(_product(el.place.lon, el.place.lat)):
        # If the sum over all is below the limit, so is each; small bergs end here.
        if _product(u, u) + _product(v, v) <= limit * limit:
            return
        # Large bergs may exceed it in the sum alone: then the extremes of each component decide.
        if max(u.max(), -u.min(), v.max(), -v.min()) <= limit / math.sqrt(2.0):
            return
    with np.errstate(all="ignore"):
        speed = np.hypot(u, v)
        nowhere = ~np.isfinite(el.lon + el.lat + speed)
        # Static elements may keep any velocity; it moves nothing.
        fast = nowhere | ((speed > limit) & (el.static < 0.5))
        if fast.any() and run.parameters.quirks.flung_debris:
            fast &= nowhere | (speed > max(limit, DEBRIS_SPEED)) | ~_by_neighbours(run, previous, applied)
        if fast.any():
            raise _error(run, previous, applied, int(np.argmax(fast)))


def _product(a: Floats, b: Floats) -> float:
    """Product of two vectors; long ones would be split among threads, which wait for each other on a busy machine."""
    return float(a.dot(b) if a.size < MAX_DOT else np.einsum("i,i", a, b))


def check_forcing(run: RunState) -> None:
    """Raise `RunError` where the environment that a step ends in is no finite number: a state with it could not go on."""
    if not _is_finite(run.elements.environment):
        refuse_forcing(run, run.elements)


@kernel
def _is_finite(environment: Environment) -> bool:
    """Whether all is a finite number that the forcing gives as one."""
    for k in range(len(environment)):
        if k in (KEEL_TEMPERATURE, KEEL_SALINITY):
            continue
        # All ones in the exponent mark infinity and what is no number: as whole numbers, so that the loop vectorises.
        bits, wrong = environment[k].view(np.int64), False
        for e in range(bits.size):
            wrong |= bits[e] & EXPONENT == EXPONENT
        if wrong:
            return False
    return True


def refuse_forcing(run: RunState, previous: Elements, error: Exception | None = None) -> None:
    """Raise `RunError` where a step has failed on forcing that is no finite number."""
    if at_fault := _describe_forcing_fault(previous, run.elements):
        moment = f"step {run.step_number + 1} ({run.date.isoformat(' ', 'minutes')})"
        raise RunError(f"{moment} cannot be taken. The reason is the forcing: {at_fault}. Correct it there") from error


def _by_neighbours(run: RunState, previous: Elements, applied: Floats) -> np.ndarray:
    """Whether elements owe their speed to their neighbours, now or earlier, more than to any force from outside."""
    partners = np.hypot(*_by_partners(run, previous, applied).T)
    earlier = np.hypot(previous.u, previous.v) > run.parameters.stepping.speed_limit
    outside = np.hypot(applied[..., 0], applied[..., 1]).max(axis=1)
    return np.asarray(earlier | (partners > outside))


def _by_partners(run: RunState, previous: Elements, applied: Floats) -> Floats:
    """Acceleration (m s-2) over the step that no force from outside explains: bonds, contact and loads."""
    el, dt = run.elements, run.parameters.time_step
    change = np.column_stack([el.u - previous.u, el.v - previous.v]) / dt
    return np.asarray(change - applied.sum(axis=1))


def _error(run: RunState, previous: Elements, applied: Floats, k: int) -> SpeedError:
    el, s = run.elements, run.parameters.stepping
    speed = float(np.hypot(el.u[k], el.v[k]))
    movement = f"moves at {speed:.4g} m/s" if math.isfinite(speed) else "has no finite speed"
    origin = f"{previous.lon[k]:.5f}, {previous.lat[k]:.5f}"
    moment = f"in step {run.step_number + 1} ({run.date.isoformat(' ', 'minutes')})"
    head = f"element {int(el.id[k])} {movement} {moment}; it came from {origin}, and no ice is faster than {s.speed_limit:g} m/s"
    if at_fault := _describe_forcing_fault(previous, el):
        return SpeedError(f"{head}. The reason is the forcing: {at_fault}. Correct it there", int(el.id[k]))
    env = previous.environment
    conditions = (
        f"there the water moves at {math.hypot(env.uo[k], env.vo[k]):.3g} m/s, the air at "
        f"{math.hypot(env.ua[k], env.va[k]):.3g} m/s, and the sea surface slopes by "
        f"{math.hypot(env.slope_x[k], env.slope_y[k]):.3g}"
    )
    remedy = "Check the units of the forcing and the size of the berg"
    if s.scheme != "quasi_static":
        remedy += (
            "; where its neighbours push it, use more sub-steps (stepping.substeps), a shorter step or a softer berg"
        )
    text = f"{head}. {_largest(run, previous, applied, k)}; {conditions}. {remedy}. If it is meant, set stepping.speed_limit"
    return SpeedError(text, int(el.id[k]))


def _describe_forcing_fault(previous: Elements, current: Elements) -> str:
    """Name a value of the forcing that is no finite number, and its place; empty where all are finite."""
    for el in (previous, current):
        for name in _GIVEN:
            values = getattr(el.environment, name)
            if not np.isfinite(values).all() and np.isfinite(el.lon).all():
                k = int(np.argmin(np.isfinite(values)))
                return f"{name} = {values[k]} at element {int(el.id[k])} ({el.lon[k]:.5f}, {el.lat[k]:.5f})"
    return ""


def _largest(run: RunState, previous: Elements, applied: Floats, k: int) -> str:
    """Name the largest force on an element; the Coriolis force turns, and drives nothing."""
    if applied.shape[0] != run.elements.size:
        return "The step did not come to its end"
    mass = float(previous.body.mass[k])
    forces = {
        _PUSH.get(name, name.replace("_", " ")): math.hypot(*applied[k, row])
        for row, name in enumerate(FORCES)
        if row != CORIOLIS
    }
    forces["the push of its neighbours (bonds, contact, loads)"] = math.hypot(*_by_partners(run, previous, applied)[k])
    # A force that is no number explains more than any that is.
    name = max(forces, key=lambda n: math.inf if math.isnan(forces[n]) else forces[n])
    return f"The largest force on it is {name}, {mass * forces[name]:.3g} N"
