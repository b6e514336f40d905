"""A68a near South Georgia in December 2020, without files: the berg's shape as lattice rows in a fitted ocean.

With the published strength, stiffness and drag the berg follows its observed path and turn, loses its northern tip
aground on 16 to 18 December and its southern finger afloat on 19 to 22 December; the tip stays behind on the shelf.
Without the shoal the tip stays on, without the shear the finger stays on.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from riftberg.constants import DEGREE, SECONDS_PER_DAY
from riftberg.experiments.a68a_observed import a68a_berg
from riftberg.experiments.registry import Info, Options
from riftberg.ocean.story import OWN, REFERENCE, StoryOcean
from riftberg.parameters import A68A_2022, A68A_2022_KID
from riftberg.physics.geometry import meridian_convergence

if TYPE_CHECKING:
    from riftberg.bergs.iceberg import Iceberg
    from riftberg.parameters import Packing
    from riftberg.runs.model import Model

DAYS = 17.0
"""From 9 to 26 December, 13:00."""

TURN = -10.0
"""Rotation at the start, degrees a day; the observed berg turned by 14 degrees on the first day, clockwise."""


def start_turning(berg: Iceberg, degrees_a_day: float) -> None:
    """Give a berg a rigid rotation about its centre, in addition to its velocity."""
    e, rate = berg.elements, math.radians(degrees_a_day) / SECONDS_PER_DAY
    lat0, lon0 = float(e.lat.mean()), float(e.lon.mean())
    x = berg.earth_radius * DEGREE * np.cos(0.5 * DEGREE * (e.lat + lat0)) * (e.lon - lon0)
    y = berg.earth_radius * DEGREE * (e.lat - lat0)
    # The local axes of an element are turned against those of the centre by the convergence of the meridians.
    angle = meridian_convergence(lat0, berg.earth_radius) * x
    du = rate * (-y * np.cos(angle) + x * np.sin(angle))
    dv = rate * (x * np.cos(angle) + y * np.sin(angle))
    for name in ("u", "u_pair", "u_sync"):
        getattr(e, name)[:] += du
    for name in ("v", "v_pair", "v_sync"):
        getattr(e, name)[:] += dv
    e.spin[:] += rate


def story_model(
    options: Options, *, radius: float = 1500.0, packing: Packing = "square", ocean: StoryOcean | None = None
) -> Model:
    """Return the model of the story for a radius of the elements (m) and a packing, unless the options name others."""
    from riftberg.runs.model import Model

    own = options.own
    ocean_here = ocean or StoryOcean(
        OWN if own else REFERENCE, shoal="shoal" not in options.without, shear="shear" not in options.without
    )
    lattice = {"radius": radius, "packing": packing, **options.lattice}
    berg = a68a_berg(**lattice)
    if own:
        start_turning(berg, TURN)
    parameters = A68A_2022 if own else A68A_2022_KID
    if lattice != {"radius": 1500.0, "packing": "square"}:
        # The number of sub-steps of the publication belongs to its lattice.
        parameters = parameters.changed(stepping={"substeps": None})
    return Model(berg, ocean_here, options.apply(parameters))


def build(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    notices = []
    if options.days is not None and options.days > DAYS:
        notices.append("this ocean is fitted to the drift until 26 December 13:00; beyond that it says nothing of A68a")
    if not options.own:
        notices.append("this ocean is another one than by default: it is fitted with the reference's numerics")
    left_out = "".join(f", without {part}" for part in sorted(options.without))
    title = f"A68a{left_out}"
    return story_model(options), Info("a68a", title, days=DAYS, output_every_hours=1.0, notices=tuple(notices))
