"""Is the tuning of A68a unique: strengths, drags, shears and winds that agree with its outlines and its first break-up.

python docs/examples/calibration_of_a68a.py OUTLINES.geojson FOLDER                         in the fitted ocean
python docs/examples/calibration_of_a68a.py OUTLINES.geojson FOLDER --errors                with random errors on it
python docs/examples/calibration_of_a68a.py OUTLINES.geojson FOLDER --sharp                 as if all were known better
python docs/examples/calibration_of_a68a.py OUTLINES.geojson FOLDER --finger                with its second break-up too
python docs/examples/calibration_of_a68a.py OUTLINES.geojson FOLDER --members 10 --waves 1  to try it
"""

from __future__ import annotations

import argparse
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from sensitivity_of_a68a import a68a

from riftberg import calibrate, open_sweep
from riftberg.diagnostics.observed import Observations, read_observed
from riftberg.verification.calibrate import Errors
from riftberg.viz.ensemble import draw_posterior, draw_predictive

INPUTS = {
    "start.strength": "~lognormal(1, 0.5)",
    "water_drag": "~lognormal(1, 0.3)",
    "shear": "~normal(1, 0.15)",
    "eddy": "~normal(1, 0.1)",
    "wind": "~lognormal(1, 0.3)",
}
OCEAN_ERRORS = {
    "current_error.speed": [0.05], "current_error.length": [50e3], "current_error.time": [3 * 86400.0],
    "wind_error.speed": [2.0], "wind_error.length": [300e3], "wind_error.time": [86400.0],
}  # fmt: skip
LAST = datetime(2020, 12, 20)
"""Outlines from then on hold the finger as long as it lies in place; the model counts it as a piece of its own."""
WHOLE, BROKEN = datetime(2020, 12, 16), datetime(2020, 12, 18)
ONCE, TWICE = datetime(2020, 12, 19), datetime(2020, 12, 23)
"""The finger broke off between them."""


def story(folder: Path, found: Any) -> list[str]:
    """Return how many members by weight lose a tip on 16 to 18 and a finger on 19 to 22 December, and the inputs of these."""
    told = []
    for path in sorted(p for p in folder.glob("wave-*") if not p.name.endswith("firm")):
        ds = open_sweep(path)
        area, born = ds["fragment_area"].values / 1e6, ds["fragment_birth_time"].values
        own = ds["fragment_parent"].values > 0

        def lost(low: float, high: float, begin: str, end: str, area=area, born=born, own=own):
            return own & (area > low) & (area < high) & (born >= np.datetime64(begin)) & (born < np.datetime64(end))

        tip = lost(80, 300, "2020-12-16", "2020-12-19").any(axis=1)
        finger = lost(450, 900, "2020-12-19", "2020-12-23").any(axis=1)
        told.append(np.stack([tip, finger, tip & finger], axis=1))
    each = np.concatenate(told)
    parts = found["member_weight"].values @ each
    lines = ["tip {:.0%}, finger {:.0%}, both {:.0%} of the members after".format(*parts)]
    both = each[:, 2]
    for k, name in enumerate(found["parameter"].values):
        low, middle, high = np.quantile(found["member_value"].values[both, k], [0.05, 0.5, 0.95])
        lines.append(
            f"  {name} of the {both.sum()} of {both.size} that tell both: {middle:.2f} ({low:.2f} to {high:.2f})"
        )
    return lines


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("observed", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--errors", action="store_true")
    parser.add_argument(
        "--sharp", action="store_true", help="observed 3 km, 3 degrees, model 1 km instead of 6, 5 and 3"
    )
    parser.add_argument("--finger", action="store_true", help="the second break-up counts too")
    parser.add_argument("--members", type=int, default=30)
    parser.add_argument("--waves", type=int, default=2)
    given = parser.parse_args()
    began, folder = (
        time.process_time(),
        given.folder
        / ("errors" if given.errors else "sharp" if given.sharp else "finger" if given.finger else "fitted"),
    )
    seen = Observations(
        "outlines", [outline for outline in read_observed(given.observed).outlines if outline.when < LAST]
    )
    errors = Errors(3.0, 3.0, 1.0) if given.sharp else Errors()
    found = calibrate(
        a68a, seen, INPUTS | (OCEAN_ERRORS if given.errors else {}), errors=errors, days=14.0 if given.finger else 12.5,
        whole_until=WHOLE, broken=BROKEN, waves=given.waves, members=given.members, output=folder,
        resume=folder.exists(), workers=0,
        **({"one_break_until": ONCE, "second_break": TWICE} if given.finger else {}),
    )  # fmt: skip
    found.to_netcdf(folder / "calibration.nc")
    draw_posterior(found, folder / "posterior.png")
    draw_predictive(found, folder / "predictive.png")
    columns = [f"{when}_{end}" for when in ("prior", "posterior") for end in ("low", "median", "high")]
    print(found[[*columns, "likeliest", "narrowed"]].to_dataframe().round(2).to_string())
    print("left by wave:", found["wave_left"].values, "members that count:", found.attrs["effective_members"])
    print("correlation:\n", np.round(found["correlation"].values, 2))
    print("\n".join(story(folder, found)))
    print(f"{time.process_time() - began:.0f} s of processor time")
