"""Which scheme a run takes that names none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riftberg import A68A_2022, A68A_2022_KID, Options, Parameters, build
from riftberg.errors import InputError

EXPLICIT: dict[str, dict[str, Any]] = {
    "sub-steps": {"stepping": {"substeps": 100}},
    "spring bonds": {"bonds": {"law": "spring"}},
    "bonds without shear": {"bonds": {"no_shear": True}},
    "implicit sub-steps": {"stepping": {"explicit_substeps": False}, "bonds": {"law": "none"}},
}


@pytest.mark.parametrize("preset", [Parameters(), A68A_2022], ids=["default", "a68a-2022"])
def test_stress_is_in_equilibrium_unless_another_scheme_is_named(preset: Parameters) -> None:
    assert preset.stepping.scheme == "quasi_static"
    assert preset.changed(stepping={"time_step": 900.0}).stepping.scheme == "quasi_static"
    assert preset.changed(stepping={"scheme": "mts"}).stepping.scheme == "mts"


@pytest.mark.parametrize("groups", EXPLICIT.values(), ids=EXPLICIT)
def test_who_asks_for_what_only_the_explicit_scheme_has_gets_it(groups: dict[str, dict[str, Any]]) -> None:
    """Else sub-steps that were asked for would have no effect, and nobody would say so."""
    assert Parameters(**groups).stepping.scheme == "mts"
    assert Parameters().changed(**groups).stepping.scheme == "mts"
    assert A68A_2022.changed(**groups).stepping.scheme == "mts"
    if "stepping" not in groups:
        with pytest.raises(InputError, match=r"quasi_static|is of the explicit schemes"):
            Parameters(**groups, stepping={"scheme": "quasi_static"})


def test_groups_that_are_made_before_are_asked_too() -> None:
    springs = Parameters(stepping={"scheme": "mts"}, bonds={"law": "spring"}).bonds
    assert Parameters(bonds=springs).stepping.scheme == "mts"
    short = Parameters(stepping={"substeps": 100, "time_step": 900.0}).stepping
    assert (short.scheme, short.substeps, short.time_step) == ("mts", 100, 900.0)
    with pytest.raises(InputError, match=r"stepping\.substeps: it is of the explicit schemes"):
        Parameters(stepping={"scheme": "quasi_static", "substeps": 100})


def test_another_scheme_stays_what_it_is() -> None:
    for scheme in ("verlet", "runge_kutta"):
        asked = Parameters(stepping={"scheme": scheme}, bonds={"law": "spring"}, fracture={"enabled": False})
        assert asked.changed(stepping={"substeps": 3}).stepping.scheme == scheme
    assert A68A_2022_KID.stepping.scheme == "mts"
    assert A68A_2022_KID.changed(stepping={"time_step": 900.0}).stepping.scheme == "mts"


def test_so_it_is_on_the_command_line_and_in_files(tmp_path: Path) -> None:
    schemes = {
        name: build("a68a", Options(changes))[0].parameters.stepping.scheme
        for name, changes in {
            "plain": {},
            "mts": {"stepping": {"scheme": "mts"}},
            "fine": {"stepping": {"substeps": 180}},
        }.items()
    }
    assert schemes == {"plain": "quasi_static", "mts": "mts", "fine": "mts"}
    text = """
berg: {rectangle: {length: 9 km, width: 6 km}, thickness: 200 m, placement: [-37, -56]}
forcing: {uniform: {current: [0.1, 0.0], slope: [0, 0]}}
start: 2020-12-09
days: 1
"""
    for number, (more, scheme) in enumerate((("", "quasi_static"), ("parameters: {stepping: {substeps: 100}}", "mts"))):
        file = tmp_path / f"{number}.yaml"
        file.write_text(text + more)
        assert build(str(file))[0].parameters.stepping.scheme == scheme
