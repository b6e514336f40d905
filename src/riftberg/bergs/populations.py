"""Fields and clouds of many small bergs: sizes from a distribution of the literature, places drawn without overlap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from typing import Any, Final

import numpy as np

from riftberg.bergs.bonded import BondedBerg, check_seed
from riftberg.bergs.bonding import BondRule, Metric, separations
from riftberg.bergs.keys import CloudOfBergs, CloudOptions, FieldOfBergs, FieldOptions, PointOptions, berg_options
from riftberg.bergs.lone_bergs import check_sides, make_lone_bergs
from riftberg.bergs.placement import bond_points, check_positions
from riftberg.config.values import check_place, flag, given, moment, native, numbers
from riftberg.constants import DEGREE
from riftberg.errors import BergError, InputError
from riftberg.physics.elementary import asin, cos, sin
from riftberg.plane import EqualAreaPlane
from riftberg.state import Floats
from riftberg.system.input_files import check_elements, value_shown

# "gladstone" has the ten classes of length, thickness and frequency of Gladstone, Bigg and Nicholls (2001, JGR Oceans
# 106, 19903, table 1) as most models of iceberg drift use them. "tournadre" has areas by the power law of Tournadre
# et al. (2016, JGR Oceans 121, 327), who find the exponent -1.52 (+-0.32) for areas of 0.1 to 10 000 km2 around Antarctica,
# near the -3/2 of brittle fragmentation. Thickness follows the length as in the classes of Gladstone et al.

LENGTHS: Final = np.array([60.0, 100.0, 200.0, 350.0, 500.0, 700.0, 900.0, 1200.0, 1600.0, 2200.0])
"""Lengths of the classes, m."""

THICKNESSES: Final = np.array([40.0, 67.0, 133.0, 175.0, 250.0, 250.0, 250.0, 250.0, 250.0, 250.0])
"""Thicknesses of the classes, m."""

SHARES: Final = np.array([0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02])
"""Parts of the number of bergs in the classes; they are scaled to 1."""

ASPECT: Final = 1.5
"""Length over width of the bergs of these classes."""

EXPONENT: Final = 1.52
"""Exponent of the power law of areas."""

TRIES: Final = 2000
"""Places that are tried for a berg before the area counts as full."""

SIZES: Final = ("gladstone", "tournadre")


def draw_field(
    n: int, area: Any, sizes: Any, seed: int | None, thickness: Any, gap: float, between: tuple[float, float],
    options: dict[str, Any],
) -> BondedBerg:  # fmt: skip
    """Draw a field of bergs; arguments as of `riftberg.bergs.iceberg.Iceberg.field`."""
    n = given(n, FieldOfBergs, "number", where="n", kind=BergError)
    check_elements(n, kind=BergError)
    gap = given(gap, FieldOfBergs, "gap", kind=BergError)
    between = given(between, FieldOfBergs, "between", kind=BergError)
    area = checked_area(area, latlon=flag(options.get("latlon", True), where="latlon", kind=BergError))
    seed = check_seed(seed)
    random = np.random.default_rng(seed)
    plan = areas(n, sizes, random, between)
    heights = usual_thickness(plan) if thickness is None else thickness
    settings = berg_options(options, FieldOptions, heights)
    # The length over the width of bergs of a distribution: the classes are of long bergs, all others of squares.
    aspect = ASPECT if isinstance(sizes, str) and sizes == "gladstone" else 1.0
    # Rectangles of any turn keep clear of each other where their corners do.
    reach = np.sqrt(0.25 * (aspect + 1.0 / aspect) * plan)
    metric = Metric(settings.latlon, settings.earth_radius, 360.0 if settings.latlon else 0.0)
    box = checked_box(area)
    x, y = place_discs(reach, lambda: _draw_point(*box, metric.latlon, random), gap, metric, where="Iceberg.field")
    sized = {**options, "radius": 0.5 * np.sqrt(plan), "pieces": np.arange(n)}
    elements = berg_options(sized, PointOptions, heights)
    x, y, period = check_positions(x, y, None, elements.latlon)
    berg = bond_points(x, y, elements, rule=BondRule(packing=elements.packing), period=period)
    berg.elements.length[:] *= np.sqrt(aspect)
    berg.elements.width[:] /= np.sqrt(aspect)
    report = {"source": f"field of {n} bergs", "sizes": sizes if isinstance(sizes, str) else "given", "seed": seed}
    return replace(berg, report=report, bergs=tuple((f"{k + 1}", 1) for k in range(n)))


def draw_cloud(
    n: int, placement: tuple[float, float], radius: float, thickness: Any, sizes: Any, seed: int | None,
    options: dict[str, Any],
) -> BondedBerg:  # fmt: skip
    """Draw bergs around a place; arguments as of `riftberg.bergs.iceberg.Iceberg.cloud`."""
    options = dict(options)
    length, width = options.pop("length", None), options.pop("width", None)
    overlap = flag(options.pop("overlap", False), where="overlap", kind=BergError)
    dates = options.pop("dates", None)
    n = given(n, CloudOfBergs, "number", where="n", kind=BergError)
    check_elements(n, kind=BergError)
    radius = given(radius, CloudOfBergs, "radius", kind=BergError)
    gap = given(options.pop("gap", 0.0), CloudOfBergs, "gap", kind=BergError)
    between = given(options.pop("between", (0.1e6, 10e6)), CloudOfBergs, "between", kind=BergError)
    seed = check_seed(seed)
    random = np.random.default_rng(seed)
    if length is None and width is None:
        plan = areas(n, sizes, random, between)
        aspect = ASPECT if isinstance(sizes, str) and sizes == "gladstone" else 1.0
        long, wide = np.sqrt(aspect * plan), np.sqrt(plan / aspect)
    else:
        long, wide = check_sides(length, width, n)
    heights = usual_thickness(long * wide) if thickness is None else thickness
    settings = berg_options(options, CloudOptions, heights, placement=placement)
    assert settings.placement is not None
    middle = settings.placement
    metric = Metric(settings.latlon, settings.earth_radius, 360.0 if settings.latlon else 0.0)
    plane = EqualAreaPlane(*middle, settings.earth_radius) if settings.latlon else None

    def drawn() -> tuple[float, float]:
        distance, turn = radius * np.sqrt(random.random()), 2.0 * np.pi * random.random()
        east, north = distance * cos(turn), distance * sin(turn)
        if plane is None:
            return middle[0] + east, middle[1] + north
        lon, lat = plane.inverse(np.array([east]), np.array([north]))
        return float(lon[0]), float(lat[0])

    if overlap:
        x, y = (np.array(coordinate) for coordinate in zip(*(drawn() for _ in range(n)), strict=True))
    else:  # rectangles of any turn keep clear of each other where their corners do
        x, y = place_discs(0.5 * np.hypot(long, wide), drawn, gap, metric, where="Iceberg.cloud")
    berg = make_lone_bergs(x, y, long, wide, heights, options, {}, overlap=overlap)
    return replace(berg, report={"source": f"cloud of {n} bergs", "seed": seed}, dates=berg_dates(dates, n))


def berg_dates(dates: Any, count: int) -> tuple[datetime, ...]:
    """Return the date (UTC) at which each of some bergs comes: one for all, first and last, or one for each; none for None.

    Examples
    --------
    >>> [str(date) for date in berg_dates(("2020-12-09", "2020-12-11"), 3)]
    ['2020-12-09 00:00:00', '2020-12-10 00:00:00', '2020-12-11 00:00:00']
    """
    if dates is None:
        return ()
    given_dates = list(dates) if isinstance(dates, list | tuple | np.ndarray) else [dates]
    try:
        moments = [moment(date, where="dates") for date in given_dates]
    except InputError as error:
        raise BergError(str(error)) from error
    if len(moments) not in (1, 2, count):
        raise BergError(
            f"{len(moments)} dates for {count} bergs",
            where="dates",
            remedy="Give one, the first and the last, or one for each",
        )
    if any(late < early for early, late in pairwise(moments)):
        raise BergError("dates do not rise", where="dates", remedy="Give them in their order")
    if len(moments) == count:
        return tuple(moments)
    span = moments[-1] - moments[0]
    return tuple(moments[0] + span * (k / max(1, count - 1)) for k in range(count))


def areas(count: int, sizes: Any, random: np.random.Generator, between: tuple[float, float]) -> Floats:
    """Return plan areas of bergs, m2.

    ``sizes``: the distribution, or areas (m2) to draw from; ``between``: least and largest area (m2) of the power law.
    """
    if isinstance(sizes, str):
        if sizes == "gladstone":
            length = random.choice(LENGTHS, count, p=SHARES / SHARES.sum())
            return np.asarray(length * length / ASPECT)
        if sizes == "tournadre":
            return power_law(random.random(count), *between)
        raise BergError(f"sizes {sizes!r}", where="Iceberg.field", remedy=f"Use {', '.join(SIZES)}, or areas in m2")
    choices = numbers(sizes, "m2", where="sizes", kind=BergError).ravel()
    if choices.size == 0 or not (np.isfinite(choices) & (choices > 0.0)).all():
        raise BergError("sizes that are no areas", where="Iceberg.field", remedy="Give areas in m2, above 0")
    return np.asarray(random.choice(choices, count))


def checked_area(area: Any, *, latlon: bool) -> tuple[float, float, float, float]:
    """Return west, east, south and north of a field (degrees; m if not ``latlon``), or refuse an impossible box."""
    if latlon:
        west, east, south, north = given(area, FieldOfBergs, "area", kind=BergError)
        for latitude in (south, north):
            check_place((0.5 * (west + east), latitude), where="area", kind=BergError)
        return west, east, south, north
    metres = numbers(native(area), "m", where="area", kind=BergError)
    if metres.shape != (4,):
        raise BergError(
            f"{value_shown(area)} is no area", where="area", remedy="Give west, east, south and north in metres"
        )
    return tuple(metres.tolist())


def power_law(share: Floats, least: float, largest: float, exponent: float = EXPONENT) -> Floats:
    """Return the areas below which these shares (0 to 1) of a power law between two areas lie: its inverse distribution."""
    if not 0.0 < least < largest:
        raise BergError(
            f"areas between {least:g} and {largest:g} m2",
            where="Iceberg.field",
            remedy="Give a smaller one above 0 first",
        )
    a, b = least ** (1.0 - exponent), largest ** (1.0 - exponent)
    return np.asarray((a + share * (b - a)) ** (1.0 / (1.0 - exponent)))


def usual_thickness(area: Floats) -> Floats:
    """Return the thickness (m) that goes with plan areas (m2), by the length of bergs of the usual aspect."""
    return np.asarray(np.interp(np.sqrt(ASPECT * area), LENGTHS, THICKNESSES), np.float64)


def checked_box(box: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return west, east, south and north, or refuse them in another order."""
    west, east, south, north = box
    if not (west < east and south < north and all(np.isfinite(box))):
        raise BergError(
            f"area {list(box)}", where="Iceberg.field", remedy="Give west, east, south and north, the smaller one first"
        )
    return box


