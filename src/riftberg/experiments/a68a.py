"""A68a near South Georgia without files: in a fitted ocean (``a68a``), and melting along its track (``a68a-melt``).

With the published strength, stiffness and drag the berg follows its observed path and turn, loses its northern tip
aground on 16 to 18 December and its southern finger afloat on 19 to 22 December; the tip stays behind on the shelf.
Without the shoal the tip stays on, without the shear the finger stays on.

Shape and observations
----------------------
The rows hold the 472 elements of the published run: Huth, Adcroft, Sergienko and Khan (2022), Science
Advances 8, eabq6974, whose `icebergs.res.nc` (github.com/alex-huth/iKID_iceberg_A68a, b0bfa83) follows from the outline
of 9 December by the rules of equations 10.5. They stand 0.1 degree south of the observed berg there.

Centroid, heading and area are from the daily outlines of Huth et al. (2022), repository alex-huth/iKID_iceberg_A68a at
b0bfa83 (digitised from MODIS and Sentinel-1 images): centroid and area of each outline, azimuth of the long side of its least
rectangle, degrees clockwise from north. Until 23 December the outlines include the finger.
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime
from typing import Any, Final, NamedTuple

import numpy as np
import shapely

from riftberg.bergs.bonding import Metric, turn_rigidly
from riftberg.bergs.iceberg import Iceberg
from riftberg.bergs.lattice import cells_region, expand_rows
from riftberg.bergs.regions import ReferencePlane
from riftberg.constants import DEGREE, EARTH_RADIUS_A68, EARTH_ROTATION, GRAVITY, SECONDS_PER_DAY
from riftberg.experiments.registry import Info, Options
from riftberg.ocean.forcing import Forcing
from riftberg.ocean.story import OWN, REFERENCE, StoryOcean
from riftberg.parameters import A68A_2022, A68A_2022_KID, ExplicitParameters, Packing
from riftberg.physics.elementary import cos_array
from riftberg.plane import EqualAreaPlane
from riftberg.runs.model import Model
from riftberg.state import Elements, Floats, Ints

# ---- the berg on 9 December, and its observations by day ----------------------------------------------------------------

A68A_RADIUS = 1500.0
"""Radius of the elements of the table, m."""

A68A_ROWS: list[tuple[int, int, int]] = [
    (0, 20, 24), (1, 17, 25), (2, 16, 25), (3, 11, 26), (4, 9, 30), (4, 41, 44), (5, 8, 30), (5, 40, 47), (6, 3, 31),
    (6, 37, 47), (7, 1, 46), (8, 1, 45), (9, 0, 43), (10, 0, 42), (11, 1, 37), (12, 1, 35), (13, 2, 3), (13, 5, 33),
    (14, 5, 30), (15, 10, 24), (16, 10, 21), (17, 13, 13),
]  # fmt: skip
"""(row, first column, last column), rows from south to north, columns from west to east."""

_FIRST_COLUMN, _FIRST_ROW = 10, 12
_WEST, _SOUTH = 319.2578125, -55.7015625
_NORTHWARD = 0.1


def a68a_berg(
    radius: float = A68A_RADIUS,
    packing: Packing = "square",
    *,
    lattice_angle: float = 0.0,
    offset: tuple[float, float] | None = None,
    thickness: Any = 200.0,
    velocity: tuple[float, float] = (0.22, 0.0),
    density: float = 850.0,
) -> Iceberg:
    """Return A68a as it was on 9 December 2020, 13:00.

    ``radius``: radius of the elements, m; ``thickness``, ``velocity``, ``density``: of the ice (m, m s-1, kg m-3), by default
    as in the paper.

    Examples
    --------
    >>> len(a68a_berg().elements.id)
    472

    """
    column, row = expand_rows(A68A_ROWS)
    region = cells_region(column, row, 2.0 * A68A_RADIUS)
    lon, lat = (float(a.mean()) for a in table_positions())
    x, y = _cell_centres(column, row)
    x, y = x - x.mean(), y - y.mean()
    # Rows are great circles now, whose ends lie nearer to the equator than the parallel at their middle: the tangent plane
    # touches where its elements get the mean position of the elements of the table.
    placed = [float(a.mean()) for a in EqualAreaPlane(lon, lat, EARTH_RADIUS_A68).inverse(x, y)]
    berg = Iceberg.from_table(
        A68A_ROWS, placement=(2 * lon - placed[0] - 360.0, 2 * lat - placed[1]), table_radius=A68A_RADIUS, radius=radius,
        lattice_angle=lattice_angle, offset=offset, thickness=thickness, packing=packing, velocity=velocity,
        density=density,
    )  # fmt: skip
    report = {
        "source": "A68a, 9 December 2020 (Huth et al. 2022)",
        "outline_area": region.area,
        "area_error": berg.area / region.area - 1.0,
    }
    return replace(berg, report=report)


def _cell_centres(column: Ints, row: Ints) -> tuple[Floats, Floats]:
    return np.asarray(2.0 * A68A_RADIUS * (column + 0.5)), np.asarray(2.0 * A68A_RADIUS * (row + 0.5))


def table_positions(northward: float = _NORTHWARD) -> tuple[Floats, Floats]:
    """Return longitude (0 to 360) and latitude of the elements of the table by the rules of the published run.

    ``northward``: degrees by which the berg is moved north undeformed; 0 gives the published positions.
    """
    x, y = _cell_centres(*expand_rows(A68A_ROWS))
    plane, side = ReferencePlane(_WEST, _SOUTH, 0.0, EARTH_RADIUS_A68), 2.0 * A68A_RADIUS
    lon, lat = plane.inverse(x + _FIRST_COLUMN * side, y + _FIRST_ROW * side)
    if northward == 0.0:
        return lon, lat
    middle, north = float(lon.mean()), lat + northward
    return middle + (lon - middle) * cos_array(lat * DEGREE) / cos_array(north * DEGREE), north


class ObservedDay(NamedTuple):
    """One day at about 13:00 UTC: day of December 2020, centroid (degrees), azimuth (degrees), area (km2)."""

    day: int
    lat: float
    lon: float
    azimuth: float
    area: float


A68A_OBSERVED = (
    ObservedDay(9, -55.0194, -39.2454, 99.0, 4151.0),
    ObservedDay(10, -55.0141, -38.9190, 113.0, 3269.0),
    ObservedDay(11, -55.0351, -38.6517, 116.0, 4090.0),
    ObservedDay(12, -55.0673, -38.3815, 129.0, 4235.0),
    ObservedDay(13, -55.1471, -38.1080, 145.0, 4057.0),
    ObservedDay(14, -55.2384, -37.8473, 163.0, 4285.0),
    ObservedDay(15, -55.3343, -37.6810, 175.0, 4081.0),
    ObservedDay(16, -55.4548, -37.4470, 8.0, 3965.0),
    ObservedDay(17, -55.6231, -37.3201, 13.0, 3891.0),
    ObservedDay(18, -55.7148, -37.1952, 172.0, 3984.0),
    ObservedDay(19, -55.8481, -37.1942, 5.0, 3861.0),
    ObservedDay(20, -56.0435, -37.0390, 4.0, 3909.0),
    ObservedDay(21, -56.2168, -36.9125, 174.0, 4025.0),
    ObservedDay(22, -56.3864, -36.7718, 172.0, 3959.0),
    ObservedDay(23, -56.5777, -36.5773, 164.0, 4180.0),
    ObservedDay(24, -56.6405, -36.4418, 16.0, 2133.0),
    ObservedDay(25, -56.8691, -36.2917, 9.0, 3080.0),
    ObservedDay(26, -57.0181, -36.0184, 177.0, 2776.0),
)
"""The observed days; images of 10 and 24 December show only a part of the berg."""

REGION = (-41.5, -34.0), (-58.5, -54.0)
"""Longitudes and latitudes (degrees) that the berg and its pieces crossed until 27 December, with a margin."""

PARTIAL = (10, 24)
"""Days of December of which only a part of the berg was seen."""

PUBLISHED = {
    "break-up 1": "around 17 Dec, aground: the tip (A68D)",
    "break-up 2": "around 20 Dec, afloat: the finger",
    "wall time a day": "about 10 s (Xeon E5-2697 v4)",
}
"""The run by Huth et al. (2022) as they report it (text, Fig. 2, "Computational efficiency")."""

SEEN = {
    "break-up 1": "17 Dec, aground: 134 to 157 km² (A68D)",
    "break-up 2": "21 to 22 Dec, afloat: 595 to 652 km² (the finger)",
    "break-up 3": "seen 23 Dec: 222 to 226 km²",
    "largest piece at the end": "2596 to 2641 km² (23 to 25 Dec)",
}
"""Observed break-ups: Huth et al. (2022), and areas of the outlines in its repository."""


# ---- the experiment -----------------------------------------------------------------------------------------------------

DAYS = 17.0
"""From 9 to 26 December, 13:00."""

TURN = -10.0
"""Rotation at the start, degrees a day; the observed berg turned by 14 degrees on the first day, clockwise."""


def story_model(
    options: Options, *, radius: float = 1500.0, packing: Packing = "square", ocean: StoryOcean | None = None
) -> Model:
    """Return the model of the story for a radius of the elements (m) and a packing, unless the options name others."""
    from riftberg.runs.model import Model

    own_numerics = options.own
    ocean_here = ocean or StoryOcean(
        OWN if own_numerics else REFERENCE, shoal="shoal" not in options.without, shear="shear" not in options.without
    )
    lattice = {"radius": radius, "packing": packing, **options.lattice}
    parameters = A68A_2022 if own_numerics else A68A_2022_KID
    berg = a68a_berg(**lattice, density=options.apply(parameters).ice.density)
    if own_numerics:
        turn_rigidly(berg.elements, math.radians(TURN) / SECONDS_PER_DAY, Metric(True, berg.earth_radius))
    adjusted, stepping_changes = options.apply(parameters), options.changes.get("stepping", {})
    other_lattice = lattice != {"radius": 1500.0, "packing": "square"}
    if isinstance(adjusted, ExplicitParameters) and other_lattice and "substeps" not in stepping_changes:
        adjusted = adjusted.changed(stepping={"substeps": None})  # the published number belongs to its lattice
    return Model(berg, ocean_here, adjusted)


def build_a68a(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    notices = []
    if options.days is not None and options.days > DAYS:
        notices.append("this ocean is fitted to the drift until 26 December 13:00; beyond that it says nothing of A68a")
    if not options.own:
        notices.append("this ocean is another one than by default: it is fitted with the reference's numerics")
    left_out = "".join(f", without {name}" for name in sorted(options.without))
    title = f"A68a{left_out}"
    return story_model(options), Info("a68a", title, days=DAYS, output_every_hours=1.0, notices=tuple(notices))


# ---- three months of melt along the observed track ----------------------------------------------------------------------

# The berg is carried along the track that scatterometers saw; temperature, salinity and wind are formulas within published
# ranges, not measurements. Its loss is compared with altimetry: 152 +- 61 Gt of fresh water in about three months,
# melt of the base of up to 7.2 +- 2.3 m a month (Braakmann-Folgmann et al. 2022, Remote Sens. Environ. 269, 112780).

MELT_START: Final = datetime(2020, 10, 28)
MELT_DAYS: Final = 92.0
"""28 October 2020 to 28 January 2021."""

TRACK: Final = (
    (-56.95, -44.83), (-56.32, -43.02), (-56.21, -42.46), (-56.29, -41.70), (-56.18, -41.32), (-55.56, -41.63),
    (-55.16, -41.05), (-55.01, -39.38), (-55.34, -37.74), (-56.04, -37.09), (-57.31, -35.11), (-56.75, -35.01),
    (-56.53, -36.17), (-56.82, -35.66), (-56.82, -34.73), (-56.33, -36.10), (-57.22, -35.75),
)  # fmt: skip
"""Latitude and longitude every six days from 28 October 2020 (Antarctic iceberg database of BYU and NIC, rounded)."""

TRACK_DAYS: Final = 6.0

MELT_THICKNESS: Final = 190.0
"""Mean thickness at the start, m: 168 +- 10 m in January 2021, and about 20 m more before these three months."""


class TrackSea(Forcing):
    """A sea that carries a berg along its track, with the season's temperature.

    The current is uniform: the velocity of the track, and a part that brings the berg back to it within two days. The sea
    surface slopes in balance with it. The wind turns, so that it raises waves and carries the berg nowhere.

    ``warmest``: temperature of the surface in the middle of February at 55 degrees south, degrees Celsius.
    """

    start = MELT_START  # a run of another date is refused
    SWING: Final = 1.8  # Half the range of the year, degrees
    POLEWARD: Final = 0.6  # How much colder a degree further south is, degrees
    DEEP: Final = 1.0  # How much colder the mean over the draft is than the surface, degrees

    def __init__(self, warmest: float = 3.3) -> None:
        self.provides = frozenset(("sst", "sss"))
        self.warmest = warmest
        self.latitudes, self.longitudes = np.array(TRACK).T

    def place(self, time: float) -> tuple[float, float]:
        """Longitude and latitude of the track at a time (s)."""
        knots = TRACK_DAYS * SECONDS_PER_DAY * np.arange(len(TRACK))
        return float(np.interp(time, knots, self.longitudes)), float(np.interp(time, knots, self.latitudes))

    def surface_temperature(self, latitude: Floats, time: float) -> Floats:
        """Temperature of the surface, degrees Celsius; highest in the middle of February."""
        day = (MELT_START - datetime(2020, 2, 15)).days + time / SECONDS_PER_DAY
        season = self.warmest - self.SWING * (1.0 - math.cos(2.0 * math.pi * day / 365.25))
        return np.maximum(season - self.POLEWARD * (np.abs(latitude) - 55.0), -1.8)

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        e, (lon, lat) = elements, self.place(time)
        later = self.place(time + 3600.0)
        metre = DEGREE * EARTH_RADIUS_A68
        east = metre * math.cos(lat * DEGREE)
        offset = (lon - float(e.lon.mean())) * east, (lat - float(e.lat.mean())) * metre
        back = 2.0 * SECONDS_PER_DAY
        u = (later[0] - lon) * east / 3600.0 + offset[0] / back
        v = (later[1] - lat) * metre / 3600.0 + offset[1] / back
        f = 2.0 * EARTH_ROTATION * math.sin(lat * DEGREE)
        angle = 2.0 * math.pi * time / (4.0 * SECONDS_PER_DAY)
        e.uo[:], e.vo[:] = u, v
        e.slope_x[:], e.slope_y[:] = f * v / GRAVITY, -f * u / GRAVITY
        e.ua[:], e.va[:] = 9.0 * math.cos(angle), 9.0 * math.sin(angle)
        e.ui[:] = e.vi[:] = e.ice_thickness[:] = e.ice_fraction[:] = e.vorticity[:] = 0.0
        e.depth[:] = 3000.0
        e.sst[:] = self.surface_temperature(e.lat, time)
        e.keel_temperature[:] = np.maximum(e.sst - self.DEEP, -1.8)
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
        """Return a description of this sea, in plain words."""
        return (
            "a sea that carries A68a along its observed track; temperature, salinity and wind by formula, not measured"
        )


def melting_a68a(options: Options, *, radius: float = 1500.0, sea: TrackSea | None = None) -> Model:
    """Return the model of A68a melting.

    ``radius``: radius of the elements, m.
    """
    from riftberg.runs.model import Model

    here = sea or TrackSea()
    parameters = options.apply(A68A_2022.changed(melt={"enabled": True, "tide": 0.1}, fracture={"enabled": False}))
    berg = a68a_berg(
        **{"radius": radius, **options.lattice}, thickness=MELT_THICKNESS, velocity=(0.1, 0.05),
        density=parameters.ice.density,
    )  # fmt: skip
    lon, lat = here.place(0.0)
    e = berg.elements
    scale = math.cos(float(e.lat.mean()) * DEGREE) / math.cos(lat * DEGREE)
    middle, north = float(e.lon.mean()), lat - float(e.lat.mean())

    def moved(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        return lon + (x - middle) * scale, y + north

    e.lon[:], e.lat[:] = moved(e.lon, e.lat)
    berg = replace(berg, outlines=tuple(shapely.transform(ice, moved, interleaved=False) for ice in berg.outlines))
    e.lon_pair[:], e.lat_pair[:] = e.lon, e.lat
    return Model(berg, here, parameters, MELT_START)


def build_melt(options: Options) -> tuple[Model, Info]:
    """Build the experiment (see `riftberg.experiments.build`)."""
    notices = ["temperature, salinity and wind are formulas within published ranges, and the berg stays whole"]
    if options.days is not None and options.days > MELT_DAYS:
        notices.append("the track ends on 1 February 2021; beyond that the berg stays there")
    title = "A68a melts"
    return melting_a68a(options), Info(
        "a68a-melt", title, days=MELT_DAYS, output_every_hours=24.0, notices=tuple(notices)
    )
