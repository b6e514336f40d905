"""What holds for one long step of the multiple-time-step scheme."""

from __future__ import annotations

from typing import NamedTuple


class StepPlan(NamedTuple):
    """What holds for one long step.

    Attributes
    ----------
    dt : float
        Length of the long step, s.
    substeps : int
    time : float
        Seconds since the start at its beginning.
    starting : bool
        First step with a proper start: evaluate all forces before moving.
    skip_slow : bool
        Leave out the slow forces (skip_first_outer_mts_step).
    search : bool
        Contact inside a berg goes over candidates of a search, not over broken bonds.
    break_inline, break_after : bool
        Test for fracture in every sub-step, or once after the closing half kick.
    wears : bool
        Stress takes from the strength of the bonds, in every sub-step.
    kicks : bool
        Apply the slow forces at its start: both half kicks, and fracture after the step before.
    moves : bool
        Take its sub-steps.
    closes : bool
        Apply nothing but the slow half kick that completes the step before, for the velocity at the time of the positions.
    threads : int
        Threads for the sub-steps of a large lattice with bonds as beams.
    """

    dt: float
    substeps: int
    time: float
    starting: bool
    skip_slow: bool
    search: bool
    break_inline: bool
    break_after: bool
    wears: bool
    kicks: bool = True
    moves: bool = True
    closes: bool = False
    threads: int = 1