def place_discs(
    radius: Floats, drawn: Callable[[], tuple[float, float]], gap: float, metric: Metric, *, where: str
) -> tuple[Floats, Floats]:
    """Return places at which discs of these radii (m) keep a gap (m), the largest first placed.

    ``radius``: half of the greatest extent of each berg, m; ``drawn`` draws a place; ``gap``: least distance of the rims, m.
    """
    # The largest first: they find no place once small ones stand everywhere.
    order = np.argsort(-radius, kind="stable")
    lon, lat = np.full(radius.size, np.nan), np.full(radius.size, np.nan)
    for n, k in enumerate(order):
        placed = order[:n]
        for _ in range(TRIES):
            x, y = drawn()
            dx, dy = separations(metric, lon[placed], lat[placed], np.asarray(x), np.asarray(y))
            if n == 0 or (np.hypot(dx, dy) > radius[placed] + radius[k] + gap).all():
                lon[k], lat[k] = x, y
                break
        else:
            raise BergError(
                f"no place is left for berg {n + 1} of {radius.size}", where=where,
                remedy="Take a larger area, fewer bergs, or a smaller gap",
            )  # fmt: skip
    return lon, lat


def _draw_point(
    west: float, east: float, south: float, north: float, latlon: bool, random: np.random.Generator
) -> tuple[float, float]:
    """Return a point of a box, each square metre as likely as any other."""
    x, share = west + (east - west) * random.random(), random.random()
    if not latlon:
        return x, south + (north - south) * share
    # The area of a belt grows with the sine of latitude.
    low, high = sin(south * DEGREE), sin(north * DEGREE)
    return x, asin(low + (high - low) * share) / DEGREE
