"""The lattice of the intact bonds, with the factors of its stiffness and its fracture criterion.

It holds between two breaks. A broken bond corrects the factors; where pieces part, or many bonds have broken, the lattice is
described and factored anew.
"""

from __future__ import annotations

from weakref import ref

import numpy as np

from riftberg.engines.common.crack_tips import CrackTips
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.pose import Bodies, tangent_coordinates
from riftberg.engines.quasi_static.fracture.crack_paths import CrackPaths
from riftberg.engines.quasi_static.fracture.criteria import (
    FLEXURAL,
    NORMAL,
    SHEAR,
    Equilibrium,
    Strengths,
    make_criterion,
    overloads,
    residual_strengths,
)
from riftberg.engines.quasi_static.lattice.cell_stiffness import CellStiffness, CellTopology
from riftberg.engines.quasi_static.lattice.cells import ElasticCells, add_new_cells
from riftberg.engines.quasi_static.lattice.equilibrium import Supports, find_lattice
from riftberg.engines.quasi_static.lattice.solver import StiffnessSolver
from riftberg.physics.bonds import stress_ratio
from riftberg.state import Floats, Ints

MAX_LOW_RANK_UPDATES = 90
"""Rank of the correction for broken bonds beyond which the stiffness matrix is factored anew: about where that is quicker."""


