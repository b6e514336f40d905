"""Parameters and state made ready for the first step: by the berg, checked, completed; a resumed run with its environment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from riftberg.bergs.iceberg import Iceberg
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.fragments.tree import measure_outlines
from riftberg.engines.common.laws import OWN_VARIABLES, ElementLaw
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.speed_limit import refuse_fast_start
from riftberg.engines.common.state_checks import check_state, check_strengths
from riftberg.engines.common.stepper import Stepper, complete_state
from riftberg.engines.schemes import assign_substeps, check_long_step
from riftberg.errors import InputError
from riftberg.parameters import ExplicitParameters, Parameters
from riftberg.start.checks import check_water
from riftberg.state import ELEMENT_VARIABLES, Bonds, Elements, Environment
from riftberg.system.input_files import check_work

if TYPE_CHECKING:
    from riftberg.life.process import LifeProcess


def adopt_packing(p: Parameters, berg: Iceberg) -> Parameters:
    """Return the parameters with the packing of the berg: those of another would give its elements wrong radii."""
    if p.bonds.packing == "hexagonal" and berg.packing == "square" and berg.elements.size:
        raise InputError(
            "bonds.packing = 'hexagonal', but the berg has square elements", where="Model",
            remedy="Make the berg with packing='hexagonal', or leave bonds.packing out: it follows the berg",
        )  # fmt: skip
    return p.changed(bonds={"packing": berg.packing}) if berg.packing != p.bonds.packing else p


def fill_constant_size(p: Parameters, elements: Elements, bonds: Bonds) -> Parameters:
    """Fill in the constant interaction size: if one side is 0, both become the means of all elements (Q37).

    Several bergs have their own means (`riftberg.engines.common.stepper`), unless they are coupled as in the reference.
    """
    if not isinstance(p, ExplicitParameters):
        return p
    b = p.bonds
    if not b.constant_size or (b.constant_length > 0.0 and b.constant_width > 0.0):
        return p
    component = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
    if component.any() and not p.quirks.bergs_coupled:
        return p
    length, width = float(np.mean(elements.length)), float(np.mean(elements.width))
    return p.changed(bonds={"constant_length": length, "constant_width": width})


def make_life(p: Parameters, melt: ElementLaw | None) -> LifeProcess | None:
    """Return the process that changes bergs beside their motion, with a melt law of one's own; None where nothing does."""
    if not (p.melt.enabled or p.rolling.enabled or p.footloose.enabled):
        return None
    from riftberg.life.process import LifeProcess  # a run without melt and calving loads none of it

    return LifeProcess(p, melt)


def prepare_steps(run: RunState) -> None:
    """Refuse a state that cannot be stepped, complete it, and choose its sub-steps."""
    p, elements = run.parameters, run.elements
    check_state(elements, run.bonds, p.earth.latlon)
    check_strengths(run.bonds, p)
    refuse_fast_start(elements, p)
    check_water(run.forcing, p)
    complete_state(run)
    # A number that is given may be larger than an array can hold.
    check_work(1, getattr(p.stepping, "substeps", None) or 1, elements.size, where="stepping.substeps")
    assign_substeps(run, elements.body.substeps == 0)
    check_long_step(run)
    check_work(1, run.substeps, elements.size, where="stepping.substeps")


def resume_environment(run: RunState, stepper: Stepper) -> None:
    """Take the environment of a resumed run from its forcing: the values of its file, unless that run failed by its forcing.

    What a forcing does not give is not known: it may stem from another one, such as the water at a keel. A force of one's own
    may have been taken at velocities that are no more: it stays.
    """
    if not run.elements.body.berg_length.all():  # of a restart file that does not hold it
        measure_outlines(run.elements, run.constants)
    if run.forcing.grid is not None:
        run.forcing.grid.check_cells(run.elements)
    if (
        not run.forcing.given
    ):  # an ocean model that has yet to hand over its fields (`OceanForcing`) would be one at rest
        return
    environment = run.elements.environment
    by_user = [getattr(environment, name) for name in OWN_VARIABLES]
    values_by_user = [array.copy() for array in by_user]
    for variable in ELEMENT_VARIABLES:
        if variable.name in Environment._fields:
            getattr(environment, variable.name)[:] = variable.default
    stepper.sample_forcing(run)
    for array, values in zip(by_user, values_by_user, strict=True):
        array[:] = values
