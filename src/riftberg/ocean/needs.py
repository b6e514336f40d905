"""Needs of a run: one row for each quantity of ocean, air, sea ice and sea floor, and what a run does without it.

Values at the elements, checks before a run, its notices, the doctor and the page of products read this table.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

if TYPE_CHECKING:
    from riftberg.parameters import Parameters


SeaLevel = Literal["auto", "files", "geostrophic", "none"]
"""Where the slope of the sea surface comes from; `riftberg.ocean.balance.decided` resolves ``auto``."""


class Need(NamedTuple):
    """One quantity that acts on bergs or melts them."""

    quantity: str  # In words
    fields: tuple[str, ...]  # Canonical names in products; a vector is named by the first
    variables: tuple[str, ...]  # Variables of the elements that follow from it
    needed: str  # When, in words
    without: str  # What a run does without it, in words
    default: float = 0.0  # First of the variables where nothing gives the quantity; the others are 0
    over_draft: str = ""  # Variable for its mean over the draft, where it comes on levels
    expected: bool = False  # Of every set of files, with a value wherever a berg starts
    required: Callable[[Parameters], bool] = lambda _: False  # Whether a run is refused without it, by its parameters


def _melts(p: Parameters) -> bool:
    return p.melt.enabled and not p.melt.zero_rates


def _needs_temperature(p: Parameters) -> bool:
    return _melts(p) and p.melt.temperature is None


def _needs_salinity(p: Parameters) -> bool:
    by_salt = p.melt.base != "turbulent" and p.melt.mode != "berg" and p.melt.salinity_from_ocean
    return _melts(p) and by_salt and p.melt.salinity is None


CURRENT: Final = Need(
    "ocean current", ("uo", "vo"), ("uo", "vo", "vorticity"), "always", "no run from files starts",
    expected=True, required=lambda _: True,
)  # fmt: skip
WIND: Final = Need("wind", ("ua", "va"), ("ua", "va"), "to push bergs and raise waves", "calm air", expected=True)
SEA_LEVEL: Final = Need(
    "sea level", ("ssh",), ("slope_x", "slope_y"), "for the slope of the sea surface",
    "the slope of the sea surface that balances the current (sea_level says otherwise)", expected=True,
)  # fmt: skip
DEPTH: Final = Need(
    "depth of the sea floor", ("depth_below_surface",), ("depth",), "where bergs may run aground",
    "an open ocean: bergs run aground nowhere", default=1e4,
)  # fmt: skip
TEMPERATURE: Final = Need(
    "temperature", ("sst",), ("sst",), "with `melt.enabled`, unless `melt.temperature` is given", "no run with melt starts",
    over_draft="keel_temperature", required=_needs_temperature,
)  # fmt: skip
SALINITY: Final = Need(
    "salinity", ("sss",), ("sss",),
    "with `melt.enabled` and a base that melts by the equations of a layer, unless `melt.salinity` is given",
    "no run with melt starts", default=-1.0, over_draft="keel_salinity", required=_needs_salinity,
)  # fmt: skip
_ICE: Final = (
    "no sea ice; if one of concentration, thickness and velocity is missing, it exerts no force with `quasi_static`"
)
ICE_VELOCITY: Final = Need("velocity of sea ice", ("ui", "vi"), ("ui", "vi"), "where there is sea ice", _ICE)
ICE_CONCENTRATION: Final = Need(
    "concentration of sea ice", ("ice_fraction",), ("ice_fraction",), "where there is sea ice", _ICE
)
ICE_THICKNESS: Final = Need(
    "thickness of sea ice", ("ice_thickness",), ("ice_thickness",), "where there is sea ice", _ICE
)
WAVES: Final = Need(
    "waves", ("wave_height", "wave_direction", "wave_period"), ("wave_height", "wave_x", "wave_y", "wave_period"),
    "to push bergs: height and direction, with the period if there is one", "waves that follow from the wind", default=-1.0,
)  # fmt: skip

NEEDS: Final = (
    CURRENT, ICE_VELOCITY, WIND, SEA_LEVEL, DEPTH, TEMPERATURE, SALINITY, ICE_CONCENTRATION, ICE_THICKNESS, WAVES,
)  # fmt: skip

BY_FIELD: Final = {need.fields[0]: need for need in NEEDS}
"""Needs by the first of their fields: a vector by its eastward component."""

DEFAULTS: Final = {need.variables[0]: need.default for need in NEEDS if need.default}
"""Values of variables that nothing gives, where not 0."""

OVER_DRAFT: Final = {need.fields[0]: need.over_draft for need in NEEDS if need.over_draft}
"""Variables of the elements that hold the mean of a field over the draft, where it comes on levels."""

EXPECTED: Final = tuple(field for need in NEEDS if need.expected for field in need.fields)
"""Fields that files should give, and know wherever a berg starts: elsewhere there is no water, or no data."""


def find_missing_water(p: Parameters, available: Container[str]) -> dict[str, str]:
    """Return the fields that melt needs and has neither as a number nor among the available ones, by quantity."""
    return {
        need.quantity: need.fields[0] for need in (TEMPERATURE, SALINITY)
        if need.required(p) and need.fields[0] not in available
    }  # fmt: skip
