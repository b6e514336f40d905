"""Small test cases of Huth et al.: beams under a load (equations 10.3), two bergs that collide (10.2), one that grounds (10.4).

A beam of elements bends as the elastic beam of the same section does, which tests normal force, shear and bending of the
bonds together. With Riftberg's own numerics a drag of the sea floor, linear in velocity, brings the beam to rest: it does
not change the equilibrium, and bonds alone would damp the bending of kilometres of ice over weeks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from riftberg.bergs.iceberg import Iceberg
from riftberg.constants import SECONDS_PER_DAY
from riftberg.experiments.changes import reference_numerics
from riftberg.experiments.registry import Info, Options
from riftberg.ocean.analytic import Convergence, Steady
from riftberg.ocean.formulas import Seamount
from riftberg.parameters import PUBLISHED_DRAG, Parameters, kid_quirks
from riftberg.runs.model import Model
from riftberg.runs.scene import Statics
from riftberg.state import Floats

# ---- beams ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Beam:
    """Size and material of a beam of square elements."""

    columns: int  # Elements along and across the beam
    rows: int  # Elements along and across the beam
    radius: float  # Half the side of an element, and ice thickness, m
    thickness: float  # Half the side of an element, and ice thickness, m
    density: float  # kg m-3
    youngs_modulus: float  # Pa
    load: float  # Total load, N, towards negative y
    slowest: float  # Estimate of the lowest frequency, rad s-1, to choose the drag by
    damping: float  # Damping ratio of the bonds in the reference's run
    time_step: float  # Long step (s) and sub-steps of the reference's run
    substeps: int  # Long step (s) and sub-steps of the reference's run
    duration: float  # Length of the run, s

    @property
    def length(self) -> float:
        """Distance of the centres of the end columns, m."""
        return 2.0 * self.radius * (self.columns - 1)

    @property
    def section(self) -> float:
        """Area of the cross-section, m2."""
        return 2.0 * self.radius * self.rows * self.thickness

    def points(self) -> tuple[Any, Any]:
        """Return x and y of the elements, column by column, m."""
        side = 2.0 * self.radius
        column, row = np.divmod(np.arange(self.columns * self.rows), self.rows)
        return 101_000.0 + side * column, 151_000.0 + (self.radius if self.radius < 1.0 else 0.0) * 2.0 + side * row

    def theory(self) -> Floats:
        """Return the line of the middle of the loaded beam, x and y, m: of small slopes on two supports, the elastica clamped."""
        x, y = self.points()
        along = np.linspace(0.0, self.length, 101)
        stiffness = self.youngs_modulus * self.thickness * (2.0 * self.radius * self.rows) ** 3 / 12.0
        if self.rows == 1:
            support_distance = np.minimum(along, self.length - along)
            sag = (
                -self.load * support_distance * (3.0 * self.length**2 - 4.0 * support_distance**2) / (48.0 * stiffness)
            )
            return np.column_stack([x.min() + along, y.mean() + sag])
        from scipy.integrate import solve_ivp
        from scipy.optimize import brentq

        def bend(_: float, state: Floats) -> list[float]:
            """Return the changes of slope, moment, x and y along the beam."""
            cosine, sine = math.cos(state[0]), math.sin(state[0])
            return [-state[1] / stiffness, -self.load * cosine, cosine, sine]

        def solved(moment: float) -> Floats:
            start = [0.0, moment, 0.0, 0.0]
            return np.asarray(solve_ivp(bend, (0.0, self.length), start, t_eval=along, rtol=1e-8).y)

        # The moment at the clamp that leaves none at the free end.
        state = solved(brentq(lambda moment: float(solved(moment)[1, -1]), 0.0, self.load * self.length))
        return np.column_stack([x.min() + state[2], y.mean() + state[3]])

    def parameters(self, numerics: str) -> Parameters:
        """Return the parameters of a run with these numerics."""
        own_parameters = Parameters(
            ice={"density": self.density},
            drag={"rotational": False},
            grounding={"coefficient": 2.0 * self.slowest * self.density * self.thickness},
            contact={"spring": 1e-8, "distance": 0.0},
            bonds={
                "youngs_modulus": self.youngs_modulus,
                "damping": 0.1,
                "linear_bending": self.rows > 1,
            },
            fracture={"enabled": False},
            # Under its whole load at once the tip of the cantilever swings at 15 m/s: no iceberg, and meant.
            stepping={"scheme": "mts", "time_step": self.time_step, "only_interactions": True, "speed_limit": 100.0},
            earth={"latlon": False, "period": 0.0},
        )
        if numerics == "own":
            return own_parameters
        return own_parameters.changed(**{
            **kid_quirks(), "grounding": {"coefficient": 0.0, "implicit": False}, "contact": {"critical_damping": False},
            "bonds": {"objective_damping": False, "damping": self.damping, "spring": 1e-5},
            "stepping": {"substeps": self.substeps},
        })  # fmt: skip


SUPPORTED = Beam(
    columns=29, rows=1, radius=0.25, thickness=1.0, density=800.0, youngs_modulus=1e9, load=1.5e5, slowest=8.1,
    damping=0.1, time_step=1.0, substeps=100_000, duration=10.0,
)  # fmt: skip
"""Simply supported beam of 14 m with a load at mid-span (equations 10.3)."""

CANTILEVER = Beam(
    columns=30, rows=3, radius=2500.0, thickness=1.0, density=900.0, youngs_modulus=1e9, load=1.5e10, slowest=7.6e-4,
    damping=0.7, time_step=100.0, substeps=2000, duration=30_000.0,
)  # fmt: skip
"""Clamped beam of 145 km with a load at its end (equations 10.3)."""


def supported_beam(beam: Beam = SUPPORTED) -> Iceberg:
    """Return the beam on two supports that carry the ends, with the load on the middle element."""
    x, y = beam.points()
    berg = Iceberg.from_points(x, y, radius=beam.radius, thickness=beam.thickness, density=beam.density, latlon=False)
    berg.elements.free_y[[0, -1]] = 0.0
    berg.elements.load_y[beam.columns // 2] = -beam.load
    return berg


def cantilever(beam: Beam = CANTILEVER) -> Iceberg:
    """Return the beam whose first column is fixed, with the load spread over the last column."""
    x, y = beam.points()
    berg = Iceberg.from_points(
        x, y, radius=beam.radius, thickness=beam.thickness, density=beam.density, static=x == x.min(), latlon=False
    )
    berg.elements.load_y[x == x.max()] = -beam.load / beam.rows
    return berg


def build_supported(options: Options) -> tuple[Model, Info]:
    """Build the simply supported beam (see `riftberg.experiments.build`)."""
    return _build(SUPPORTED, supported_beam(), "supported-beam", "Simply supported beam", options)


def build_cantilever(options: Options) -> tuple[Model, Info]:
    """Build the cantilever (see `riftberg.experiments.build`)."""
    return _build(CANTILEVER, cantilever(), "cantilever", "Cantilever", options)


def _build(beam: Beam, berg: Iceberg, name: str, title: str, options: Options) -> tuple[Model, Info]:
    # The sea floor lies above the keel, so that its drag acts everywhere.
    model = Model(berg, Steady(depth=0.0), options.apply(beam.parameters("own" if options.own else "reference")))
    e = berg.elements
    statics = Statics(np.flatnonzero((e.static > 0.0) | (e.free_y == 0.0)), np.flatnonzero(e.load_y), beam.theory())
    return model, Info(
        name, title, days=beam.duration / SECONDS_PER_DAY, output_every_hours=beam.time_step / 3600.0, statics=statics,
        test_case=True,
    )  # fmt: skip


# ---- two bergs that a converging current drives into each other, in a periodic channel --------------------------------

PERIOD = 20_000.0
LINE = 10_000.0
HEXAGON = 450.0 * math.sqrt(3.0) / 2.0
"""Radius of the inscribed circle of an element, m."""

DENSITY_OF_MASS = 918.0
"""Density (kg m-3) that the bergs are made with; the draft follows from ``ice.density``, as in the reference."""

COLLISION = Parameters(
    drag={**PUBLISHED_DRAG, "sides_by_bonds": False, "rotational": False},
    grounding={"ramp_height": 100.0},
    contact={
        "spring": 1e-7,
        "distance": 1750.0,
        "tangential_critical_damping": True,
        "tolerance": 1e-8,
    },
    bonds={"packing": "hexagonal", "youngs_modulus": 4471.94, "spring": 1e-5, "linear_bending": False},
    fracture={"enabled": False},
    stepping={"scheme": "mts", "time_step": 3600.0},
    earth={"latlon": False, "period": PERIOD},
    compatibility={"damping_by_speed": True},
)
"""Physics of the iKID case with Riftberg's numerics."""


