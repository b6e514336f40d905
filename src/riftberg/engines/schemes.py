"""The door to the engines: the choice of the scheme, and the two in which no force moves the ice.

Modules of an engine are imported by that engine alone; modules that both share lie in `riftberg.engines.common`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from riftberg.config.explicit_groups import ExplicitStepping
from riftberg.engines.common.broad_phase import NO_PAIRS
from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.stepper import (
    Stateless,
    Stepper,
    apply_boundaries,
    publish_positions,
    sample_between_steps,
)
from riftberg.parameters import ExplicitParameters, Parameters
from riftberg.state import Bonds, Elements, Floats, Ints


def make_stepper(run: RunState) -> Stepper:
    """Return the stepper of the scheme that the parameters name.

    A run imports no engine but its own; at a given velocity (`stepping.fixed_velocity`) ice goes by the single step of the
    explicit one.
    """
    stepping = run.parameters.stepping
    scheme = stepping.scheme
    if isinstance(stepping, ExplicitStepping) and stepping.frozen:
        return FrozenStepper()
    if stepping.fixed_velocity is not None and scheme in ("mts", "quasi_static"):
        return ImposedStepper()
    if scheme == "mts":
        from riftberg.engines.explicit.mts import MultipleStepper

        return MultipleStepper(run)
    if scheme == "quasi_static":
        from riftberg.engines.quasi_static.stepper import QuasiStaticStepper

        return QuasiStaticStepper(run)
    from riftberg.engines.explicit.single_step import RungeKuttaStepper, VerletStepper

    return VerletStepper(run) if scheme == "verlet" else RungeKuttaStepper(run)


def assign_substeps(run: RunState, chosen: NDArray[np.bool_]) -> None:
    """Choose the number of sub-steps of the bergs to which the ``chosen`` elements belong; 1 in a scheme without sub-steps."""
    if not chosen.any():
        return
    if not run.parameters.stepping.has_substeps:
        run.elements.body.substeps[:] = 1
        return
    from riftberg.engines.explicit.stability import assign_to_bergs

    assign_to_bergs(run, chosen)


def size_bins(run: RunState) -> tuple[Floats, ...]:
    """Return bins of the sizes on which the number of sub-steps depends, for each element; none in a scheme without sub-steps."""
    if not run.parameters.stepping.has_substeps:
        return ()
    from riftberg.engines.explicit import stability

    return stability.size_bins(run.elements)


def check_long_step(run: RunState) -> None:
    """Refuse a long step that springs cannot bear which act in it."""
    if isinstance(run.parameters, ExplicitParameters):
        from riftberg.engines.explicit import stability

        stability.check_long_step(run)


def resonance_warning(elements: Elements, bonds: Bonds, parameters: Parameters) -> str:
    """Return a warning where the stress in the bonds of a run rings, else nothing."""
    if not parameters.stepping.has_substeps:
        return ""
    from riftberg.engines.explicit import stability

    return stability.resonance_warning(elements, bonds, parameters)


class FrozenStepper(Stateless):
    """Nothing moves: time goes on, and the environment with it."""

    def __init__(self) -> None:
        self._applied = np.zeros((0, len(FORCES), 2))

    def step(self, run: RunState) -> None:
        """Advance by one long step."""
        self._move(run)
        run.time += run.parameters.time_step
        self._applied = np.zeros((run.elements.size, len(FORCES), 2))
        self.sample_forcing(run)

    def _move(self, run: RunState) -> None:
        """Leave everything where it is."""

    def sample_forcing(self, run: RunState) -> None:
        """See `riftberg.engines.common.stepper.Stepper.sample_forcing`."""
        sample_between_steps(run, run.elements)

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Return the velocity unchanged."""
        return run.elements.u.copy(), run.elements.v.copy()

    @property
    def applied(self) -> Floats:
        """No force has acted."""
        return self._applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """Nothing has met."""
        return NO_PAIRS


class ImposedStepper(FrozenStepper):
    """Bergs go at an imposed velocity whatever acts on them, in the schemes that have sub-steps (equations 4.2)."""

    def _move(self, run: RunState) -> None:
        from riftberg.engines.explicit.single_step import update_positions

        el, p, imposed = run.elements, run.parameters, run.parameters.stepping.fixed_velocity
        publish_positions(el)
        moving, kicks = el.static < 0.5, el.kicks
        for kick in kicks:
            kick[moving] = 0.0
        if imposed is not None and not p.quirks.imposed_velocity_late:
            el.u[moving], el.v[moving] = imposed
        count = int(el.substeps.max(initial=1))
        for _ in range(count):
            update_positions(el, p.time_step / count, run.constants)
        el.rotation[moving] += p.time_step * el.spin[moving]
        for values, copies in ((el.u, (el.u_pair, el.u_sync)), (el.v, (el.v_pair, el.v_sync))):
            for copy in copies:
                copy[moving] = values[moving]
        apply_boundaries(run)
