"""Room for one value per element in the sub-steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.state import Floats


class Scratch(NamedTuple):
    """Room for one value per element in the sub-steps.

    1 where it moves; 1 where it waits for sub-steps of its own; how far it is aground (0 to 1); 1 over its mass (kg-1) and its
    inertia (kg-1 m-2); drag of the sea floor: its linear rate (s-1), quadratic coefficient (m-1), rate at the
    velocity now, what an implicit sub-step leaves of velocity and of spin (0 to 1), and sum of its decelerations (m s-2);
    accelerations.
    """

    active: Floats
    subcycled: Floats
    aground: Floats
    per_mass: Floats
    per_inertia: Floats
    ground_linear: Floats
    ground_quadratic: Floats
    ground_rate: Floats
    ground_decay: Floats
    ground_spin_decay: Floats
    floor_impulse_x: Floats
    floor_impulse_y: Floats
    accel_x: Floats
    accel_y: Floats


def allocate_scratch(count: int) -> Scratch:
    """Return zeroed scratch rows for ``count`` elements."""
    return Scratch(*(np.zeros(count) for _ in Scratch._fields))
