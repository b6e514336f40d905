"""What is said of rifts: how near to their toughness their tips stand, and what a run without a toughness makes of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from riftberg.config.units import place_text
from riftberg.engines.common.crack_tips import RUN_OUT, CrackTips
from riftberg.parameters import Parameters
from riftberg.physics.crack_tip import hoop_intensity
from riftberg.state import Bonds, Elements, Ints
from riftberg.state.population import find_rows

MOST_TOLD: Final = 6
"""Tips that are told one by one, those that stand nearest to their toughness."""


@dataclass(frozen=True)
class RiftTip:
    """A standing tip of a rift that was there from the start."""

    crack: int  # Number of the rift
    lon: float  # degrees (m on a plane)
    lat: float
    length: float  # Of the rift, m
    spacing: float  # Distance of the elements beside the tip, m
    opening: float  # K_I, Pa m^(1/2); K_I, K_II and largest are NaN where nothing can be said
    shearing: float  # K_II
    largest: float  # Largest hoop intensity since the tip has stood here

    @property
    def hoop(self) -> float:
        """What the toughness is compared with, Pa m^(1/2)."""
        return hoop_intensity(self.opening, self.shearing)[1] if math.isfinite(self.opening) else math.nan

    def as_dict(self, parameters: Parameters) -> dict[str, Any]:
        """Return the tip as a summary holds it; None for values that are not known."""
        toughness = parameters.fracture.toughness if has_toughness(parameters) else math.nan
        shares = {"of_toughness": self.hoop / toughness, "largest_of_toughness": self.largest / toughness}
        return {name: value if math.isfinite(value) else None for name, value in (asdict(self) | shares).items()}


def has_toughness(parameters: Parameters) -> bool:
    """Whether the tips of cracks are held against a toughness."""
    return bool(parameters.fracture.enabled and parameters.fracture.criterion == "toughness")


def given_rifts(bonds: Bonds) -> Ints:
    """Numbers of the cracks that were there from the start: bonds that they cross have never broken in the run."""
    return np.unique(bonds.crack[(bonds.crack > 0) & (bonds.status != 0) & np.isnan(bonds.break_time)])


def standing_tips(tips: CrackTips, el: Elements, bonds: Bonds) -> list[RiftTip]:
    """Return the tips of rifts that stand in the ice; a tip that has reached the outline or another crack does not."""
    rows, exists = find_rows(el.body.id, tips.beside.ravel())
    first, second = rows.reshape(-1, 2).T
    both_there = exists.reshape(-1, 2).all(axis=1)
    is_rift = np.isin(tips.crack, given_rifts(bonds)) & (tips.intensity[:, 2] > RUN_OUT)
    standing = []
    for n in np.flatnonzero(both_there & is_rift):
        i, j = first[n], second[n]
        if el.berg[i] != el.berg[j]:
            continue
        has_ratio = tips.intensity[n, 2] >= 0.0
        values = tips.intensity[n] if has_ratio else np.full(3, np.nan)
        lon, lat = 0.5 * (el.lon[i] + el.lon[j]), 0.5 * (el.lat[i] + el.lat[j])
        size = 0.5 * float(np.sqrt(el.length[i] * el.width[i]) + np.sqrt(el.length[j] * el.width[j]))
        standing.append(
            RiftTip(int(tips.crack[n]), float(lon), float(lat), float(tips.length[n]), size, *values.tolist())
        )
    return standing


def tip_lines(tips: Sequence[RiftTip], parameters: Parameters) -> list[str]:
    """Return in sentences how near to their toughness the tips of rifts stand, those that are nearest first."""
    order = sorted(tips, key=lambda tip: -tip.hoop if math.isfinite(tip.hoop) else math.inf)
    lines = [_sentence(tip, parameters) for tip in order[:MOST_TOLD]]
    more = len(order) - MOST_TOLD
    return [*lines, f"{more} more tips of rifts stand farther from it."] if more > 0 else lines


def _sentence(tip: RiftTip, parameters: Parameters) -> str:
    place = place_text(tip.lon, tip.lat, latlon=parameters.earth.latlon, digits=2)
    which = f"The rift of {tip.length / 1e3:.3g} km with its tip at {place}"
    if not math.isfinite(tip.hoop):
        return (
            f"{which} is too short, or its tip too near to the outline or another crack, for elements of {tip.spacing:.0f} m "
            "to say how near to its toughness it stands; smaller elements can say it."
        )
    if not has_toughness(parameters):
        return (
            f"{which} has a stress intensity of {tip.hoop / 1e3:.3g} kPa m1/2, at most {tip.largest / 1e3:.3g}, and no "
            "toughness to hold it against (laboratories find 50 to 150)."
        )
    toughness = parameters.fracture.toughness
    modes = f"K_I {tip.opening / 1e3:.3g}, K_II {tip.shearing / 1e3:.3g} kPa m1/2"
    shut = " (its faces press on each other)" if tip.hoop == 0.0 else ""
    return (
        f"{which} stands at {tip.hoop / toughness:.2g} of its toughness{shut}, at most at {tip.largest / toughness:.2g} since "
        f"it came to stand there: {modes}."
    )


def tip_label(tip: RiftTip, parameters: Parameters) -> str:
    """Return the label of a tip on a map."""
    if not math.isfinite(tip.hoop):
        return "too short to say"
    if not has_toughness(parameters):
        return f"K {tip.hoop / 1e3:.2g} kPa m½"
    return f"{tip.hoop / parameters.fracture.toughness:.2g} of toughness"


def rift_notices(el: Elements, bonds: Bonds, parameters: Parameters) -> list[str]:
    """Return that rifts end in the ice but no toughness is given, or that rifts have no line with tips, if so.

    A rift from edge to edge has no tip.
    """
    if not parameters.fracture.enabled or parameters.stepping.scheme != "quasi_static":
        return []
    first, second = bonds.first, bonds.second
    within, size = el.berg[first] == el.berg[second], np.bincount(el.berg)[el.berg]
    broken = (bonds.status != 0) & np.isnan(bonds.break_time)
    rifts = np.unique(bonds.crack[broken & within & (bonds.crack > 0)]).size
    # A mask leaves elements loose within a rift.
    inside = within | (size[first] == 1) | (size[second] == 1)
    off_lines = int((broken & inside & (bonds.crack == 0)).sum())
    without = int((within & (bonds.status == 0) & (bonds.strength == 0.0)).sum())
    on_line = [f"{'a rift is' if rifts == 1 else f'{rifts} rifts are'} broken from the start"] if rifts else []
    off_line = []
    if off_lines:
        are = "bond is" if off_lines == 1 else "bonds are"
        off_line.append(f"{off_lines} {are} broken from the start without a line, as by a mask")
    if without:
        have = "bond has no strength and parts" if without == 1 else "bonds have no strength and part"
        off_line.append(f"{without} {have} at the first pull")
    if has_toughness(parameters):
        remedy = "such a rift has no tips, so the strength decides when it goes on, not the toughness; give it as a broken line"
        return [f"{' and '.join(off_line)}: {remedy}"] if off_line else []
    if not on_line and not off_line:
        return []
    return [
        f"{' and '.join([*on_line, *off_line])}, but the ice has a strength alone: the stress at a tip grows as elements get "
        "smaller, so when the rift goes on depends on them; set fracture.criterion = 'toughness' and fracture.toughness (5e4 to "
        "1.5e5 Pa m1/2 in laboratories)"
    ]