def two_bergs() -> Iceberg:
    """Return two lattices of 8 elements, the one the mirror image of the other across the line."""
    column, row = np.array([0, 0, 0, 1, 1, 2, 2, 2]), np.array([0, 1, 2, 0, 1, 0, 1, 2])
    # The lattice of the reference starts at the origin; these are its columns 6 to 8 and rows from 5 up.
    x = 2.0 / math.sqrt(3.0) * HEXAGON + math.sqrt(3.0) * HEXAGON * (column + 6)
    y = HEXAGON + ((column + 6) % 2) * HEXAGON + 2.0 * HEXAGON * (row + 5)
    return Iceberg.from_points(
        np.concatenate([x, x]), np.concatenate([y, 2.0 * LINE - y]), radius=HEXAGON, thickness=300.0, packing="hexagonal",
        density=DENSITY_OF_MASS, latlon=False, period=PERIOD,
    )  # fmt: skip


def build_collision(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    parameters = COLLISION
    if options.numerics == "reference":
        parameters = _as_in_the_reference(COLLISION, 60)
    forcing = Convergence(
        current=(0.2, 0.0), speed=0.2, line=LINE, span=(0.0, LINE), ramp=1000.0, period=PERIOD, depth=1000.0
    )
    model = Model(two_bergs(), forcing, options.apply(parameters))
    return model, Info("collision", "Two bergs collide", days=2.0, output_every_hours=1.0, test_case=True)


def _as_in_the_reference(parameters: Parameters, substeps: int) -> Parameters:
    """Return parameters with the reference's numerics; in these cases it applies the long-step force from the first step on."""
    reference = reference_numerics(parameters.changed(stepping={"substeps": substeps}))
    return reference.changed(stepping={"skip_first_long_force": False})


# ---- a tabular berg that drifts onto a seamount and breaks ------------------------------------------------------------

GROUNDING_CENTRE = (50e3, 50e3)
LENGTH, WIDTH = 15e3, 35e3
CURRENT = (0.1, 0.1)

GROUNDING = Parameters(
    drag=dict(PUBLISHED_DRAG),
    contact={"spring": 5e-8, "distance": 4000.0, "on_substeps": False, "tolerance": 1e-2},
    bonds={
        "packing": "hexagonal",
        "youngs_modulus": 5e6,
        "spring": 0.0007547062342348049,
        "linear_bending": False,
        "constant_size": True,
    },
    fracture={"normal_strength": 1850.0, "shear_strength": 1000.0},
    stepping={"scheme": "mts", "time_step": 1800.0},
    earth={"latlon": False, "period": 0.0},
)
"""Physics of the reference's case."""

GROUNDING_OWN, _ = GROUNDING.adapted(stepping={"scheme": "quasi_static"})
"""With Riftberg's numerics the lattice stands in equilibrium with the loads, and the seamount is a bed of sand."""

SEAMOUNT_HEIGHT = {"reference": 950.0, "own": 850.0}
"""Height (m) in water of 1000 m. The keel lies at 166 m: the reference's seamount is a cliff to it, which a drag stops and no bed
of sediment carries; with Riftberg's numerics the summit lies 16 m above the keel."""


def grounding_berg(density: float = 850.0) -> Iceberg:
    """Return 69 hexagons in columns that fill the rectangle from its south-western corner, drifting with the current."""
    radius, south = 1500.0, GROUNDING_CENTRE[1] - 0.5 * WIDTH
    x, y = [], []
    for column in range(6):
        rows = np.arange(south + radius + (column % 2) * radius, south + WIDTH + 1e-6, 2.0 * radius)
        west = GROUNDING_CENTRE[0] - 0.5 * LENGTH
        y.append(rows)
        x.append(np.full(rows.size, west + radius * (2.0 / math.sqrt(3.0) + math.sqrt(3.0) * column)))
    return Iceberg.from_points(
        np.concatenate(x), np.concatenate(y), radius=radius, thickness=200.0, packing="hexagonal",
        velocity=(CURRENT[0], 0.0), latlon=False, density=density,
    )  # fmt: skip


def build_grounding_fracture(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    parameters = GROUNDING_OWN
    if options.numerics == "reference":
        parameters = _as_in_the_reference(GROUNDING, 200)
    forcing = Steady(current=CURRENT) + Seamount(
        (63e3, 60e3), height=SEAMOUNT_HEIGHT["own" if options.own else "reference"], width=5e3, depth=1000.0, latlon=False,
        latitude=0.0,
    )  # fmt: skip
    parameters = options.apply(parameters)
    model = Model(grounding_berg(parameters.ice.density), forcing, parameters)
    return model, Info("grounding-fracture", "A berg runs aground and breaks", days=3.0, output_every_hours=1.0)
