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

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.experiments.changes import reference_numerics
from riftberg.parameters import PUBLISHED_DRAG, kid_quirks
from riftberg.state import Elements, Floats

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


def beam_model(beam: Beam, berg: Iceberg, numerics: str = "own") -> Model:
    """Return the model of a beam; the sea floor lies above the keel, so that its drag acts everywhere."""
    return Model(berg, Forcing.uniform(depth=0.0), beam.parameters(numerics))


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


class Converging(Forcing):
    """A current along x that converges on a line in part of each period (equations 10.2).

    The northward current falls from 0.2 m/s south of the line to -0.2 m/s north of it over a kilometre on either side, and sets
    in and ends over a kilometre along x, as bilinear interpolation does on a grid of that spacing.
    """

    speed, ramp = 0.2, 1000.0  # m s-1, m

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points (m)."""
        along = np.asarray(lon) % PERIOD
        window = np.clip(along / self.ramp, 0.0, 1.0) * np.clip((LINE + self.ramp - along) / self.ramp, 0.0, 1.0)
        across = np.clip((LINE - np.asarray(lat)) / self.ramp, -1.0, 1.0)
        return np.full(np.shape(lon), self.speed), self.speed * across * window

    def add_to(self, elements: Elements, time: float) -> None:
        """Add the current; the vorticity comes from its northward component alone."""
        e, step = elements.environment, 1e-3 * self.ramp
        lon, lat = elements.place.lon, elements.place.lat
        for values, current in zip((e.uo, e.vo), self.currents(lon, lat, time), strict=True):
            values[:] += current
        east, west = (self.currents(lon + side, lat, time)[1] for side in (step, -step))
        e.vorticity[:] += (east - west) / (2.0 * step)
        e.depth[:] = np.minimum(e.depth, 1000.0)

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m)."""
        return np.full(np.shape(lon), 1000.0)


def collision(numerics: str = "own") -> Model:
    """Return the model of two bergs that a converging current drives into each other; two days."""
    parameters = _as_in_the_reference(COLLISION, 60) if numerics == "reference" else COLLISION
    return Model(two_bergs(), Converging(), parameters)


def _as_in_the_reference(parameters: Parameters, substeps: int) -> Parameters:
    """Return parameters with the reference's numerics; in these cases it applies the long-step force from the first step on."""
    reference = reference_numerics(parameters.changed(stepping={"substeps": substeps}))
    return reference.changed(stepping={"skip_first_long_force": False})


# ---- a tabular berg that drifts onto a seamount and breaks ------------------------------------------------------------

GROUNDING_CENTRE = (50e3, 50e3)
LENGTH, WIDTH = 15e3, 35e3
CURRENT = {"reference": (0.1, 0.1), "own": (0.2, 0.2)}
"""m s-1; elastic cells of 1850 Pa would shatter afloat, and the berg of 3 kPa that does not needs more to break aground."""

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

GROUNDING_OWN, _ = GROUNDING.adapted(stepping={"scheme": "quasi_static"}, fracture={"normal_strength": 3e3})
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
        velocity=(CURRENT["reference"][0], 0.0), latlon=False, density=density,
    )  # fmt: skip


def grounding_fracture(numerics: str = "own") -> Model:
    """Return the model of a berg that drifts onto a seamount and breaks; three days."""
    parameters = _as_in_the_reference(GROUNDING, 200) if numerics == "reference" else GROUNDING_OWN
    sea = Forcing.uniform(current=CURRENT[numerics], slope=(0.0, 0.0)) + Forcing.seamount(
        (63e3, 60e3), height=SEAMOUNT_HEIGHT[numerics], width=5e3, depth=1000.0, latlon=False, latitude=0.0
    )
    return Model(grounding_berg(parameters.ice.density), sea, parameters)


CASES = {
    "supported-beam": lambda numerics="own": beam_model(SUPPORTED, supported_beam(), numerics),
    "cantilever": lambda numerics="own": beam_model(CANTILEVER, cantilever(), numerics),
    "collision": collision,
    "grounding-fracture": grounding_fracture,
}
"""Models of the cases by name, with the numerics of Riftberg (own) or of the reference."""