class BrittleLattice:
    """The intact bonds of the fragments of a model, described and factored.

    ``cells``: the elastic cells of the ice, and the topology of their mesh if it is known; both are found anew as far as ice or
    bonds have changed. ``tips``: of cracks; ``last_crack``: the highest number of a crack in the run, which may be one in ice
    that is not here.
    """

    def __init__(
        self, model: RunState, bodies: Bodies, sizes: Sizes, cells: tuple[ElasticCells | None, CellTopology | None],
        tips: CrackTips, last_crack: int,
    ) -> None:  # fmt: skip
        el, bonds, c = model.elements, model.bonds, model.constants
        self._known, self._sizes, self._tips, self._last_crack = ref(model), sizes, tips, last_crack
        self.xy = tangent_coordinates(
            bodies.reference, c.latlon, c.earth_radius
        )  # m, in their fragments; (elements, 2)
        self.lattice = find_lattice(bonds, self.xy, el.thickness, sizes, c)
        self.intact = np.flatnonzero(bonds.status == 0)  # as rows of the state
        self.supports = Supports(el.static, el.free_y)
        self.elastic_cells, self.topology = cells
        # Of bonded ice: elements that nothing joins are rigid, and bear no loads.
        self.cells: CellStiffness | None = None
        self.paths: CrackPaths | None = None
        self._solver: StiffnessSolver | None = None
        if self.intact.size:
            self.elastic_cells = add_new_cells(self.elastic_cells, el, bonds, (), c)
            self.cells = CellStiffness(self.elastic_cells, el, bonds, bodies.body, self.xy, c, self.topology)
            self.topology, gauge_springs = self.cells.topology, self.supports.gauge_springs(bodies.body, self.xy)
            self._solver = StiffnessSolver(self.cells, self.lattice, self.intact, self.supports, gauge_springs)
        self.criterion = make_criterion(model.parameters.fracture, model.laws.fracture)
        self._latest: Equilibrium | None = None
        self._strengths: tuple[tuple[int, bytes, bytes], Strengths] | None = None
        self.follow_cracks(bodies, tips)

    @property
    def _model(self) -> RunState:
        """The model, which holds this lattice: held in turn it would stay in memory until Python looks for cycles."""
        model = self._known()
        assert model is not None
        return model

    def follow_cracks(self, bodies: Bodies, tips: CrackTips) -> None:
        """Find where the tips of cracks stand in the fragments."""
        if self.cells is not None:
            model = self._model
            self.paths = CrackPaths(
                tips, model.bonds, model.elements.body.id, bodies.body, self.xy, self.cells, self._last_crack
            )  # fmt: skip

    @property
    def tips(self) -> CrackTips:
        """The tips of cracks, as the last break has left them."""
        return self._tips if self.paths is None else self.paths.tips

    def tips_with_intensities(self, equilibrium: Equilibrium) -> CrackTips:
        """Return the tips of cracks with their stress intensity in an equilibrium, as far as it can be told."""
        return (
            self.tips
            if self.paths is None or not self.tips.crack.size
            else self.paths.with_intensities(equilibrium.intensities)
        )

    def anew(self, bodies: Bodies) -> BrittleLattice:
        """Return the lattice of the bonds that are intact now."""
        cells = self.elastic_cells, self.topology
        return BrittleLattice(self._model, bodies, self._sizes, cells, self.tips, self._last_crack)

    def displacements(self, load: Floats) -> Floats:
        """Displacements (m, m, rad) of the elements under balanced loads; see `StiffnessSolver.solve`."""
        return np.zeros(load.shape) if self._solver is None else self._solver.solve(load)

    @property
    def update_rank(self) -> int:
        """Rank of the correction of the factors for bonds that have broken since."""
        return 0 if self._solver is None else self._solver.update_rank

    def remove(self, bond: int) -> None:
        """Correct the factors for a bond that has broken."""
        assert self._solver is not None
        self._solver.downdate(bond)
        self.intact = self.intact[self.intact != bond]

    def strengths(self) -> Strengths:
        """Return the residual strengths of the intact bonds, found anew where strength or damage has changed.

        Where ice has melted the lattice is another one.
        """
        bonds = self._model.bonds
        key = self.intact.size, bonds.strength.tobytes(), bonds.damage.tobytes()
        if self._strengths is None or self._strengths[0] != key:
            thickness = self._model.elements.thickness
            self._strengths = key, residual_strengths(thickness, bonds, self.intact, self._model.constants)
        return self._strengths[1]

    def equilibrium(self, displacement: Floats, load: Floats) -> Equilibrium:
        """Return the equilibrium with these displacements; the latest is cached, so that its stresses are found once."""
        latest, intact = self._latest, self.intact
        if latest and latest.displacement is displacement and latest.load is load and latest.intact is intact:
            return latest
        self._latest = self.moment(displacement, load)
        return self._latest

    def moment(self, displacement: Floats, load: Floats) -> Equilibrium:
        """Return the equilibrium with some displacements under some load."""
        return Equilibrium(self.lattice, self.intact, displacement, load, self.cells, self.paths)

    # Which bond breaks

    def overload(self, equilibrium: Equilibrium | None) -> float:
        """Event function of fracture: stress over strength in the most critical place, less 1; negative without one."""
        return -1.0 if equilibrium is None else self.critical_bond(equilibrium)[1] - 1.0

    def critical_bond(self, equilibrium: Equilibrium) -> tuple[int, float]:
        """Row in the state of the bond that breaks next (-1 without bonds), and stress over strength: above 1 it breaks."""
        row, ratio = self.criterion.most_critical(equilibrium, self.strengths())
        if self._model.parameters.fracture.flexural_strength is not None and equilibrium.intact.size:
            bending = self._bending_ratios(equilibrium.intact)
            if (most_bent := float(bending.max())) > max(ratio, 1.0):
                return int(equilibrium.intact[bending.argmax()]), most_bent
        return (int(equilibrium.intact[row]) if row >= 0 else -1), ratio

    def _bending_ratios(self, intact: Ints) -> Floats:
        """Bending stress over flexural strength of some bonds; 0 where bending breaks nothing."""
        bonds, strength = self._model.bonds, self._model.parameters.fracture.flexural_strength
        if strength is None:
            return np.zeros(intact.size)
        residual = strength * bonds.strength[intact] * (1.0 - bonds.damage[intact])
        stress = bonds.flexural_stress[intact]
        return np.where(
            residual > 0.0, stress / np.where(residual > 0.0, residual, 1.0), np.where(stress > 0.0, np.inf, 0.0)
        )

    def exceeded(self, equilibrium: Equilibrium, bond: int) -> int:
        """Which strength a bond exceeds most: normal, shear or flexural."""
        row, residual = int(np.searchsorted(equilibrium.intact, bond)), self.strengths()
        ratios = [
            stress_ratio(equilibrium.stress[row, 0], 0.0, residual.normal[row], residual.shear[row]),
            stress_ratio(0.0, equilibrium.stress[row, 1], residual.normal[row], residual.shear[row]),
            self._bending_ratios(equilibrium.intact[row : row + 1])[0],
        ]
        return (NORMAL, SHEAR, FLEXURAL)[int(np.argmax(ratios))]

    def next_bond(self, equilibrium: Equilibrium, failing: int) -> int:
        """Return the bond that breaks where one fails: the next one on the way of a crack line."""
        if self.exceeded(equilibrium, failing) == FLEXURAL:  # bending says itself along which line
            return failing
        assert self.paths is not None
        row, count = int(np.searchsorted(equilibrium.intact, failing)), self._model.bonds.first.size
        strengths, ratio, strength = self.strengths(), np.zeros(count), np.zeros(count)
        ratio[equilibrium.intact], strength[equilibrium.intact] = (
            overloads(equilibrium.stress, strengths),
            strengths.normal,
        )
        last = row in equilibrium.bridges
        return self.paths.next_bond(
            failing,
            last,
            equilibrium.tensor[row],
            equilibrium.triangle_stress,
            ratio,
            strength,
            equilibrium.intensities,
        )

    def facet_area(self, bond: int) -> float:
        """Area (m2) of the side along which the cells of a bond meet."""
        assert self.cells is not None
        return self.cells.facet_area(self.lattice, bond)
