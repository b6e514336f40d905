"""A68a melts around South Georgia, November 2020 to January 2021: along its observed track, in a sea made by formula.

The berg is carried along the track that scatterometers saw; temperature, salinity and wind are formulas within published
ranges, not measurements. What it loses is compared with altimetry: 152 +- 61 Gt of fresh water in about three months,
melt of the base of up to 7.2 +- 2.3 m a month (Braakmann-Folgmann et al. 2022, Remote Sens. Environ. 269, 112780).
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime
from typing import TYPE_CHECKING, Final

import numpy as np
import shapely

from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY, SECONDS_PER_DAY
from riftberg.experiments.a68a import a68a_berg
from riftberg.experiments.registry import Info, Options
from riftberg.ocean.analytic import Steady
from riftberg.parameters import A68A_2022
from riftberg.state import Elements, Floats

if TYPE_CHECKING:
    from riftberg.runs.model import Model

START: Final = datetime(2020, 10, 28)
DAYS: Final = 92.0
"""28 October 2020 to 28 January 2021."""

TRACK: Final = (
    (-56.95, -44.83), (-56.32, -43.02), (-56.21, -42.46), (-56.29, -41.70), (-56.18, -41.32), (-55.56, -41.63),
    (-55.16, -41.05), (-55.01, -39.38), (-55.34, -37.74), (-56.04, -37.09), (-57.31, -35.11), (-56.75, -35.01),
    (-56.53, -36.17), (-56.82, -35.66), (-56.82, -34.73), (-56.33, -36.10), (-57.22, -35.75),
)  # fmt: skip
"""Latitude and longitude every six days from 28 October 2020 (Antarctic iceberg database of BYU and NIC, rounded)."""

TRACK_DAYS: Final = 6.0

THICKNESS: Final = 190.0
"""Mean thickness at the start, m: 168 +- 10 m in January 2021, and about 20 m more before these three months."""

FRESH_WATER: Final = (152.0, 61.0)
"""Observed loss and its error, Gt."""

THINNING: Final = (21.6, 6.9)
"""Observed melt of the base and its error in three months at the rate of the peak, m."""


class TrackSea(Steady):
    """A sea that carries a berg along its track, with the season's temperature.

    The current is uniform: the velocity of the track, and what brings the centre of the berg back to it within two days. The
    sea surface slopes in balance with it. The wind turns, so that it raises waves and carries the berg nowhere.

    ``warmest``: temperature of the surface in the middle of February at 55 degrees south, degrees Celsius; ``swing``:
    half the range of the year, degrees; ``poleward``: how much colder a degree further south is, degrees; ``deep``: how
    much colder the mean over the draft is than the surface, degrees.
    """

    def __init__(self, warmest: float = 3.3, swing: float = 1.8, poleward: float = 0.6, deep: float = 1.0) -> None:
        super().__init__()
        self.provides = frozenset(("sst", "sss"))
        self.warmest, self.swing, self.poleward, self.deep = warmest, swing, poleward, deep
        self.latitudes, self.longitudes = np.array(TRACK).T

    def place(self, time: float) -> tuple[float, float]:
        """Longitude and latitude of the track at a time (s)."""
        knots = TRACK_DAYS * SECONDS_PER_DAY * np.arange(len(TRACK))
        return float(np.interp(time, knots, self.longitudes)), float(np.interp(time, knots, self.latitudes))

    def surface_temperature(self, latitude: Floats, time: float) -> Floats:
        """Temperature of the surface, degrees Celsius; highest in the middle of February."""
        day = (START - datetime(2020, 2, 15)).days + time / SECONDS_PER_DAY
        season = self.warmest - self.swing * (1.0 - math.cos(2.0 * math.pi * day / 365.25))
        return np.maximum(season - self.poleward * (np.abs(latitude) - 55.0), -1.8)

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        e, (lon, lat) = elements, self.place(time)
        later = self.place(time + 3600.0)
        metre = DEGREE * EARTH_RADIUS_A68
        east = metre * math.cos(lat * DEGREE)
        away = (lon - float(e.lon.mean())) * east, (lat - float(e.lat.mean())) * metre
        back = 2.0 * SECONDS_PER_DAY
        u = (later[0] - lon) * east / 3600.0 + away[0] / back
        v = (later[1] - lat) * metre / 3600.0 + away[1] / back
        f = 2.0 * EARTH_ROTATION * math.sin(lat * DEGREE)
        angle = 2.0 * math.pi * time / (4.0 * SECONDS_PER_DAY)
        e.uo[:], e.vo[:] = u, v
        e.slope_x[:], e.slope_y[:] = f * v / GRAVITY, -f * u / GRAVITY
        e.ua[:], e.va[:] = 9.0 * math.cos(angle), 9.0 * math.sin(angle)
        e.ui[:] = e.vi[:] = e.ice_thickness[:] = e.ice_fraction[:] = e.vorticity[:] = 0.0
        e.depth[:] = 3000.0
        e.sst[:] = self.surface_temperature(e.lat, time)
        e.keel_temperature[:] = np.maximum(e.sst - self.deep, -1.8)
        e.sss[:] = 33.9

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the velocity of the track (m s-1) at arrays of points."""
        here, later = self.place(time), self.place(time + 3600.0)
        metre = DEGREE * EARTH_RADIUS_A68
        u = (later[0] - here[0]) * metre * math.cos(here[1] * DEGREE) / 3600.0
        v = (later[1] - here[1]) * metre / 3600.0
        return np.full(np.shape(lon), u), np.full(np.shape(lon), v)

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        return np.full(np.shape(lon), 3000.0)

    def describe(self) -> str:
        """Return what this sea is, in plain words."""
        return (
            "a sea that carries A68a along its observed track; temperature, salinity and wind by formula, not measured"
        )


def melting_a68a(options: Options, *, radius: float = 1500.0, sea: TrackSea | None = None) -> Model:
    """Return the model of A68a melting.

    ``radius``: radius of the elements, m.
    """
    from riftberg.runs.model import Model

    here = sea or TrackSea()
    berg = a68a_berg(**{"radius": radius, **options.lattice}, thickness=THICKNESS, velocity=(0.1, 0.05))
    lon, lat = here.place(0.0)
    e = berg.elements
    scale = math.cos(float(e.lat.mean()) * DEGREE) / math.cos(lat * DEGREE)
    middle, north = float(e.lon.mean()), lat - float(e.lat.mean())

    def moved(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        return lon + (x - middle) * scale, y + north

    e.lon[:], e.lat[:] = moved(e.lon, e.lat)
    berg = replace(berg, outlines=tuple(shapely.transform(ice, moved, interleaved=False) for ice in berg.outlines))
    e.lon_pair[:], e.lat_pair[:] = e.lon, e.lat
    parameters = A68A_2022.changed(
        melt={"enabled": True, "tide": 0.1}, fracture={"enabled": False}, stepping={"substeps": None}
    )
    return Model(berg, here, options.apply(parameters), START)


def build(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    notices = ["temperature, salinity and wind are formulas within published ranges, and the berg stays whole"]
    if options.days is not None and options.days > DAYS:
        notices.append("the track ends on 1 February 2021; beyond that the berg stays there")
    title = "A68a melts"
    return melting_a68a(options), Info("a68a-melt", title, days=DAYS, output_every_hours=24.0, notices=tuple(notices))
