"""What a run with explicit long steps says of the stress in its bonds, and that it is true."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg import A68A_2022, A68A_2022_KID, Forcing, Iceberg, Model, Parameters
from riftberg.cli.main import app
from riftberg.experiments import Options, build
from riftberg.state import Floats
from riftberg.stepping.explicit.stability import (
    LONG_STEPS,
    NONRESONANT,
    bending_period,
    resonance_warning,
    with_nonresonant_step,
)

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


@pytest.mark.parametrize("case", CASES)
def test_what_rings_is_told(case: str) -> None:
    changes, bonds, told = CASES[case]
    asked = EXPLICIT.changed(**changes)
    ice = berg()
    text = resonance_warning(ice.elements, ice.bonds.taken(slice(bonds)), asked)
    assert ("stepping.scheme=quasi_static" in text) is told
    assert ("may break" in text) is (told and asked.fracture.enabled)


def test_a_swing_is_that_of_a_free_beam() -> None:
    """Of 60 km by 12 km, 5 MPa: L^2 sqrt(12 rho / E) / w 2 pi / 22.4; twice as stiff swings faster by a root of two."""
    expected = 2.0 * np.pi / 22.373 * 60e3**2 * np.sqrt(12.0 * 850.0 / 5e6) / 12e3
    assert bending_period(berg().elements, EXPLICIT) == pytest.approx(expected, rel=0.01)
    stiff = EXPLICIT.changed(bonds={"youngs_modulus": 1e7})
    assert bending_period(berg().elements, stiff) == pytest.approx(expected / np.sqrt(2.0), rel=0.01)


@pytest.mark.parametrize("where", [{"rotation": 40.0}, {"placement": (179.99, -56.0)}, {"placement": (10.0, 70.0)}])
def test_a_swing_does_not_depend_on_place_and_heading(where: dict[str, Any]) -> None:
    assert bending_period(berg(**where).elements, EXPLICIT) == pytest.approx(
        bending_period(berg().elements, EXPLICIT), rel=0.03
    )


def test_runs_of_the_reference_are_taken_as_they_are() -> None:
    ice = berg()
    assert resonance_warning(ice.elements, ice.bonds, A68A_2022.changed(stepping={"scheme": "mts"}))
    assert not resonance_warning(ice.elements, ice.bonds, A68A_2022_KID)


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
SHAPES = [("60 km", "12 km", 5e6), ("60 km", "30 km", 5e6), ("30 km", "12 km", 5e6), ("60 km", "12 km", 50e6)]


@pytest.mark.parametrize(("length", "width", "modulus"), SHAPES)
def test_a_long_step_that_nobody_named_does_not_ring(length: str, width: str, modulus: float) -> None:
    """It was 1800 s for all: up to 17 kPa that were not there beside a strength of 18."""
    model = Model(berg(length, width), Forcing.uniform((0.1, 0.0)), MTS.changed(bonds={"youngs_modulus": modulus}))
    step, period = model.parameters.stepping.time_step, bending_period(model.elements, model.parameters)
    assert model.notices == ()
    assert step * NONRESONANT <= period or step == LONG_STEPS[-1]
    longer = [one for one in LONG_STEPS if one > step]
    assert not longer or min(longer) * NONRESONANT > period
    assert 3600.0 % step == 0.0


def test_the_shortest_long_step_is_taken_and_told_where_none_is_short_enough() -> None:
    model = Model(berg("9 km", "6 km"), Forcing.uniform((0.1, 0.0)), MTS)
    assert model.parameters.stepping.time_step == 60.0
    assert "rings" in model.notices[0]


@pytest.mark.parametrize(
    ("asked", "step"),
    [
        (MTS.changed(stepping={"time_step": 900.0}), 900.0),
        (MTS.changed(stepping={"time_step": 1800.0}), 1800.0),
        (Parameters(stepping={"substeps": 90}), 1800.0),
        (MTS.changed(fracture={"enabled": False}), 150.0),
        (MTS.changed(stepping={"substeps": None}), 150.0),
        (MTS.changed(stepping={"only_interactions": True}), 1800.0),
        (MTS.changed(bonds={"law": "spring"}, fracture={"enabled": False}), 1800.0),
        (Parameters(), 1800.0),
        (A68A_2022.changed(stepping={"scheme": "mts"}), 1800.0),
        (A68A_2022_KID, 1800.0),
    ],
)
def test_a_long_step_that_is_named_or_need_not_be_short_stays(asked: Parameters, step: float) -> None:
    ice = berg()
    assert with_nonresonant_step(ice.elements, ice.bonds, asked).stepping.time_step == step
    assert with_nonresonant_step(ice.elements, ice.bonds.taken(slice(0)), MTS).stepping.time_step == 1800.0


def test_pieces_without_a_bond_that_holds_keep_the_long_step() -> None:
    pieces = berg()
    pieces.bonds.status[:] = 2
    pieces.elements.bond_count[:] = 0
    pieces.elements.berg[:] = np.arange(pieces.elements.size)
    model = Model(pieces, Forcing.uniform((0.1, 0.0)), MTS)
    assert model.parameters.stepping.time_step == 1800.0
    assert model.notices == ()


@pytest.mark.parametrize(("asked", "step"), [("", 150.0), ("time_step: 30 min", 1800.0), ("substeps: 90", 1800.0)])
def test_an_experiment_in_a_file_gets_it_too(asked: str, step: float, tmp_path: Path) -> None:
    """Its number of sub-steps is left open in so many words, which is no number named."""
    path = tmp_path / "long.yaml"
    path.write_text(
        "title: a long berg\nstart: 2020-12-09\ndays: 1\n"
        "berg:\n  rectangle: {length: 60 km, width: 12 km}\n  thickness: 200 m\n  placement: [-38, -56]\n"
        "forcing:\n  kind: constant\n  current: [0.2, 0.0]\n"
        f"parameters:\n  stepping:\n    scheme: mts\n    {asked}\n"
    )
    assert build(str(path), Options())[0].parameters.stepping.time_step == step


def test_a_change_of_other_values_does_not_name_the_long_step() -> None:
    """Nor does a step that a berg has been given stay with the parameters that were asked for."""
    asked = MTS.changed(fracture={"normal_strength": 2e4}).changed(
        bonds={"packing": "square"}, stepping={"safety": 0.7}
    )
    for length, step in (("60 km", 150.0), ("120 km", 600.0)):
        assert Model(berg(length), Forcing.uniform((0.1, 0.0)), asked).parameters.stepping.time_step == step
    assert "time_step" not in asked.stepping.model_fields_set


def test_a_run_goes_on_with_the_long_step_that_it_was_given(tmp_path: Any) -> None:
    model = Model(berg("60 km", "30 km"), Forcing.uniform((0.1, 0.0)), MTS)
    model.advance(steps=2)
    model.save(tmp_path / "state.nc")
    back = Model.resume(tmp_path / "state.nc", model.forcing)
    assert back.parameters.stepping.time_step == model.parameters.stepping.time_step == 60.0


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


@pytest.mark.slow
@pytest.mark.parametrize(("length", "width", "modulus"), SHAPES)
def test_the_stress_with_the_long_step_that_is_chosen_is_that_of_equilibrium_to_half_a_kpa(
    length: str, width: str, modulus: float
) -> None:
    ice, asked = berg(length, width), MTS.changed(bonds={"youngs_modulus": modulus})
    step = with_nonresonant_step(ice.elements, ice.bonds, asked).stepping.time_step
    held, own = (
        _largest(scheme, dt, (length, width), modulus) for scheme, dt in (("quasi_static", 1800.0), ("mts", step))
    )
    assert abs(own.max() - held.max()) < 500.0
