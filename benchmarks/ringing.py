"""How far the stress in rectangular bergs rings with explicit long steps, beside the quasi-static scheme.

python benchmarks/ringing.py             print the table
python benchmarks/ringing.py --write     also put it into docs/evidence/stress-and-step.md

A day at the rim of an eddy, default parameters, nothing breaks; the first six hours are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from story import put, table

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.state import Floats

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "stress-and-step.md"
BERGS = (("60 km", "12 km", 5e6), ("60 km", "30 km", 5e6), ("30 km", "12 km", 5e6), ("30 km", "30 km", 5e6),
         ("60 km", "12 km", 5e7))  # fmt: skip
"""Length, width, and Young's modulus (Pa)."""

STEPS = (1800.0, 900.0, 300.0, 150.0, 60.0)
"""Explicit long steps, s."""

HOURS = range(7, 25)


def ice_of(berg: tuple[str, str, float]) -> Iceberg:
    """A rectangle of ice."""
    return Iceberg.rectangle(*berg[:2], thickness="200 m", placement=(-38.0, -56.0), velocity=(0.15, 0.0))


def model_of(berg: tuple[str, str, float], scheme: str, step: float) -> Model:
    """The berg at the rim of an eddy."""
    changes = {"stepping": {"scheme": scheme, "time_step": step}, "fracture": {"enabled": False}}
    parameters = Parameters().changed(**changes, bonds={"youngs_modulus": berg[2]})
    sea = Forcing.uniform((0.15, 0.0)) + Forcing.eddy((-37.6, -56.15), 25e3, 0.5)
    return Model(ice_of(berg), sea, parameters)


def stresses(berg: tuple[str, str, float], scheme: str, step: float) -> Floats:
    """Tensile stress (Pa) by hour and bond."""
    model, rows = model_of(berg, scheme, step), []
    for hour in HOURS:
        model.advance(steps=round((hour * 3600.0 - model.time) / step))
        rows.append(model.bonds.normal_stress.copy())
    return np.array(rows)


def rows() -> Iterator[list[str]]:
    """Rows of the table."""
    for berg in BERGS:
        held = stresses(berg, "quasi_static", 1800.0).max()
        short = stresses(berg, "quasi_static", 450.0).max()
        rung = [stresses(berg, "mts", step).max() for step in STEPS]
        name = f"{berg[0]} by {berg[1]}, {1e-6 * berg[2]:g} MPa"
        yield [name, *(f"{1e-3 * value:.2f}" for value in (short, held, *rung))]


def main() -> None:
    """Print the table, and write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    asked = parser.parse_args()
    head = ["berg", "`quasi_static`, 450 s", "1800 s", *(f"`mts`, {step:.0f} s" for step in STEPS)]
    text = table(head, list(rows()))
    print(text)
    if asked.write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "ringing", text), "utf-8")


if __name__ == "__main__":
    main()
