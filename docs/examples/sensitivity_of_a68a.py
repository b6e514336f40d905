"""Which input matters for A68a: Morris effects of fourteen inputs, Sobol' indices of the five that do most.

python docs/examples/sensitivity_of_a68a.py OUTLINES.geojson FOLDER                 120 and 224 runs, ten minutes
python docs/examples/sensitivity_of_a68a.py OUTLINES.geojson FOLDER --draws 2 2     to try it
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from riftberg import Model, sensitivity
from riftberg.diagnostics.observed import read_observed
from riftberg.experiments.a68a import story_model
from riftberg.experiments.registry import Options
from riftberg.ocean.story import OWN, StoryOcean
from riftberg.verification.sightings import drift_error
from riftberg.viz.ensemble import draw_sensitivity

INPUTS = {
    "start.strength": "~lognormal(1, 20 %)",
    "stiffness": "~lognormal(1, 50 %)",
    "water_drag": "~lognormal(1, 20 %)",
    "wind": "~lognormal(1, 20 %)",
    "eddy": "~normal(1, 0.1)",
    "shear": "~normal(1, 0.1)",
    "floor_error.offset": "~normal(0 m, 10 m)",
    "start.east": "~normal(0 km, 3 km)",
    "start.north": "~normal(0 km, 3 km)",
    "start.turn": "~normal(0, 5)",
    "start.thickness": "~normal(1, 0.1)",
    "spacing": "~uniform(2500, 3500)",
    "packing": "~choice(square, hexagonal)",
    "lattice_angle": "~uniform(0, 90)",
}
MOST = ("wind", "eddy", "start.east", "start.north", "start.strength")


def a68a(
    stiffness: float = 1.0, water_drag: float = 1.0, wind: float = 1.0, eddy: float = 1.0, shear: float = 1.0,
    spacing: float = 3000.0, packing: str = "square", lattice_angle: float = 0.0,
) -> Model:  # fmt: skip
    """Return A68a with factors on its surroundings, and another lattice: spacing in m, angle in degrees."""
    changes: dict[str, dict[str, Any]] = {
        "berg": {"radius": 0.5 * float(spacing), "packing": packing, "lattice_angle": float(lattice_angle)},
        "bonds": {"youngs_modulus": 5e6 * stiffness},
        "drag": {"ocean_scale": 17.8 * water_drag},
    }
    ocean = OWN._replace(
        eddy_spin=OWN.eddy_spin * eddy, wind=(OWN.wind[0] * wind, OWN.wind[1] * wind),
        jet_speed=OWN.jet_speed * shear, counter_speed=OWN.counter_speed * shear, shear_flow=OWN.shear_flow * shear,
    )  # fmt: skip
    return story_model(Options(changes=changes), ocean=StoryOcean(ocean))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("observed", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, nargs=2, default=(8, 32), metavar=("MORRIS", "SOBOL"))
    given = parser.parse_args()
    observed = read_observed(given.observed)
    for method, draws, inputs in zip(("morris", "sobol"), given.draws, (INPUTS, {n: INPUTS[n] for n in MOST})):
        began, folder = time.process_time(), given.folder / method
        found = sensitivity(
            a68a, inputs, method=method, members=draws, default_errors=False, days=17, at_days=(8.5, 17.0), workers=0,
            results={"drift error, km": lambda result: drift_error(result, observed)}, output=folder,
            resume=folder.exists(), progress=True,
        )  # fmt: skip
        draw_sensitivity(found, given.folder / f"{method}.png", title=f"A68a, {draws} draws")
        found.to_netcdf(given.folder / f"{method}.nc")
        print(found[["effect" if method == "morris" else "total"]].to_dataframe().unstack("input").round(3).to_string())
        print(f"{method}: {time.process_time() - began:.0f} s of processor time")
