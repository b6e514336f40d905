"""One law of the sea floor for the default scheme; drag, and all keys that only it reads, stay with the explicit ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from riftberg import A68A_2022, A68A_2022_KID, Parameters
from riftberg.errors import InputError
from riftberg.experiments.changes import changed, parse_settings
from riftberg.experiments.yaml_file import read_file
from riftberg.runs.layout import read_parameters

SLAB = """\
start: 2020-12-09 13:00
days: 1
berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39.0, -55.5]}
forcing: {uniform: {current: [0.2, 0.0], depth: 150 m, slope: [0, 0]}}
parameters:
  grounding: %s
"""


def test_the_law_follows_from_the_scheme_unless_it_is_named() -> None:
    for parameters, law in (
        (Parameters(), "seabed"), (A68A_2022, "seabed"), (A68A_2022_KID, "linear"),
        (Parameters(stepping={"scheme": "verlet"}, bonds={"law": "spring"}), "linear"),
        (Parameters(grounding={"law": "none"}), "none"),
        (Parameters(grounding={"law": "none"}, stepping={"scheme": "mts"}), "none"),
        (Parameters().changed(stepping={"scheme": "mts"}), "linear"), (Parameters(stepping={"substeps": 40}), "linear"),
    ):  # fmt: skip
        assert parameters.grounding.law == law
        values = parameters.kernel_values()
        assert (values.ground_coefficient > 0.0) == (law == "linear")


@pytest.mark.parametrize(
    ("key", "value", "now"),
    [
        ("law", "linear", "leave it out .*seabed.* or write none .*or set stepping.scheme = 'mts'"),
        ("law", "quadratic", "leave it out"),
        ("coefficient", 0.0, "write grounding.law: none in place of coefficient: 0"),
        ("coefficient", 1e4, "grounding.sediment, friction and shear_strength"),
        ("quadratic_coefficient", 10.0, "grounding.sediment"),
        ("ramp_height", 10.0, "leave it out"),
        ("torque", True, "friction on a bed of sediment brakes rotation"),
        ("on_substeps", False, "leave it out"),
        ("implicit", True, "leave it out"),
    ],
)
def test_keys_of_drag_are_refused_with_what_to_write_now(tmp_path: Path, key: str, value: Any, now: str) -> None:
    """In Python, by --set and in files alike; the explicit scheme takes them."""
    with pytest.raises(InputError, match=now):
        Parameters(grounding={key: value})
    with pytest.raises(InputError, match=now):
        changed(A68A_2022, parse_settings([f"grounding.{key}={str(value).lower()}"]))
    path = tmp_path / "slab.yaml"
    path.write_text(SLAB % json.dumps({key: value}))
    with pytest.raises(InputError, match=now):
        read_file(path)
    if value != "quadratic":
        Parameters(grounding={key: value}, stepping={"scheme": "mts"})


@pytest.mark.parametrize(("group", "key", "now"), [
    ("stepping", "landing_steps", "takes the sub-steps that it needs"), ("grounding", "depth_error", "floor_error.offset"),
])  # fmt: skip
def test_keys_that_are_no_more_name_their_successor(group: str, key: str, now: str) -> None:
    with pytest.raises(InputError, match=f"any more.*{now}"):
        Parameters(**{group: {key: 2}})
    with pytest.raises(InputError, match=f"any more.*{now}"):
        parse_settings([f"{group}.{key}=2"])


def test_no_sea_floor_is_a_word_and_not_nothing() -> None:
    assert parse_settings(["grounding.law=none"]) == {"grounding": {"law": "none"}}
    with pytest.raises(InputError, match="'seabed', 'none'"):
        Parameters(grounding={"law": "sand"})
    assert Parameters(fracture={"flexural_strength": "none"}).fracture.flexural_strength is None


def dumped(**groups: dict[str, Any]) -> str:
    """Return parameters as a file of an earlier version has them: with all keys of all laws."""
    values = Parameters().model_dump(mode="json")
    values["stepping"]["landing_steps"], values["grounding"]["law"] = 8, "linear"
    for group, inner in groups.items():
        values[group] |= inner
    return json.dumps(values)


def test_files_of_riftberg_open_whatever_keys_they_have() -> None:
    """Of an earlier version, and of this one, which writes the keys of all laws too."""
    file = Path("run.nc")
    assert read_parameters(Parameters().model_dump_json(), file) == Parameters()
    assert read_parameters(Parameters().model_dump_json(), file, goes_on=True) == Parameters()
    for old in ({}, {"grounding": {"coefficient": 0.0}}, {"stepping": {"landing_steps": 4}}):
        assert read_parameters(dumped(**old), file) == Parameters()
    drag = Parameters(grounding={"coefficient": 2e4}, stepping={"scheme": "mts"})
    assert read_parameters(drag.model_dump_json(), file) == drag


@pytest.mark.parametrize(("groups", "now"), [
    ({}, "grounding.law: 'linear' is of the explicit schemes.*seabed"),
    ({"grounding": {"law": "seabed", "coefficient": 0.0}}, "write grounding.law: none"),
    ({"grounding": {"law": "seabed"}, "stepping": {"landing_steps": 4}}, "no such parameter any more.*takes the sub-steps"),
])  # fmt: skip
def test_a_run_does_not_go_on_under_another_law(groups: dict[str, Any], now: str) -> None:
    with pytest.raises(InputError, match=now):
        read_parameters(dumped(**groups), Path("a.restart.nc"), goes_on=True)
    usual = dumped(grounding={"law": "seabed"})
    assert read_parameters(usual, Path("a.restart.nc"), goes_on=True).grounding.law == "seabed"
