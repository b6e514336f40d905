"""Bergs on a plane that are loaded by hand, and the lattice in which the engine has them in equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.state import Floats
from twins.equilibrium import balanced

RADIUS, THICKNESS, SPACING = 750.0, 200.0, 1500.0
STRENGTH = 18e3


class Plate:
    """A berg of a turned lattice on which nothing acts but given forces, with strengths alike; nothing breaks of itself.

    It takes steps of a microsecond, in each of which the engine finds its equilibrium.
    """

    def __init__(
        self, packing: str, angle: float, length: float, width: float, berg: Iceberg | None = None,
        bonds: dict[str, Any] | None = None, **fracture: Any,
    ) -> None:  # fmt: skip
        made = berg or Iceberg.rectangle(
            length, width, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
        )
        el = made.elements
        density = float(el.mass.sum() / (el.thickness * el.length * el.width).sum())
        parameters = Parameters(
            ice={"density": density}, earth={"latlon": True} if made.latlon else {"latlon": False, "period": 0.0},
            bonds={"packing": packing} | (bonds or {}),
            fracture={"enabled": False, "normal_strength": STRENGTH, "shear_strength": 1e9} | fracture,
            stepping={"only_interactions": True, "time_step": 1e-6},
        )  # fmt: skip
        self.model = Model(made, Forcing.uniform(), parameters)
        self.el, self.bonds = self.model.elements, self.model.bonds
        self.x, self.y = self.el.lon.copy(), self.el.lat.copy()
        self.model.step()

    @classmethod
    def of(cls, berg: Iceberg, bonds: dict[str, Any] | None = None, **fracture: Any) -> Plate:
        """Lay down a berg of any shape."""
        return cls(berg.packing, 0.0, 0.0, 0.0, berg, bonds, **fracture)

    @property
    def memory(self) -> Any:
        """What the engine keeps from one step to the next."""
        return self.model._stepper.memory  # type: ignore[attr-defined]

    @property
    def now(self) -> Any:
        """The lattice of the bonds that are intact, with its factors, elastic cells and cracks."""
        return self.memory.lattice

    @property
    def body(self) -> Any:
        """Number of the piece of each element."""
        return self.memory.bodies.body

    @property
    def tips(self) -> Any:
        """The tips of cracks."""
        return self.memory.tips

    @property
    def area(self) -> float:
        """Area (m2) of the mesh of the elastic cells."""
        mesh = self.memory.cells.mesh
        return float((mesh.weight * mesh.area).sum())

    def refresh(self, **memory: Any) -> None:
        """Describe and factor the ice as it is bonded and lies now, with other tips or cells in the memory if they are given."""
        if memory:
            self.model._stepper.memory = self.memory._replace(lattice=None, state=None, **memory)  # type: ignore[attr-defined]
        self.model.step()

    def under(self, east: Any, north: Any = 0.0) -> Any:
        """Return the equilibrium under forces (N) on the elements."""
        self.el.load_x[:], self.el.load_y[:] = east, north
        self.model.step()
        state = self.memory.state
        return self.now.moment(state.bodies.displacement, state.load)

    def loads(self, force: Floats) -> Floats:
        """Forces (N, N, N m) on the elements of one piece, and its inertia, which holds the balance to them."""
        inertia = self.el.mass * (self.el.length**2 + self.el.width**2) / 12.0
        return balanced(self.now.xy, self.el.mass, inertia, force, 0.0)

    def bearing(self, force: Floats) -> Any:
        """Return the equilibrium of one piece under forces and torques (N, N, N m) on its elements."""
        load = self.loads(force)
        return self.now.moment(self.now.displacements(load), load)

    def critical(self, moment: Any) -> tuple[int, float]:
        """Return the bond that fails first, and stress over strength there."""
        bond, ratio = self.now.critical_bond(moment)
        return int(bond), float(ratio)

    def break_next(self, moment: Any, failing: int) -> int:
        """Break the bond on the way of the crack where one fails."""
        bond = int(self.now.next_bond(moment, failing))
        self.without(bond)
        return bond

    def without(self, bond: int) -> None:
        """Break a bond; tips stand where the cracks have taken them."""
        tips = self.now.tips
        self.bonds.status[bond], self.bonds.break_time[bond] = 1, 0.0
        self.refresh(tips=tips)

    def line(self, crack: int) -> Floats:
        """Return the points of a crack, from one end to the other."""
        b = self.bonds
        rows = np.flatnonzero((b.crack == crack) & (b.status != 0))
        rows = rows[np.argsort(b.crack_order[rows])]
        part = b.crack_part[rows]
        x = self.x[b.first[rows]] + part * (self.x[b.second[rows]] - self.x[b.first[rows]])
        y = self.y[b.first[rows]] + part * (self.y[b.second[rows]] - self.y[b.first[rows]])
        return np.column_stack([x, y])
