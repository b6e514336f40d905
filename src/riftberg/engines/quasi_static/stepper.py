"""The default scheme as a model calls it: its memory from one time step to the next, and the stepping of populations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.broad_phase import NO_PAIRS, concatenate_pairs
from riftberg.engines.common.crack_tips import NO_TIPS, TIP_NAMES, CrackTips, tips_from_arrays
from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.forces.pack import check_concentration
from riftberg.engines.common.forces.sizes import Sizes, interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.pose import Bodies
from riftberg.engines.quasi_static.contact.faces import FaceContact
from riftberg.engines.quasi_static.fracture.brittle_lattice import BrittleLattice
from riftberg.engines.quasi_static.fracture.crack_paths import find_rift_tips
from riftberg.engines.quasi_static.ground.seabed import Seabed
from riftberg.engines.quasi_static.lattice.cell_stiffness import CellTopology
from riftberg.engines.quasi_static.lattice.cells import (
    CELL_NAMES,
    ElasticCells,
    add_new_cells,
    cells_from_arrays,
    cells_to_arrays,
)
from riftberg.engines.quasi_static.lattice.footprints import FootprintBook
from riftberg.engines.quasi_static.lattice.sides import FragmentSides
from riftberg.engines.quasi_static.lone_bergs import (
    OneAtATime,
    cut_out_run,
    find_lone_bergs,
    join_bodies,
    select_bodies,
    step_lone_bergs,
)
from riftberg.engines.quasi_static.rigid_step import BodyState, StepSnapshot, sync_bodies, take_snapshot
from riftberg.engines.quasi_static.step import TimeStep, first_bodies
from riftberg.engines.quasi_static.trial import LawsWithMemory, Memory
from riftberg.state import Floats, Ints
from riftberg.state.population import put_back

BODY_NAMES = ("rigid_body", "rigid_shape", "rigid_pose", "rigid_rate", "rigid_bend")
"""Names of the fields of `Bodies` in a restart file."""

SNAPSHOT_NAMES = tuple(f"rigid_left_{name}" for name in StepSnapshot._fields)
"""Names of the fields of `StepSnapshot` there."""


class QuasiStaticStepper:
    """The scheme, with its memory from one time step to the next."""

    def __init__(self, model: RunState) -> None:
        self._bodies: Bodies | None = None
        # The elastic cells of bonded ice are made at the start of a run; a restart holds them from then on.
        self._cells: ElasticCells | None = None
        # Found once as long as ice melts but nothing breaks; beside bergs that go by themselves, of the others that may meet.
        self._cell_topology: CellTopology | None = None
        self._meeting_topology: CellTopology | None = None
        self._tips = NO_TIPS
        if model.bonds.first.size and model.step_number == 0:
            self._cells = add_new_cells(None, model.elements, model.bonds, model.outlines, model.constants)
            self._tips = find_rift_tips(model.elements, model.bonds, model.constants)
        self._footprints = FootprintBook(model)
        self._faces = FaceContact(model, self._footprints)
        aground = model.parameters.grounding.law == "seabed"
        self._seabed = Seabed(model, self._footprints) if aground else None
        self._sides = FragmentSides(self._footprints)
        self._laws = LawsWithMemory(self._seabed, self._faces, self._sides)
        self._lattice: BrittleLattice | None = None
        self._state: BodyState | None = None
        # See `riftberg.engines.common.stepper.Stepper`; ``applied`` by the trapezoidal rule over all parts of the step.
        self.applied: Floats = np.zeros((0, len(FORCES), 2))
        self._topology: list[bytes] = []
        self._sizes: Sizes | None = None
        self.touched = NO_PAIRS
        self._snapshot: StepSnapshot | None = None
        # All of that at the start of the last step, with its time, for a model that takes a failed step back.
        self._last_start: tuple[float, Bodies | None, StepSnapshot | None, ElasticCells | None, CrackTips, Memory] = (
            math.nan, None, None, None, NO_TIPS, (None, None),
        )  # fmt: skip

    @property
    def plastic(self) -> Floats:
        """See `riftberg.engines.common.stepper.Stepper.plastic`."""
        return np.append(self._faces.pairs.dissipated, np.zeros(1) if self._seabed is None else self._seabed.rubbed)

    @property
    def clearance(self) -> float:
        """See `riftberg.engines.common.stepper.Stepper.clearance`."""
        return math.nan if self._seabed is None else float(self._seabed.clearance[0])

    @property
    def tips(self) -> CrackTips:
        """See `riftberg.engines.common.stepper.Stepper.tips`."""
        return self._tips

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays that a restart file must hold beside the state."""
        bodies = {} if self._bodies is None else dict(zip(BODY_NAMES, self._bodies, strict=True))
        snapshot = {} if self._snapshot is None else dict(zip(SNAPSHOT_NAMES, self._snapshot, strict=True))
        tips = dict(zip(TIP_NAMES, self._tips, strict=True)) if self._tips.crack.size else {}
        cells = {} if self._cells is None else cells_to_arrays(self._cells)
        laws = [law.state_dict() for law in (self._footprints, self._seabed, self._faces) if law]
        return {**bodies, **snapshot, **cells, **tips, **{name: array for law in laws for name, array in law.items()}}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore the arrays of `state_dict`."""
        if all(name in saved for name in BODY_NAMES):
            body, *rest = (np.asarray(saved[name]) for name in BODY_NAMES)
            self._bodies = Bodies(body.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in saved for name in SNAPSHOT_NAMES):
            ids, *rest = (np.asarray(saved[name]) for name in SNAPSHOT_NAMES)
            self._snapshot = StepSnapshot(ids.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in saved for name in CELL_NAMES):
            self._cells = cells_from_arrays(saved)
        self._tips = tips_from_arrays(saved)
        for law in (self._footprints, self._seabed, self._faces):
            if law is not None:
                law.load_state_dict(saved)

    def sample_forcing(self, model: RunState) -> None:
        """Sample at the present positions."""
        model.forcing.sample(model.elements, model.time)

    def synchronised(self, model: RunState) -> tuple[Floats, Floats]:
        """Return the velocity, which belongs to the positions."""
        return model.elements.u_sync.copy(), model.elements.v_sync.copy()

    def take_back(self, model: RunState) -> None:
        """See `riftberg.engines.common.stepper.Stepper.take_back`."""
        if self._last_start[0] == model.time:
            _, self._bodies, self._snapshot, self._cells, self._tips, law_states = self._last_start
            self._laws.rollback(law_states)
            self._lattice = self._state = None

    def step(self, model: RunState) -> None:
        """Advance by one time step."""
        check_concentration(model.elements)
        self._last_start = (
            model.time, self._bodies, self._snapshot, self._cells, self._tips, self._laws.checkpoint()
        )  # fmt: skip
        self._footprints.begin_step(model)
        if self._seabed is not None and self._snapshot is not None:
            self._seabed.familiar = self._snapshot.id
        unknown = self._sync(model)
        if self._step_population(model, unknown):
            return
        step = TimeStep(
            model, self._bodies, self._lattice, self._state, self._sizes, unknown, (self._cells, self._cell_topology),
            (self._tips, 0), self._laws,
        )  # fmt: skip
        self._lattice = self._state = None  # a step that fails leaves them half changed
        step.run()
        # After a crack the loads are those of a lattice that has been renumbered since: the next step finds them anew, as a
        # restarted run does.
        self._bodies, self._lattice, self._state = step.state.bodies, step.lattice, None if step.cracked else step.state
        self.applied, self.touched = step.applied, concatenate_pairs(step.touched)
        self._sizes, self._tips = step.motion.sizes, step.tips
        self._cells, self._cell_topology = step.lattice.elastic_cells, step.lattice.topology
        if step.cracked:
            self._topology = _topology_key(model)
        self._snapshot = take_snapshot(model.elements)
        model.time = step.start + model.parameters.time_step

    def _step_population(self, model: RunState, unknown: NDArray[np.bool_] | None) -> bool:
        """Take a step in which most bergs are lone ones, which go by themselves; returns whether it is one."""
        bodies, bonds, c = self._bodies, model.bonds, model.constants
        if model.laws.force is not None or model.laws.drag:  # they may look at all elements
            return False
        if bodies is None:
            bodies = first_bodies(model.elements, bonds, c)
            unknown = np.ones(bodies.pose.shape[0], np.bool_)
        sizes = self._sizes or interaction_sizes(model.elements, c)
        near_floor = None
        if self._seabed is not None:
            near_floor = self._seabed.find_near_floor(model, bodies, model.parameters.time_step)
        lone_bergs = find_lone_bergs(model, bodies, sizes, self._faces, near_floor)
        if lone_bergs is None:
            return False
        lone, unreachable = lone_bergs
        self._lattice = self._state = None
        applied = np.zeros((model.elements.size, len(FORCES), 2))
        groups: list[tuple[Ints, Bodies]] = []
        touched: list[tuple[Ints, Ints]] = []
        highest_crack, cracked = int(bonds.crack.max(initial=0)), False

        def step_group(rows: Ints, group: RunState, **options: Any) -> TimeStep:
            """Take a group, the copy of its rows, through the time step."""
            nonlocal highest_crack, cracked
            group_bodies, numbers = select_bodies(bodies, rows)
            new = None if unknown is None else unknown[numbers]
            step = TimeStep(group, group_bodies, unknown=new, cracks=(self._tips, highest_crack), **options)
            step.run()
            applied[rows] = step.applied
            touched.extend((rows[first], rows[second]) for first, second in step.touched)
            groups.append((rows, step.state.bodies))
            self._cells, self._tips, cracked = step.lattice.elastic_cells, step.tips, cracked or step.cracked
            highest_crack = max(highest_crack, int(group.bonds.crack.max(initial=0)))
            return step

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
                step = step_group(
                    *isolated[:2], cells=(self._cells, self._cell_topology), laws=LawsWithMemory(sides=self._sides)
                )
                self._cell_topology = step.lattice.topology
            if meeting[0].size:
                step = step_group(*meeting[:2], cells=(self._cells, self._meeting_topology), laws=self._laws)
                self._meeting_topology = step.lattice.topology
            else:
                self._faces.forget_pairs()
            blocks = lone_steps.result()
        happened = np.concatenate([block.happened for block in blocks])
        alone = (happened, *cut_out_run(model, happened, forcing))
        if happened.size:
            step_group(*alone[:2], cells=(self._cells, None))
        for rows, group, bond_rows in (isolated, meeting, alone):
            put_back(model.elements, bonds, rows, bond_rows, group.elements, group.bonds)
        groups += [(block.rows, block.bodies) for block in blocks]
        body = connected_parts(model.elements.size, bonds.first, bonds.second, bonds.status)
        self._bodies = join_bodies(body, tuple(groups))
        self.applied, self.touched, self._sizes = applied, concatenate_pairs(touched), sizes
        if cracked:
            self._topology = _topology_key(model)
        self._snapshot = take_snapshot(model.elements)
        model.time += model.parameters.time_step
        return True

    def _sync(self, model: RunState) -> NDArray[np.bool_] | None:
        """Discard the lattice where ice, bonds or supports have changed since the last step, and bring the bodies up to date.

        Returns which bodies take the velocity of their elements; None where all are as the last step has left them.
        """
        topology, count = _topology_key(model), model.elements.size
        same_connectivity = self._topology[:N_CONNECTIVITY] == topology[:N_CONNECTIVITY]
        if self._topology and self._topology != topology:
            self._lattice = self._state = self._sizes = None
        self._topology = topology
        if self._bodies is None:
            return None
        if self._snapshot is None or self._snapshot.id.size != self._bodies.body.size:
            self._bodies = self._bodies if self._bodies.body.size == count else None
        elif not (same_connectivity and self._snapshot.is_current(model.elements)):
            bodies, unknown = sync_bodies(model.elements, model.bonds, self._bodies, self._snapshot, model.constants)
            self._state = None  # given forces may have changed
            if unknown.any() or not np.array_equal(bodies.body, self._bodies.body):
                self._bodies, self._lattice = bodies, None
                return unknown
        return None


def _topology_key(model: RunState) -> list[bytes]:
    """Inputs of bodies and lattice: elements, supports, intact bonds, and ice; as bytes, which compare quickly."""
    body, bonds = model.elements.body, model.bonds
    connectivity = body.id, body.static, body.free_y, bonds.id, bonds.status
    arrays = *connectivity, body.mass, body.thickness, body.length, body.width
    return [array.tobytes() for array in arrays]


N_CONNECTIVITY = 5
"""How many of them are about connectivity: which elements there are, how they are bonded and supported."""
