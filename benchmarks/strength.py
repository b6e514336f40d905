"""Tables of what ice bears: reserve of crevassed ice, rifts, fronts, feet and edges that relax, beside what was asked.

python benchmarks/strength.py             print the tables
python benchmarks/strength.py --write     also put them into docs/evidence/strength.md
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from story import print_tables, table

from riftberg.constants import SECONDS_PER_DAY
from riftberg.physics.calving import INSTANT_MODULUS, foot_length, piece_width, relaxed_modulus
from riftberg.physics.crevasses import prestress, reserve, tension_at_depth
from riftberg.physics.edge_bending import flexural_length, foot_moment, front_moment, surface_stress

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "strength.md"

ICE = ((150, 850), (170, 850), (200, 850), (250, 870), (300, 880), (350, 890), (400, 890))
"""Thickness (m) and density (kg m-3)."""

TIPS = (50, 79, 90, 100, 150, 202, 263)
"""Strengths at the tips of crevasses, kPa."""

RESERVES = {
    (150, 50): 5.9, (150, 79): 14.6, (150, 100): 23.4, (150, 150): 52.7, (150, 202): 95, (150, 263): 156,
    (170, 50): 5.2, (170, 79): 12.9, (170, 100): 20.7, (170, 150): 46.5, (170, 202): 84, (170, 263): 142,
    (200, 50): 4.4, (200, 79): 11.0, (200, 100): 17.6, (200, 150): 39.5, (200, 202): 72, (200, 263): 121,
    (250, 50): 3.9, (250, 79): 9.7, (250, 100): 15.5, (250, 150): 34.9, (250, 202): 63, (250, 263): 107,
    (300, 50): 3.4, (300, 79): 8.5, (300, 100): 13.6, (300, 150): 30.7, (300, 202): 56, (300, 263): 94,
    (350, 50): 3.1, (350, 79): 7.8, (350, 100): 12.4, (350, 150): 28.0, (350, 202): 51, (350, 263): 86,
    (400, 50): 2.7, (400, 79): 6.8, (400, 100): 10.9, (400, 150): 24.5, (400, 202): 44, (400, 263): 75,
}  # fmt: skip
"""Asked of the reserve, kPa, by thickness and strength."""

DEPTHS = (0.8, 0.9, 0.95, 0.97, 0.98)
RIFTS = {
    (202, 170): (35.6, 19.0, 9.8, 6.0, 4.0), (202, 200): (34.7, 18.8, 9.8, 5.9, 4.0),
    (263, 170): (47.8, 25.1, 12.8, 7.8, 5.2), (263, 200): (46.9, 24.9, 12.8, 7.8, 5.2),
}  # fmt: skip
"""Asked of ice with a rift of some depth, kPa, by strength and thickness."""

STRIPS = {1.0: 0.77, 1.5: 1.11, 2.0: 1.35, 2.5: 1.42, 3.0: 1.30, 4.0: 1.02, 5.0: 0.98}
"""Asked of the largest moment of a strip with feet on both sides over that of a half plane, by its width in lambda."""

FRONTS = {150: 70, 200: 94, 250: 112, 300: 131, 350: 148}
"""Asked of the bending stress of a front, kPa, by thickness."""

BREAKS = {9e9: (14.1, 993), 1e9: (23.9, 565), 1e8: (40, 305), 3.8e7: (48, 232), 1e7: (61, 156)}
"""Asked of the foot that bends ice of 200 m by 250 kPa, and of how far inland it does, m; by Young's modulus."""

GROWTHS = ((0.1, 1e14), (0.3, 1e14), (1.0, 1e14), (0.1, 3e13), (0.1, 4e14), (1.0, 3e13), (1.0, 4e14))
"""Growth of a foot (m a day), and viscosity (Pa s)."""


def sizes(value: float) -> str:
    """Return kilopascals as the tables have them."""
    return f"{value:.1f}" if value < 60.0 else f"{value:.0f}"


def beside(asked: float | None, reached: float) -> str:
    """Return asked and reached in one cell."""
    return sizes(reached) if asked is None else f"{asked:g}; {sizes(reached)}"


def reserves() -> str:
    """Return the reserve by thickness and strength at the tips."""
    rows = []
    for thickness, density in ICE:
        sigma = prestress(float(thickness), float(density))
        cells = [beside(RESERVES.get((thickness, tip)), 1e-3 * reserve(1e3 * tip, sigma)) for tip in TIPS]
        rows.append((f"{thickness} m, {density} kg m⁻³", f"{1e-3 * sigma:.0f}", *cells))
    return table(("asked; reached, kPa", "σ₀", *(f"s = {tip}" for tip in TIPS)), rows)


