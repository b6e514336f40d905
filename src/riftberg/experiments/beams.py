"""Beams under a load: the supported beam and the cantilever of Huth et al. (equations 10.3).

A beam of elements bends as the elastic beam of the same section does, which tests normal force, shear and bending of the
bonds together. With Riftberg's own numerics a drag of the sea floor, linear in velocity, brings the beam to rest: it does
not change the equilibrium, and bonds alone would damp the bending of kilometres of ice over weeks.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from riftberg.bergs.iceberg import Iceberg
from riftberg.constants import SECONDS_PER_DAY
from riftberg.diagnostics.cases import BeamCase, Held, bent_beam
from riftberg.experiments.options import Info, Options, Story
from riftberg.ocean.analytic import Steady
from riftberg.parameters import Compatibility, Parameters

if TYPE_CHECKING:
    from riftberg.runs.model import Model


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

    @property
    def second_moment(self) -> float:
        """Second moment of area of the cross-section, m4."""
        return self.thickness * (2.0 * self.radius * self.rows) ** 3 / 12.0

    def case(self, held: Held) -> BeamCase:
        """Return what theory asks of the beam."""
        width = 2.0 * self.radius * self.rows
        return BeamCase(held, self.columns, self.rows, self.length, width, self.thickness, self.load)

    def points(self) -> tuple[Any, Any]:
        """Return x and y of the elements, column by column, m."""
        side = 2.0 * self.radius
        column, row = np.divmod(np.arange(self.columns * self.rows), self.rows)
        return 101_000.0 + side * column, 151_000.0 + (self.radius if self.radius < 1.0 else 0.0) * 2.0 + side * row

    def parameters(self, numerics: str) -> Parameters:
        """Return the parameters of a run with these numerics."""
        own = Parameters(
            ice={"density": self.density},
            drag={"rotational": False},
            grounding={"coefficient": 2.0 * self.slowest * self.density * self.thickness},
            contact={"spring": 1e-8, "distance": 0.0},
            bonds={"youngs_modulus": self.youngs_modulus, "damping": 0.1, "linear_bending": self.rows > 1},
            fracture={"enabled": False},
            # Under its whole load at once the tip of the cantilever swings at 15 m/s: no iceberg, and meant.
            stepping={"scheme": "mts", "time_step": self.time_step, "only_interactions": True, "speed_limit": 100.0},
            earth={"latlon": False, "period": 0.0},
        )
        if numerics == "own":
            return own
        return own.changed(
            grounding={"coefficient": 0.0, "implicit": False},
            contact={"critical_damping": False},
            bonds={"objective_damping": False, "damping": self.damping, "spring": 1e-5},
            stepping={"substeps": self.substeps},
            compatibility=Compatibility.kid().model_dump(),
        )


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
    return _build(SUPPORTED, supported_beam(), "supported-beam", "Simply supported beam", options, SUPPORTED_STORY)


def build_cantilever(options: Options) -> tuple[Model, Info]:
    """Build the cantilever (see `riftberg.experiments.build`)."""
    return _build(CANTILEVER, cantilever(), "cantilever", "Cantilever", options, CANTILEVER_STORY)


def beam_story(beam: Beam, held: Held, title: str) -> Story:
    """Return what a beam tells of itself: how far it bends, and how far theory bends it."""
    case = beam.case(held)

    def draw(run: xr.Dataset, path: Path, dpi: int) -> Path:
        from riftberg.viz.cases import draw_beam

        return draw_beam(run, path, case=case, title=f"{title}: deflection against theory", dpi=dpi)

    return Story(
        tell=lambda run: bent_beam(run, case).lines(),
        facts=lambda run: bent_beam(run, case).facts(),
        draw=draw,
        fits=lambda run: run.sizes["trajectory"] == case.columns * case.rows and run.sizes["time"] > 1,
    )


SUPPORTED_STORY = beam_story(SUPPORTED, "supported", "Simply supported beam")
CANTILEVER_STORY = beam_story(CANTILEVER, "clamped", "Cantilever")


def _build(beam: Beam, berg: Iceberg, name: str, title: str, options: Options, story: Story) -> tuple[Model, Info]:
    from riftberg.runs.model import Model

    # The sea floor lies above the keel, so that its drag acts everywhere.
    model = Model(berg, Steady(depth=0.0), options.apply(beam.parameters("own" if options.own else "reference")))
    return model, Info(
        name, title, days=beam.duration / SECONDS_PER_DAY, output_every_hours=beam.time_step / 3600.0, story=story
    )
