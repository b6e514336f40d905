"""The default scheme as a model calls it: its memory from one time step to the next, and the stepping of populations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.broad_phase import NO_PAIRS, concatenate_pairs
from riftberg.engines.common.crack_tips import CrackTips
from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.forces.pack import check_concentration
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.pose import Bodies
from riftberg.engines.quasi_static.lattice.cell_stiffness import CellTopology
from riftberg.engines.quasi_static.lone_bergs import (
    OneAtATime,
    cut_out_run,
    find_lone_bergs,
    join_bodies,
    select_bodies,
    step_lone_bergs,
)
from riftberg.engines.quasi_static.memory import LawsWithMemory, Memory
from riftberg.engines.quasi_static.rigid_step import sync_bodies, take_snapshot
from riftberg.engines.quasi_static.step import TimeStep, first_bodies
from riftberg.state import Floats, Ints
from riftberg.state.population import put_back


class QuasiStaticStepper:
    """The scheme, with its memory from one time step to the next."""

    def __init__(self, model: RunState) -> None:
        self.memory = Memory.at_start(model)
        # See `riftberg.engines.common.stepper.Stepper`; ``applied`` by the trapezoidal rule over all parts of the step.
        self.applied: Floats = np.zeros((0, len(FORCES), 2))
        self.touched = NO_PAIRS
        # The memory at the start of the last step, with its time, for a model that takes a failed step back.
        self._last_start = math.nan, self.memory, self.memory.laws.checkpoint()

    @property
    def plastic(self) -> Floats:
        """See `riftberg.engines.common.stepper.Stepper.plastic`."""
        seabed, faces, _ = self.memory.laws
        crushed = np.zeros(1) if faces is None else faces.pairs.dissipated
        return np.append(crushed, np.zeros(1) if seabed is None else seabed.rubbed)

    @property
    def clearance(self) -> float:
        """See `riftberg.engines.common.stepper.Stepper.clearance`."""
        seabed = self.memory.laws.seabed
        return math.nan if seabed is None else float(seabed.clearance[0])

    @property
    def tips(self) -> CrackTips:
        """See `riftberg.engines.common.stepper.Stepper.tips`."""
        return self.memory.tips

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays that a restart file must hold beside the state."""
        return self.memory.to_arrays()

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore the arrays of `state_dict`."""
        self.memory = self.memory.resumed(saved)

    def sample_forcing(self, model: RunState) -> None:
        """Sample at the present positions."""
        model.forcing.sample(model.elements, model.time)

    def synchronised(self, model: RunState) -> tuple[Floats, Floats]:
        """Return the velocity, which belongs to the positions."""
        return model.elements.u_sync.copy(), model.elements.v_sync.copy()

    def take_back(self, model: RunState) -> None:
        """See `riftberg.engines.common.stepper.Stepper.take_back`."""
        time, memory, law_states = self._last_start
        if time == model.time:
            # A step that fails leaves lattice and loads half changed.
            self.memory = memory._replace(lattice=None, state=None)
            memory.laws.rollback(law_states)

    def step(self, model: RunState) -> None:
        """Advance by one time step."""
        check_concentration(model.elements)
        memory = self.memory
        self._last_start = model.time, memory, memory.laws.checkpoint()
        if memory.footprints is not None:
            memory.footprints.begin_step(model)
        if memory.laws.seabed is not None and memory.snapshot is not None:
            memory.laws.seabed.familiar = memory.snapshot.id
        unknown = self._sync(model)
        if self._step_population(model, unknown):
            return
        step = TimeStep(model, self.memory, unknown)
        step.run()
        key = _topology_key(model) if step.cracked else self.memory.topology_key
        self.memory = step.remember(take_snapshot(model.elements), key)
        self.applied, self.touched = step.applied, concatenate_pairs(step.touched)
        model.time = step.start + model.parameters.time_step

    def _step_population(self, model: RunState, unknown: NDArray[np.bool_] | None) -> bool:
        """Take a step in which most bergs are lone ones, which go by themselves; returns whether it is one."""
        memory, bonds, c = self.memory, model.bonds, model.constants
        seabed, faces, sides = memory.laws
        if model.laws.force is not None or model.laws.drag or faces is None:  # a force may look at all elements
            return False
        bodies = memory.bodies
        if bodies is None:
            bodies = first_bodies(model.elements, bonds, c)
            unknown = np.ones(bodies.pose.shape[0], np.bool_)
        sizes = memory.sizes or interaction_sizes(model.elements, c)
        lone_bergs = find_lone_bergs(model, bodies, sizes, faces, seabed)
        if lone_bergs is None:
            return False
        lone, unreachable = lone_bergs
        memory = self.memory = memory._replace(lattice=None, state=None, sizes=None)
        applied = np.zeros((model.elements.size, len(FORCES), 2))
        groups: list[tuple[Ints, Bodies]] = []
        touched: list[tuple[Ints, Ints]] = []
        highest_crack, cracked = int(bonds.crack.max(initial=0)), False

        def step_group(rows: Ints, group: RunState, laws: LawsWithMemory, topology: CellTopology | None) -> Memory:
            """Take a group, the copy of its rows, through the time step; returns its memory."""
            nonlocal highest_crack, cracked, memory
            group_bodies, numbers = select_bodies(bodies, rows)
            new = None if unknown is None else unknown[numbers]
            step = TimeStep(
                group, memory._replace(bodies=group_bodies, laws=laws, topology=topology), new, highest_crack
            )
            step.run()
            applied[rows] = step.applied
            touched.extend((rows[first], rows[second]) for first, second in step.touched)
            groups.append((rows, step.state.bodies))
            after, cracked = step.remember(), cracked or step.cracked
            memory = memory._replace(cells=after.cells, tips=after.tips)
            highest_crack = max(highest_crack, int(group.bonds.crack.max(initial=0)))
            return after

        # Events cut the step of each group alone: fragments of several elements that nobody may touch, and all that may meet
        # others or the floor.
        # They are copies, so that other threads may step the lone bergs meanwhile.
        reachable = ~unreachable
        reachable[lone] = False
        forcing = OneAtATime(model.forcing)
        isolated, meeting = (
            (rows, *cut_out_run(model, rows, forcing)) for rows in map(np.flatnonzero, (unreachable, reachable))
        )
        with ThreadPoolExecutor(1) as beside:
            lone_steps = beside.submit(step_lone_bergs, model, forcing, bodies, unknown, lone, sizes, applied)
            if isolated[0].size:
                after = step_group(*isolated[:2], LawsWithMemory(sides=sides), memory.topology)
                memory = memory._replace(topology=after.topology)
            if meeting[0].size:
                after = step_group(*meeting[:2], memory.laws, memory.meeting_topology)
                memory = memory._replace(meeting_topology=after.topology)
            else:
                faces.forget_pairs()
            blocks = lone_steps.result()
        happened = np.concatenate([block.happened for block in blocks])
        alone = (happened, *cut_out_run(model, happened, forcing))
        if happened.size:
            step_group(*alone[:2], LawsWithMemory(), None)
        for rows, group, bond_rows in (isolated, meeting, alone):
            put_back(model.elements, bonds, rows, bond_rows, group.elements, group.bonds)
        groups += [(block.rows, block.bodies) for block in blocks]
        body = connected_parts(model.elements.size, bonds.first, bonds.second, bonds.status)
        self.memory = memory._replace(
            bodies=join_bodies(body, tuple(groups)), snapshot=take_snapshot(model.elements), sizes=sizes,
            topology_key=_topology_key(model) if cracked else memory.topology_key,
        )  # fmt: skip
        self.applied, self.touched = applied, concatenate_pairs(touched)
        model.time += model.parameters.time_step
        return True

    def _sync(self, model: RunState) -> NDArray[np.bool_] | None:
        """Discard the lattice where ice, bonds or supports have changed since the last step, and bring the bodies up to date.

        Returns which bodies take the velocity of their elements; None where all are as the last step has left them.
        """
        key, count = _topology_key(model), model.elements.size
        previous_key = self.memory.topology_key
        same_connectivity = previous_key[:N_CONNECTIVITY] == key[:N_CONNECTIVITY]
        if previous_key and previous_key != key:
            self.memory = self.memory._replace(lattice=None, state=None, sizes=None)
        if previous_key != key:
            self.memory = self.memory._replace(topology_key=key)
        bodies, snapshot = self.memory.bodies, self.memory.snapshot
        if bodies is None:
            return None
        if snapshot is None or snapshot.id.size != bodies.body.size:
            self.memory = self.memory if bodies.body.size == count else self.memory._replace(bodies=None)
        elif not (same_connectivity and snapshot.is_current(model.elements)):
            synced, unknown = sync_bodies(model.elements, model.bonds, bodies, snapshot, model.constants)
            self.memory = self.memory._replace(state=None)  # given forces may have changed
            if unknown.any() or not np.array_equal(synced.body, bodies.body):
                self.memory = self.memory._replace(bodies=synced, lattice=None)
                return unknown
        return None


def _topology_key(model: RunState) -> tuple[bytes, ...]:
    """Inputs of bodies and lattice: elements, supports, intact bonds, and ice; as bytes, which compare quickly."""
    body, bonds = model.elements.body, model.bonds
    connectivity = body.id, body.static, body.free_y, bonds.id, bonds.status
    arrays = *connectivity, body.mass, body.thickness, body.length, body.width
    return tuple(array.tobytes() for array in arrays)


N_CONNECTIVITY = 5
"""How many of them are about connectivity: which elements there are, how they are bonded and supported."""
