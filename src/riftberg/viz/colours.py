"""The one place that holds the colours: the same thing has the same colour in every picture.

Fragments and forces take colours of Okabe and Ito (2008), which any colour vision can tell apart; scales go from
light to dark, so that they read in grey too. ``replay_template.html`` uses the same values.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

FRAGMENTS: Final = ("#E69F00", "#009E73", "#CC79A7", "#D55E00", "#F0E442", "#8C510A")
"""Largest fragment first; distinct from blue water."""

SMALL: Final = "#666666"
"""Fragments too small to be named."""

MODEL: Final = FRAGMENTS[0]
"""The berg of the model beside observations: the colour of the largest fragment."""

OBSERVED: Final = "#000000"
"""Observations, and theory."""

OBSERVED_DAYS: Final = ("#332288", "#117733", "#AA4499", "#88CCEE", "#999933", "#882255")
"""Outlines of several days in one panel (Tol's muted colours)."""

GROUND: Final = "#A50026"
"""Sea floor that the keel touches, ice aground, bonds that fail."""

STRESS_LINE: Final = "#CF2A27"
"""The largest stress, as a line."""

DAMAGE_LINE: Final = "#63308F"
"""The strength that damage leaves, as a line."""

STRENGTH: Final = "#555555"
"""The strength of the ice, and quiet lines."""

GRID: Final = "#DDDDDD"
ZERO: Final = "#BBBBBB"
"""The line at zero."""

PAIRING: Final = "#999999"
"""Lines that join pairs: model and observation of one time, a fragment and its birth."""

SEA: Final = "#F4F7FA"
"""Under everything, where neither currents nor a sea floor are known."""

NO_WATER: Final = "#D9D9D9"
"""Under the currents: shows where there are none."""

ARROW: Final = "#35506B"
ISOBATH: Final = "#8A8A8A"
ICE: Final = "#E3E8EC"
"""Ice under bonds that are in colour."""

ICE_EDGE: Final = "#B8C2CA"

LAND: Final = "#D3CBBB"
SHELF: Final = "#F1F4F6"
SHORE: Final = "#4A4438"

_FORCE_COLOURS: Final = {
    "ocean drag": "#0072B2",
    "Coriolis and surface slope": "#009E73",
    "wind drag": "#E69F00",
    "waves": "#56B4E9",
    "sea floor": GROUND,
    "sea ice": "#999999",
}
REST: Final = "#8C510A"
"""Force of the other part of a berg through a cut."""

_OTHER_FORCES: Final = ("#332288", "#999933", "#882255", "#44AA99")


def force_colours(names: Iterable[str]) -> dict[str, str]:
    """Return one colour for each force, whatever their order; a force that is not known here gets one that is free."""
    free = iter(_OTHER_FORCES * 4)
    return {name: _FORCE_COLOURS.get(name) or next(free) for name in names}


def speed_map(steps: int | None = None) -> Colormap:
    """Return the colours of current speed: white to a middle blue, light enough for arrows and ice on top.

    They are smooth, or so many steps.
    """
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap

    smooth = LinearSegmentedColormap.from_list("speed", colormaps["Blues"](np.linspace(0.0, 0.68, 64)))
    return smooth if steps is None else smooth.resampled(steps)


def depth_map() -> Colormap:
    """Return the colours of the depth of water: sand to a light grey blue, quiet enough to lie behind everything."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("depth", ["#F9F4E6", "#E9EEE8", "#D6E2E8", "#C3D4E1", "#AFC5D8"])


def stress_map() -> Colormap:
    """Return the colours of tensile stress: nearly white, yellow, red; the same as in the replay."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list(
        "stress", ["#fbfdff", "#fff0c9", "#fdc377", "#f47b4a", "#cf2a27", "#7a0018"]
    )


def melt_map() -> Colormap:
    """Return the colours of ice that is lost."""
    from matplotlib import colormaps

    return colormaps["YlGnBu"]


def damage_map() -> Colormap:
    """Return the colours of damage: nearly white to violet; the same as in the replay."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("damage", ["#fbfdff", "#dccbe9", "#a478c2", "#63308f", "#240a3f"])
