"""Bergs of one element each, of given length and width."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from riftberg.bergs.bonded import BondedBerg
from riftberg.bergs.bonding import BondRule
from riftberg.bergs.keys import PointOptions, berg_options
from riftberg.bergs.lattice import element_area
from riftberg.bergs.placement import bond_points, check_positions
from riftberg.config.values import numbers
from riftberg.errors import BergError
from riftberg.state import Floats

LONGEST: Final = 1e6
"""Greatest length of a lone berg, m."""

SHORTEST: Final = 1e-6
"""Distance (m) within which lone bergs would be bonded: none lie as close."""


def make_lone_bergs(
    lon: Any, lat: Any, length: Any, width: Any, thickness: Any, options: dict[str, Any], idle: dict[str, Any],
    *, overlap: bool = False,
) -> BondedBerg:  # fmt: skip
    """Return bergs of one element each; ``idle``: options that they cannot have, by name."""
    extra = [*(name for name, value in idle.items() if value is not None), *({"radius", "pieces"} & options.keys())]
    if extra:
        raise BergError(
            f"{extra[0]} beside length and width", where="Iceberg.from_points",
            remedy="Each berg of given length and width is one element, which is bonded to none: leave it out",
        )  # fmt: skip
    count = max(np.size(lon), np.size(lat))
    lon, lat = (
        np.broadcast_to(np.atleast_1d(coordinate), count) if np.size(coordinate) == 1 else coordinate
        for coordinate in (lon, lat)
    )
    long, wide = check_sides(length, width, count)
    packing = options.get("packing", "square")
    radius = np.sqrt(long * wide / element_area(1.0, packing))
    static, period = options.pop("static", False), options.pop("period", None)
    sized = {**options, "radius": radius if count != 1 else float(radius[0]), "pieces": np.arange(count)}
    settings = berg_options(sized, PointOptions, thickness)
    lon, lat, period = check_positions(lon, lat, period, settings.latlon)
    unbonded = BondRule(SHORTEST, settings.packing)
    berg = bond_points(lon, lat, settings, static=static, rule=unbonded, period=period, overlap=overlap)
    names = tuple((f"{k + 1}", 1) for k in range(count)) if count > 1 else berg.bergs
    return set_sides(replace(berg, report={"source": "points"}, bergs=names), long, wide)


def set_sides(berg: BondedBerg, length: Floats, width: Floats) -> BondedBerg:
    """Give lone bergs their length and width (m), of which the longer one counts as the length."""
    berg.elements.length[:], berg.elements.width[:] = np.maximum(length, width), np.minimum(length, width)
    return berg


def check_sides(length: Any, width: Any, count: int) -> tuple[Floats, Floats]:
    """Return length and width (m) of so many bergs, or refuse impossible ones."""
    if length is None:
        raise BergError("a width without a length", where="width", remedy="Give length too")
    sides = []
    for name, value in (("length", length), ("width", length if width is None else width)):
        side = numbers(value, "m", where=name, kind=BergError)
        if side.shape not in ((), (1,), (count,)):
            raise BergError(
                f"{side.size} values for {count} bergs", where=name, remedy="Give one number, or one for each"
            )
        if not (np.isfinite(side) & (side > 0.0) & (side <= LONGEST)).all():
            raise BergError(
                f"a {name} that no berg has", where=name, remedy=f"Give metres above 0, at most {LONGEST:g}"
            )
        sides.append(np.broadcast_to(side, count).astype(np.float64))
    return sides[0], sides[1]
