"""Riftberg: tabular icebergs as lattices of ice columns joined by breakable bonds.

Five lines from nothing to a picture::

    from riftberg import Forcing, Iceberg, Model, draw_map
    berg = Iceberg.rectangle("60 km", "20 km", thickness="200 m", placement=(-37.0, -56.0))
    sea = Forcing.uniform(current=(0.2, 0.05), wind=(5.0, -2.0)) + Forcing.eddy((-37.2, -56.3), radius=30e3, speed=0.5)
    run = Model(berg, sea).run(days=3)
    draw_map(run, "berg.png")

The names below are loaded when they are first used, so that ``import riftberg`` is quick.
"""

from __future__ import annotations

import importlib
import logging
from typing import TYPE_CHECKING, Any

from riftberg.version import __version__

if TYPE_CHECKING:
    from riftberg.bergs.iceberg import Iceberg
    from riftberg.coupling.bmi import BmiRiftberg
    from riftberg.coupling.exchange import Exchange, ocean_grid
    from riftberg.coupling.fields import OceanForcing
    from riftberg.coupling.gridded import GridRecorder
    from riftberg.coupling.shelf import IceShelf
    from riftberg.coupling.veros import VerosBergs, veros_forcing
    from riftberg.coupling.yac import YacComponent, read_coupling
    from riftberg.diagnostics.observed import Fix, Observations, read_observed
    from riftberg.diagnostics.outlines import Outline
    from riftberg.diagnostics.score import score_run
    from riftberg.diagnostics.why import explain
    from riftberg.engines.common.laws import Laws
    from riftberg.ensembles.forecast import forecast
    from riftberg.ensembles.result import open_cells, open_sweep
    from riftberg.ensembles.sensitivity import sensitivity
    from riftberg.ensembles.sweep import sweep
    from riftberg.experiments import Options, build
    from riftberg.ocean.datasets import DatasetForcing, Forcing
    from riftberg.ocean.grid import Grid
    from riftberg.ocean.gridded import FieldRules, GriddedForcing
    from riftberg.parameters import A68A_2022, A68A_2022_KID, A68A_2022_MTS, Parameters
    from riftberg.products import open_product
    from riftberg.runs.model import Model
    from riftberg.runs.opendrift import read_opendrift, write_opendrift
    from riftberg.runs.run_file import open_run
    from riftberg.system.input_files import allow_large
    from riftberg.verification.calibrate import Errors, calibrate
    from riftberg.viz.ensemble import draw_sweep
    from riftberg.viz.map import draw_map, draw_tracks
    from riftberg.viz.plots import draw_damage, draw_dates, draw_fragments, draw_melt, draw_stress
    from riftberg.viz.score import draw_reasons, draw_score

_HOMES = {
    "Iceberg": "riftberg.bergs.iceberg",
    "Laws": "riftberg.engines.common.laws",
    "Model": "riftberg.runs.model",
    "Parameters": "riftberg.parameters",
    "A68A_2022": "riftberg.parameters",
    "A68A_2022_KID": "riftberg.parameters",
    "A68A_2022_MTS": "riftberg.parameters",
    "FieldRules": "riftberg.ocean.gridded",
    "GriddedForcing": "riftberg.ocean.gridded",
    "DatasetForcing": "riftberg.ocean.datasets",
    "Forcing": "riftberg.ocean.datasets",
    "Grid": "riftberg.ocean.grid",
    "open_product": "riftberg.products",
    "Options": "riftberg.experiments",
    "build": "riftberg.experiments",
    "Exchange": "riftberg.coupling.exchange",
    "OceanForcing": "riftberg.coupling.fields",
    "ocean_grid": "riftberg.coupling.exchange",
    "IceShelf": "riftberg.coupling.shelf",
    "GridRecorder": "riftberg.coupling.gridded",
    "BmiRiftberg": "riftberg.coupling.bmi",
    "VerosBergs": "riftberg.coupling.veros",
    "veros_forcing": "riftberg.coupling.veros",
    "YacComponent": "riftberg.coupling.yac",
    "read_coupling": "riftberg.coupling.yac",
    "Errors": "riftberg.verification.calibrate",
    "Fix": "riftberg.diagnostics.observed",
    "Observations": "riftberg.diagnostics.observed",
    "read_observed": "riftberg.diagnostics.observed",
    "Outline": "riftberg.diagnostics.outlines",
    "score_run": "riftberg.diagnostics.score",
    "explain": "riftberg.diagnostics.why",
    "calibrate": "riftberg.verification.calibrate",
    "forecast": "riftberg.ensembles.forecast",
    "open_run": "riftberg.runs.run_file",
    "read_opendrift": "riftberg.runs.opendrift",
    "write_opendrift": "riftberg.runs.opendrift",
    "open_cells": "riftberg.ensembles.result",
    "open_sweep": "riftberg.ensembles.result",
    "sensitivity": "riftberg.ensembles.sensitivity",
    "sweep": "riftberg.ensembles.sweep",
    "allow_large": "riftberg.system.input_files",
    "draw_damage": "riftberg.viz.plots",
    "draw_dates": "riftberg.viz.plots",
    "draw_fragments": "riftberg.viz.plots",
    "draw_map": "riftberg.viz.map",
    "draw_melt": "riftberg.viz.plots",
    "draw_reasons": "riftberg.viz.score",
    "draw_score": "riftberg.viz.score",
    "draw_stress": "riftberg.viz.plots",
    "draw_sweep": "riftberg.viz.ensemble",
    "draw_tracks": "riftberg.viz.map",
}

__all__ = [
    "A68A_2022",
    "A68A_2022_KID",
    "A68A_2022_MTS",
    "BmiRiftberg",
    "DatasetForcing",
    "Errors",
    "Exchange",
    "FieldRules",
    "Fix",
    "Forcing",
    "Grid",
    "GridRecorder",
    "GriddedForcing",
    "IceShelf",
    "Iceberg",
    "Laws",
    "Model",
    "Observations",
    "OceanForcing",
    "Options",
    "Outline",
    "Parameters",
    "VerosBergs",
    "YacComponent",
    "__version__",
    "allow_large",
    "build",
    "calibrate",
    "draw_damage",
    "draw_dates",
    "draw_fragments",
    "draw_map",
    "draw_melt",
    "draw_reasons",
    "draw_score",
    "draw_stress",
    "draw_sweep",
    "draw_tracks",
    "explain",
    "forecast",
    "ocean_grid",
    "open_cells",
    "open_product",
    "open_run",
    "open_sweep",
    "read_coupling",
    "read_observed",
    "read_opendrift",
    "score_run",
    "sensitivity",
    "sweep",
    "veros_forcing",
    "write_opendrift",
]


logging.getLogger("riftberg").addHandler(logging.NullHandler())


def __dir__() -> list[str]:
    """Name what the package offers, also what is not loaded yet; tab completion asks for it."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})


def __getattr__(name: str) -> Any:
    """Load a public name from its home on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module 'riftberg' has no attribute {name!r}")
    globals()[name] = public = getattr(importlib.import_module(_HOMES[name]), name)
    return public