def rifts() -> str:
    """Return what ice bears that a rift of some depth has cut."""
    rows = []
    for (tip, thickness), asked in RIFTS.items():
        sigma = prestress(float(thickness), 850.0)
        found = [1e-3 * tension_at_depth(depth, 1e3 * tip, sigma) for depth in DEPTHS]
        rows.append((f"s = {tip} kPa, {thickness} m", *(beside(*pair) for pair in zip(asked, found, strict=True))))
    return table(("asked; reached, kPa", *(f"x = {depth:g}" for depth in DEPTHS)), rows)


def toughness() -> str:
    """Return the strength that a toughness implies."""
    far = [(f"{k} kPa m½", f"{k / math.sqrt(math.pi * 1.5e3):.2g} kPa") for k in (50, 100, 150, 400)]
    return table(("K_Ic", "stress far from a crack of 3 km"), far)


def fronts() -> str:
    """Return the bending of fronts."""
    density = dict(ICE)
    rows = [
        (f"{h} m, {density[h]} kg m⁻³", f"{asked}", f"{1e-3 * surface_stress(front_moment(h, density[h]), h):.0f}")
        for h, asked in FRONTS.items()
    ]
    return table(("front", "asked, kPa", "reached, kPa"), rows)


def strips() -> str:
    """Return the bending of strips by feet on both sides."""
    length = flexural_length(INSTANT_MODULUS, 200.0)
    wide, _ = foot_moment(1e-3, 200.0, 850.0, length)
    found = [foot_moment(1e-3, 200.0, 850.0, length, width * length)[0] / wide for width in STRIPS]
    rows = [
        ("asked", *(f"{asked:.2f}" for asked in STRIPS.values())),
        ("reached", *(f"{value:.2f}" for value in found)),
    ]
    return table(("width over λ", *(f"{width:g}" for width in STRIPS)), rows)


def feet() -> str:
    """Return the foot that breaks an edge by its modulus."""
    rows = []
    for youngs, (foot, inland) in BREAKS.items():
        least, most, length = 0.0, 200.0, flexural_length(youngs, 200.0)
        for _ in range(50):
            middle = 0.5 * (least + most)
            bent = surface_stress(foot_moment(middle, 200.0, 850.0, length)[0], 200.0)
            least, most = (middle, most) if bent < 250e3 else (least, middle)
        there = foot_moment(least, 200.0, 850.0, length)[1]
        law = f"{foot_length(200.0, youngs, 250e3, 850.0):.0f} m, {piece_width(200.0, youngs):.0f} m"
        name = f"{1e-9 * youngs:g} GPa" if youngs >= 1e9 else f"{1e-6 * youngs:g} MPa"
        rows.append((name, f"{foot:g} m, {inland} m", f"{least:.1f} m, {there:.0f} m", law))
    return table(("Young's modulus", "asked: foot, inland", "reached", "footloose law, without the couple"), rows)


def relaxed() -> str:
    """Return the modulus of edges that relax, with foot and width of the piece by the footloose law."""
    rows = []
    for growth, viscosity in GROWTHS:
        youngs = relaxed_modulus(200.0, growth / SECONDS_PER_DAY, 250e3, 850.0, viscosity)
        foot, wide = foot_length(200.0, youngs, 250e3, 850.0), piece_width(200.0, youngs)
        rows.append((f"{growth:g} m", f"{viscosity:.0e}", f"{1e-6 * youngs:.2g} MPa", f"{foot:.0f} m", f"{wide:.0f} m"))
    return table(("growth a day", "viscosity, Pa s", "modulus at the break", "foot", "width of the piece"), rows)


def ages() -> str:
    """Return modulus and lambda by the age of a load."""
    rows = []
    for name, days in (("seconds to an hour", 0.0), ("a tide, 6 h", 0.25), ("a day", 1.0), ("a month", 30.0)):
        youngs = INSTANT_MODULUS / (1.0 + days * SECONDS_PER_DAY * INSTANT_MODULUS / 1e14)
        rows.append((name, f"{1e-9 * youngs:.2g} GPa", f"{flexural_length(youngs, 200.0):.0f} m"))
    return table(("load held for", "E(t)", "λ of 200 m"), rows)


TABLES = {
    "toughness": toughness, "reserves": reserves, "rifts": rifts, "fronts": fronts, "strips": strips, "feet": feet,
    "relaxed": relaxed, "ages": ages,
}  # fmt: skip
"""What makes each table of the page."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables and perhaps write them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    asked = parser.parse_args(arguments)
    print_tables(PAGE, {name: make() for name, make in TABLES.items()}, write=asked.write)
    return 0


if __name__ == "__main__":
    sys.exit(main())
