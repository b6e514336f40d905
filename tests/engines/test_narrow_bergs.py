"""Bergs that are too few elements across for elastic cells: told by name, and by how much."""

from __future__ import annotations

import logging

import pytest

from engines.test_cells import bent
from riftberg import Forcing, Iceberg, Model, Parameters

ENOUGH = 6
SAG = {1: "0.5", 2: "0.6 to 0.7", 3: "0.8 to 0.9"}

FLAT = {"latlon": False, "period": 0.0}


def berg(across: int, along: int = 16, packing: str = "square") -> Iceberg:
    return Iceberg.rectangle(
        1e3 * along, 1e3 * across, thickness=200.0, radius=500.0, packing=packing, latlon=False, rotation=25.0
    )


def told_of(ice: Iceberg, parameters: Parameters) -> str:
    """Return what a model tells of its elements across."""
    return " ".join(text for text in Model(ice, Forcing.uniform(), parameters).notices if " across" in text)


@pytest.mark.parametrize("across", [1, 2, 3])
def test_the_deflection_that_is_told_is_the_one_that_comes(across: int) -> None:
    told = [float(word) for word in SAG[across].split(" to ")]
    turned = [("square", 0.0)] if across == 1 else [("square", 15.0), ("hexagonal", 0.0), ("hexagonal", 30.0)]
    for packing, angle in turned:
        assert told[0] - 0.05 < bent(packing, angle, across)[0] < told[-1] + 0.05


@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 45.0), ("hexagonal", 0.0)])
def test_elements_that_are_called_small_enough_are(packing: str, angle: float) -> None:
    assert bent(packing, angle, ENOUGH)[0] == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_a_narrow_berg_is_told_once_with_elements_across(packing: str, caplog: pytest.LogCaptureFixture) -> None:
    parameters = Parameters(earth=FLAT, bonds={"packing": packing}, stepping={"time_step": 600.0})
    for across in (1, 2, 3):
        text = told_of(berg(across, packing=packing), parameters)
        assert f"is {across} element" in text
        assert SAG[across] in text
    assert "Elements of 333 m" in told_of(berg(2), Parameters(earth=FLAT))
    with caplog.at_level(logging.WARNING):
        Model(berg(2, packing=packing), Forcing.uniform(), parameters).advance(steps=1)
    assert sum("elements across" in record.message for record in caplog.records) == 1


def test_wide_compact_and_single_bergs_and_bonds_are_not_told() -> None:
    cells, bonds = Parameters(earth=FLAT), Parameters(earth=FLAT, stepping={"scheme": "mts"})
    assert told_of(berg(8), cells) == ""
    assert told_of(berg(3, 4), cells) == ""
    assert told_of(berg(2), bonds) == ""
    assert told_of(Iceberg.rectangle(1e3, 1e3, thickness=200.0, radius=500.0, latlon=False), cells) == ""
