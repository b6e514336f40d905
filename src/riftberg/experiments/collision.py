"""Two small hexagonal bergs that a converging current drives into each other (equations 10.2), in a periodic channel."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from riftberg.bergs.iceberg import Iceberg
from riftberg.diagnostics.cases import approach
from riftberg.experiments.changes import reference_numerics
from riftberg.experiments.options import Info, Options, Story
from riftberg.ocean.analytic import Convergence
from riftberg.parameters import Parameters
from riftberg.state import Floats

if TYPE_CHECKING:
    from riftberg.runs.model import Model

PERIOD = 20_000.0
LINE = 10_000.0
RADIUS = 450.0 * math.sqrt(3.0) / 2.0
THICKNESS = 300.0
DENSITY_OF_MASS = 918.0
"""Density (kg m-3) that the bergs are made with; the draft follows from ``ice.density``, as in the reference."""

PARAMETERS = Parameters(
    drag={"sides_by_bonds": False, "rotational": False},
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


def points() -> tuple[Floats, Floats]:
    """Return x and y (m) of the 16 elements: a lattice of 8, and its mirror image across the line."""
    column = np.array([0, 0, 0, 1, 1, 2, 2, 2])
    row = np.array([0, 1, 2, 0, 1, 0, 1, 2])
    # The lattice of the reference starts at the origin; these are its columns 3 to 5 and rows from 5 up.
    x = 2.0 / math.sqrt(3.0) * RADIUS + math.sqrt(3.0) * RADIUS * (column + 6)
    y = RADIUS + ((column + 6) % 2) * RADIUS + 2.0 * RADIUS * (row + 5)
    return np.concatenate([x, x]), np.concatenate([y, 2.0 * LINE - y])


def bergs() -> Iceberg:
    """Return both bergs."""
    x, y = points()
    made = Iceberg.from_points(
        x, y, radius=RADIUS, thickness=THICKNESS, packing="hexagonal", density=DENSITY_OF_MASS, latlon=False,
        period=PERIOD,
    )  # fmt: skip
    return made


def build(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    from riftberg.runs.model import Model

    parameters = PARAMETERS
    if options.numerics == "reference":
        parameters = reference_numerics(PARAMETERS.changed(stepping={"substeps": 60}))
        parameters = parameters.changed(stepping={"skip_first_long_force": False})
    forcing = Convergence(
        current=(0.2, 0.0), speed=0.2, line=LINE, span=(0.0, LINE), ramp=1000.0, period=PERIOD, depth=1000.0
    )
    model = Model(bergs(), forcing, options.apply(parameters))
    return model, Info("collision", "Two bergs collide", days=2.0, output_every_hours=1.0, story=STORY)


def _draw(run: xr.Dataset, path: Path, dpi: int) -> Path:
    from riftberg.viz.cases import draw_approach

    return draw_approach(run, path, title="Two bergs collide in a periodic channel", dpi=dpi)


STORY = Story(
    tell=lambda run: approach(run).lines(),
    facts=lambda run: approach(run).facts(),
    draw=_draw,
    fits=lambda run: run.sizes["trajectory"] == 16 and run.sizes["time"] > 1 and "x" in run,
)
