"""Memory of the quasi-static engine: all that lives from one time step to the next, and what of it a restart file holds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from riftberg.engines.common.crack_tips import NO_TIPS, TIP_NAMES, CrackTips, tips_from_arrays
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.dynamics import BodyWorkspace
from riftberg.engines.quasi_static.bodies.pose import Bodies
from riftberg.engines.quasi_static.contact.faces import FaceContact, FacePairs
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
from riftberg.engines.quasi_static.rigid_step import BodyState, StepSnapshot
from riftberg.state import Floats

BODY_NAMES = ("rigid_body", "rigid_shape", "rigid_pose", "rigid_rate", "rigid_bend")
"""Names of the fields of `Bodies` in a restart file."""

SNAPSHOT_NAMES = tuple(f"rigid_left_{name}" for name in StepSnapshot._fields)
"""Names of the fields of `StepSnapshot` there."""

LawStates = tuple[tuple[Floats, Floats] | None, FacePairs | None]
"""Work of friction on the sea floor and the least clearance above it, and faces that press each other."""


class LawsWithMemory(NamedTuple):
    """Laws that keep something from one step to the next: a bed of sediment if it is chosen, faces where fragments may meet.

    ``sides``: the outlines of the fragments on which the water drags; without them it drags by a mean over all directions.
    """

    seabed: Seabed | None = None
    faces: FaceContact | None = None
    sides: FragmentSides | None = None

    def checkpoint(self) -> LawStates:
        """Return the values that a step changes in them."""
        return (
            None if self.seabed is None else self.seabed.checkpoint(),
            None if self.faces is None else self.faces.pairs,
        )

    def rollback(self, saved: LawStates) -> None:
        """Return to the values of `checkpoint`."""
        bed, pairs = saved
        if self.seabed is not None and bed is not None:
            self.seabed.rollback(bed)
        if self.faces is not None and pairs is not None:
            self.faces.pairs = pairs


class Memory(NamedTuple):
    """Fragments, ice and laws at the end of a time step, for the next one; a step makes a new one of it.

    A restart file holds the first seven; the others are found anew. What the laws keep changes within a step (`LawsWithMemory`).
    """

    bodies: Bodies | None = None
    snapshot: StepSnapshot | None = None  # The elements at the end of the step
    cells: ElasticCells | None = None  # Of bonded ice, made at the start of a run
    tips: CrackTips = NO_TIPS
    laws: LawsWithMemory = LawsWithMemory()
    longest_trial: float = math.inf  # Next trial step, s, while others push fragments over the bed

    footprints: FootprintBook | None = None  # Of the fragments, for the laws
    topology_key: tuple[bytes, ...] = ()  # Of the elements, bonds and ice to which the following belongs
    lattice: BrittleLattice | None = None
    state: BodyState | None = None  # Of the fragments under their loads
    sizes: Sizes | None = None
    workspace: BodyWorkspace | None = None
    # Of the mesh of cells, as long as nothing breaks; beside lone bergs, of the others that may meet
    topology: CellTopology | None = None
    meeting_topology: CellTopology | None = None

    @classmethod
    def at_start(cls, model: RunState) -> Memory:
        """Return the memory before the first step, or before `resumed`."""
        cells, tips = None, NO_TIPS
        if model.bonds.first.size and model.step_number == 0:
            cells = add_new_cells(None, model.elements, model.bonds, model.outlines, model.constants)
            tips = find_rift_tips(model.elements, model.bonds, model.constants)
        footprints = FootprintBook(model)
        seabed = Seabed(model, footprints) if model.parameters.grounding.law == "seabed" else None
        laws = LawsWithMemory(seabed, FaceContact(model, footprints), FragmentSides(footprints))
        return cls(cells=cells, tips=tips, laws=laws, footprints=footprints)

    def to_arrays(self) -> dict[str, Any]:
        """Return the arrays that a restart file must hold beside the state."""
        bodies = {} if self.bodies is None else dict(zip(BODY_NAMES, self.bodies, strict=True))
        snapshot = {} if self.snapshot is None else dict(zip(SNAPSHOT_NAMES, self.snapshot, strict=True))
        tips = dict(zip(TIP_NAMES, self.tips, strict=True)) if self.tips.crack.size else {}
        cells = {} if self.cells is None else cells_to_arrays(self.cells)
        laws = [law.state_dict() for law in (self.footprints, self.laws.seabed, self.laws.faces) if law]
        # Files hold finite numbers: no length stands for an endless one.
        trial = {"longest_trial": np.array([self.longest_trial])} if math.isfinite(self.longest_trial) else {}
        return {
            **bodies,
            **snapshot,
            **cells,
            **tips,
            **trial,
            **{name: array for law in laws for name, array in law.items()},
        }

    def resumed(self, saved: Mapping[str, Any]) -> Memory:
        """Return the memory with the arrays of `to_arrays`; its laws take theirs."""
        bodies, snapshot, cells = self.bodies, self.snapshot, self.cells
        if all(name in saved for name in BODY_NAMES):
            body, *rest = (np.asarray(saved[name]) for name in BODY_NAMES)
            bodies = Bodies(body.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in saved for name in SNAPSHOT_NAMES):
            ids, *rest = (np.asarray(saved[name]) for name in SNAPSHOT_NAMES)
            snapshot = StepSnapshot(ids.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in saved for name in CELL_NAMES):
            cells = cells_from_arrays(saved)
        for law in (self.footprints, self.laws.seabed, self.laws.faces):
            if law is not None:
                law.load_state_dict(saved)
        longest_trial = float(np.asarray(saved.get("longest_trial", math.inf)).item())
        return self._replace(
            bodies=bodies,
            snapshot=snapshot,
            cells=cells,
            tips=tips_from_arrays(saved),
            longest_trial=longest_trial,
        )
