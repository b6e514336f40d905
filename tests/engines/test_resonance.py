"""What a run with explicit long steps says of the stress in its bonds, and that it is true."""

from __future__ import annotations

import logging
import re
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg import A68A_2022_KID, A68A_2022_MTS, Forcing, Iceberg, Model, Parameters
from riftberg.cli.main import app
from riftberg.state import Floats

EXPLICIT = Parameters().changed(stepping={"scheme": "mts", "time_step": 1800.0})
CASES: dict[str, tuple[dict[str, Any], int, bool]] = {
    "explicit, 1800 s": ({}, 10, True),
    "no bonds": ({}, 0, False),
    "quasi-static": ({"stepping": {"scheme": "quasi_static"}}, 10, False),
    "short steps": ({"stepping": {"time_step": 300.0}}, 10, False),
    "stiff ice with short steps": ({"stepping": {"time_step": 300.0}, "bonds": {"youngs_modulus": 9e9}}, 10, True),
    "nothing breaks": ({"fracture": {"enabled": False}}, 10, True),
    "nothing pushes": ({"stepping": {"only_interactions": True}}, 10, False),
    "nothing moves": ({"stepping": {"frozen": True}}, 10, False),
    "all go at a given speed": ({"stepping": {"fixed_velocity": (0.1, 0.0)}}, 10, False),
    "spring bonds": ({"bonds": {"law": "spring"}, "fracture": {"enabled": False}}, 10, False),
}


def berg(length: str = "60 km", width: str = "12 km", **where: Any) -> Iceberg:
    """Return a rectangle of ice."""
    return Iceberg.rectangle(length, width, thickness="200 m", **{"placement": (-38.0, -56.0), **where})


def rings(ice: Iceberg, parameters: Parameters) -> str:
    """Return what a model tells of ringing."""
    notices = Model(ice, Forcing.uniform((0.1, 0.0), slope=(0.0, 0.0)), parameters).notices
    return " ".join(notice for notice in notices if "rings" in notice)


def swing(ice: Iceberg, parameters: Parameters = EXPLICIT) -> float:
    """Return the period that it names, days."""
    found = re.search(r"natural period of ([\d.]+) (s|min|h|days)", rings(ice, parameters))
    assert found is not None
    return float(found[1]) * {"s": 1.0, "min": 60.0, "h": 3600.0, "days": 86400.0}[found[2]]


@pytest.mark.parametrize("case", CASES)
def test_what_rings_is_told(case: str) -> None:
    changes, bonds, told = CASES[case]
    asked = EXPLICIT.changed(**changes)
    ice = berg()
    ice.bonds.status[bonds:] = 2
    text = rings(ice, asked)
    assert ("stepping.scheme=quasi_static" in text) is told
    assert ("may break" in text) is (told and asked.fracture.enabled)


def test_a_swing_is_that_of_a_free_beam() -> None:
    """Of 60 km by 12 km, 5 MPa: L^2 sqrt(12 rho / E) / w 2 pi / 22.4; twice as stiff swings faster by a root of two."""
    expected = 2.0 * np.pi / 22.373 * 60e3**2 * np.sqrt(12.0 * 850.0 / 5e6) / 12e3
    assert swing(berg()) == pytest.approx(expected, rel=0.01)
    stiff = EXPLICIT.changed(bonds={"youngs_modulus": 1e7})
    assert swing(berg(), stiff) == pytest.approx(expected / np.sqrt(2.0), rel=0.01)


@pytest.mark.parametrize("where", [{"rotation": 40.0}, {"placement": (179.99, -56.0)}, {"placement": (10.0, 70.0)}])
def test_a_swing_does_not_depend_on_place_and_heading(where: dict[str, Any]) -> None:
    assert swing(berg(**where)) == pytest.approx(swing(berg()), rel=0.03)


def test_runs_of_the_reference_are_taken_as_they_are() -> None:
    ice = berg()
    assert rings(ice, A68A_2022_MTS)
    assert not rings(ice, A68A_2022_KID)


def test_a_model_tells_it_in_words_and_in_the_log(caplog: pytest.LogCaptureFixture) -> None:
    model = Model(berg("9 km", "6 km"), Forcing.uniform((0.1, 0.0)), EXPLICIT)
    assert "notice: the stress in the bonds rings" in model.describe()
    with caplog.at_level(logging.WARNING, logger="riftberg"):
        model.advance(steps=1)
        model.advance(steps=1)
    assert [record.message.startswith("the stress in the bonds rings") for record in caplog.records] == [True]


def test_the_command_line_tells_it_before_the_run(tmp_path: Any) -> None:
    asked = ["run", "a68a", "--days", "0.03", "--no-map", "-o", str(tmp_path)]
    said = CliRunner().invoke(app, [*asked, "--set", "stepping.scheme=mts"])
    assert "Notice: the stress in the bonds rings" in said.output
    assert "rings" not in CliRunner().invoke(app, asked).output


MTS = Parameters(stepping={"scheme": "mts"})


def test_pieces_without_a_bond_that_holds_do_not_ring() -> None:
    pieces = berg()
    pieces.bonds.status[:] = 2
    pieces.elements.bond_count[:] = 0
    pieces.elements.berg[:] = np.arange(pieces.elements.size)
    model = Model(pieces, Forcing.uniform((0.1, 0.0)), EXPLICIT)
    assert model.notices == ()


def _largest(scheme: str, step: float, size: tuple[str, str] = ("60 km", "30 km"), modulus: float = 5e6) -> Floats:
    """Largest tensile stress (Pa) at each of ten hours of a berg at the rim of an eddy."""
    sea = Forcing.uniform((0.15, 0.0)) + Forcing.eddy((-37.6, -56.15), 25e3, 0.5)
    ice = berg(*size, velocity=(0.15, 0.0))
    changes = {"stepping": {"scheme": scheme, "time_step": step}, "bonds": {"youngs_modulus": modulus}}
    model = Model(ice, sea, Parameters().changed(**changes, fracture={"enabled": False}))
    model.advance(steps=round(6 * 3600 / step))
    hours = []
    for _ in range(10):
        model.advance(steps=round(3600 / step))
        hours.append(model.bonds.normal_stress.max())
    return np.array(hours)


@pytest.mark.slow
def test_a_compact_berg_rings_far_above_its_load_and_less_with_shorter_steps() -> None:
    held = _largest("quasi_static", 1800.0).max()
    assert _largest("quasi_static", 450.0).max() == pytest.approx(held, rel=0.01)
    assert _largest("mts", 1800.0).max() > 10.0 * held
    assert _largest("mts", 150.0).max() - held < 1e3
