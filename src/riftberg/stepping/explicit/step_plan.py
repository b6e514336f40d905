"""What holds for one long step of the multiple-time-step scheme."""

from __future__ import annotations

from typing import NamedTuple


class StepPlan(NamedTuple):
    """What holds for one long step."""

    dt: float  # Length of the long step, s
    substeps: int
    time: float  # Seconds since the start at its beginning
    starting: bool  # First step with a proper start: evaluate all forces before moving
    skip_outer: bool  # Leave out the slow forces (skip_first_outer_mts_step)
    by_search: bool  # Contact inside a berg goes over candidates of a search, not over broken bonds
    break_inline: bool  # Test for fracture in every sub-step, or once after the closing half kick
    break_after: bool  # Test for fracture in every sub-step, or once after the closing half kick
    grow_damage: bool  # Stress takes from the strength of the bonds, in every sub-step
    apply_outer: bool = True  # Apply the slow forces at its start: both half kicks, and fracture after the step before
    apply_inner: bool = True  # Take its sub-steps
    # Apply nothing but the slow half kick that completes the step before, for the velocity at the time of the positions
    sync_only: bool = False
    threads: int = 1  # Threads for the sub-steps of a large lattice with bonds as beams
