"""Riftberg's drift of A68A and its pieces in December 2020, in the monthly mean currents of ORAS5 that nothing was fitted to.

A drift model for `riftberg verify-tracks` (docs/howto/verification.md): the berg is a rectangle of the size that it had, begins
with its mean velocity of the last three days, and does not break. From the root of the repository, with the files of
`riftberg fetch a68a` in the folder that ``RIFTBERG_A68A`` names and the tracks of BYU and NIC in ``tracks``:

    cd benchmarks && riftberg verify-tracks ../tracks --between 2020-12-01,2020-12-31 --model drift_december_2020:drift
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime, timedelta
from functools import cache
from pathlib import Path

import numpy as np

from riftberg import Iceberg, Model
from riftberg.experiments.a68a_files import FETCHED, mean_forcing
from riftberg.parameters import A68A_2022
from riftberg.verification.scores import local
from riftberg.verification.tracks import Start

SIZES = {"A68A": ("150 km", "40 km"), "A68D": ("18 km", "8 km"), "A68E": ("45 km", "15 km"), "A68F": ("22 km", "10 km")}
"""Length and width, about as in images of the month (3900, 144, 655 and 225 km2, and the holes of A68A's outline)."""

THICKNESS = 220.0
"""m, as `riftberg run a68a` has it."""


@cache
def _ocean():
    """Return the currents, sea level and wind of the month."""
    return mean_forcing(Path(os.environ.get("RIFTBERG_A68A") or FETCHED))


def drift(start: Start, dates: Sequence[datetime]) -> list[list[float]]:
    """Return longitude and latitude at dates."""
    length, width = SIZES[start.berg]
    east, north = local(*start.origin, start.lon, start.lat)
    seconds = 3.0 * 86400.0
    berg = Iceberg.rectangle(
        length, width, thickness=THICKNESS, radius="2 km", placement=(start.lon, start.lat),
        velocity=(1e3 * float(east) / seconds, 1e3 * float(north) / seconds), earth_radius=A68A_2022.earth.radius,
    )  # fmt: skip
    parameters = A68A_2022.changed(fracture={"normal_strength": "1 GPa", "shear_strength": "1 GPa"})
    model = Model(berg, _ocean(), parameters, start.date)
    found = []
    for date in dates:
        model.advance((date - start.date) / timedelta(days=1) - model.time / 86400.0)
        e = model.elements
        share = e.mass / e.mass.sum()
        found.append([float(np.dot(share, e.lon)), float(np.dot(share, e.lat))])
    return found
