"""What one engine had of the other is gone: refused with what to write now, left out of Riftberg's own files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from keys import extra
from riftberg import A68A_2022, A68A_2022_KID, Forcing, Iceberg, Model, Options, Parameters, build
from riftberg.ensembles.vary import read_varied
from riftberg.errors import InputError
from riftberg.experiments.changes import changed, parse_settings
from riftberg.experiments.yaml_file import read_file
from riftberg.parameters import ExplicitParameters, QuasiStaticParameters, fields_by_path
from riftberg.runs.layout import read_parameters

ELASTIC = "the ice is elastic, alike in all directions; with stepping.scheme = 'mts' its bonds are"
BY_BOND = "each bond breaks by its own stress with stepping.scheme = 'mts', the ice by its own with 'quasi_static'"
GONE = [
    (
        "mts",
        "contact",
        "law",
        "crushing",
        "faces crush with stepping.scheme = 'quasi_static', springs act with the other",
    ),
    (
        "mts",
        "contact",
        "law",
        "spring",
        "faces crush with stepping.scheme = 'quasi_static', springs act with the other",
    ),
    ("mts", "bonds", "elasticity", "isotropic", ELASTIC),
    ("mts", "bonds", "elasticity", "bonds", ELASTIC),
    ("quasi_static", "bonds", "elasticity", "bonds", ELASTIC),
    ("quasi_static", "bonds", "elasticity", "cells", ELASTIC),
    ("mts", "fracture", "criterion", "bond", "each bond breaks by its own stress"),
    ("quasi_static", "fracture", "criterion", "bond", BY_BOND),
    ("quasi_static", "drag", "sides_by_bonds", False, "water drags on the outline of a berg"),
    ("mts", "damage", "enabled", True, "leave it out, or set stepping.scheme = 'quasi_static'"),
]
ACTS = {  # What the engine of the file does by itself: its runs go on
    ("mts", "contact", "spring"), ("mts", "elasticity", "bonds"), ("quasi_static", "elasticity", "cells"),
    ("mts", "criterion", "bond"),
}  # fmt: skip
each = pytest.mark.parametrize(("scheme", "group", "key", "value", "now"), GONE)


@each
def test_what_is_gone_is_refused_with_what_to_write_now(
    tmp_path: Path, scheme: str, group: str, key: str, value: Any, now: str
) -> None:
    """In Python, by --set, in sweeps and in files alike."""
    word, engine = str(value).lower(), {"stepping": {"scheme": scheme}}
    with pytest.raises(InputError, match=now):
        Parameters(**engine, **{group: {key: value}})
    with pytest.raises(InputError, match=now):
        changed(Parameters(**engine), parse_settings([f"{group}.{key}={word}"]))
    path = tmp_path / "slab.yaml"
    path.write_text(
        "start: 2020-12-09 13:00\ndays: 1\n"
        "berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39.0, -55.5]}\n"
        "forcing: {uniform: {current: [0.2, 0.0], depth: 1 km, slope: [0, 0]}}\n"
        f"parameters:\n  stepping: {{scheme: {scheme}}}\n  {group}: {{{key}: {word}}}\n"
    )
    with pytest.raises(InputError, match=now):
        read_file(path)
    if not isinstance(value, bool):  # a sweep may vary the scheme too
        with pytest.raises(InputError, match=now):
            read_varied([f"{group}.{key}={word},{word}"])


def written(p: Parameters, **groups: dict[str, Any]) -> str:
    """Return parameters as a file of the version before has them."""
    values = p.model_dump(mode="json")
    values["contact"]["law"] = values["bonds"]["elasticity"] = None
    for group, inner in groups.items():
        values[group] = {**values.get(group, {}), **inner}
    return json.dumps(values)


@each
def test_files_that_had_it_open_and_no_run_goes_on_with_it(
    scheme: str, group: str, key: str, value: Any, now: str
) -> None:
    bonds = {"bonds": {"no_shear": True}} if scheme == "mts" else {}
    p, file = Parameters(stepping={"scheme": scheme}, **bonds), Path("a.restart.nc")
    old = written(p, **{group: {key: value}})
    assert read_parameters(old, file) == p
    if (scheme, key, value) in ACTS or (scheme, group, value) in ACTS:
        assert read_parameters(old, file, goes_on=True) == p
    else:
        with pytest.raises(InputError, match=now):
            read_parameters(old, file, goes_on=True)


def test_ice_that_does_not_move_is_ice_of_a_velocity_of_zero() -> None:
    """`frozen` of the default engine said the same as `fixed_velocity`."""
    with pytest.raises(InputError, match=r"write fixed_velocity: \[0, 0\]"):
        Parameters(stepping={"frozen": True})
    p, file = Parameters(), Path("a.restart.nc")
    assert read_parameters(written(p, stepping={"frozen": False}), file, goes_on=True) == p
    moving = written(p, stepping={"frozen": True})
    assert read_parameters(moving, file) == p
    with pytest.raises(InputError, match="write fixed_velocity"):
        read_parameters(moving, file, goes_on=True)
    berg = Iceberg.rectangle("3 km", "2 km", thickness="200 m", placement=(-37.0, -56.0))
    model = Model(berg, Forcing.uniform(current=(0.2, 0.0)), p.changed(stepping={"fixed_velocity": (0.0, 0.0)}))
    start = model.elements.lon.copy()
    model.run(days=0.125)
    assert np.array_equal(model.elements.lon, start)


MTS = {"stepping": {"scheme": "mts"}}


@pytest.mark.parametrize("law", ["dem", "spring"])
def test_a_run_whose_bonds_were_isotropic_by_default_does_not_go_on(law: str) -> None:
    """Its file names no elasticity, and would go on with other bonds without a word."""
    old = written(Parameters(**MTS, bonds={"law": law}, fracture={"enabled": law == "dem"}))
    file = Path("a.restart.nc")
    with pytest.raises(InputError, match=rf"bonds\.elasticity: .*{ELASTIC}"):
        read_parameters(old, file, goes_on=True)
    assert read_parameters(old, file).bonds.law == law
    for kept in (A68A_2022_KID, Parameters(), Parameters(**MTS, bonds={"law": "spring", "spring": 1e-4})):
        assert read_parameters(written(kept), file, goes_on=True) == kept


SLAB = (
    "start: 2020-12-09 13:00\ndays: 1\n"
    "berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39.0, -55.5]}\n"
    "forcing: {kind: formula, uniform: {current: [0.2, 0.0]}}\n"
)


@pytest.mark.parametrize(
    ("parameters", "scheme", "left_out"),
    [
        (
            "{stepping: {scheme: mts}, grounding: {ramp_height: 100}, contact: {spring: 1e-7, distance: 1750, "
            "tangential_critical_damping: true, tolerance: 1e-8}, bonds: {spring: 1e-5, linear_bending: false}, "
            "fracture: {enabled: false}, compatibility: {damping_by_speed: true}}",
            "quasi_static",
            (
                "grounding.ramp_height",
                "contact.spring",
                "contact.distance",
                "contact.tangential_critical_damping",
                "contact.tolerance",
                "bonds.spring",
                "bonds.linear_bending",
                "compatibility.damping_by_speed",
            ),
        ),
        (
            "{stepping: {scheme: mts}, bonds: {law: spring}, fracture: {enabled: false}}",
            "quasi_static",
            ("bonds.law",),
        ),
        (
            "{damage: {enabled: true}, fracture: {criterion: ice}}",
            "mts",
            ("fracture.criterion", "damage.enabled"),
        ),
        ("{grounding: {law: seabed, friction: 0.4}, ice: {density: 900}}", "mts", ("grounding.friction",)),
    ],
)
def test_an_experiment_runs_with_the_other_engine_and_says_what_it_leaves_out(
    tmp_path: Path, parameters: str, scheme: str, left_out: tuple[str, ...]
) -> None:
    """Bug: an experiment with `--set stepping.scheme=quasi_static` was refused for what it says itself."""
    path = tmp_path / "slab.yaml"
    path.write_text(f"{SLAB}parameters: {parameters}\n")
    name = str(path)
    model, info = build(name, Options(changes=parse_settings([f"stepping.scheme={scheme}"])))
    usual, told = build(name)
    assert model.parameters.stepping.scheme == scheme != usual.parameters.stepping.scheme
    assert model.parameters.ice == usual.parameters.ice
    assert model.parameters.bonds.youngs_modulus == usual.parameters.bonds.youngs_modulus
    notices = [notice for notice in info.notices if notice.startswith("stepping.scheme")]
    assert notices == ([f"stepping.scheme = {scheme!r} has no {', '.join(left_out)}: left out"] if left_out else [])
    assert not [notice for notice in told.notices if notice.startswith("stepping.scheme")]


def test_what_is_asked_for_with_the_scheme_is_refused_and_not_left_out() -> None:
    for start, settings, now in (
        (A68A_2022, ["stepping.scheme=mts", "damage.enabled=true"], "it is of quasi_static"),
        (A68A_2022_KID, ["stepping.scheme=quasi_static", "grounding.coefficient=0"], "grounding.law: none"),
    ):
        with pytest.raises(InputError, match=now):
            changed(start, parse_settings(settings))


def test_the_numerics_of_the_reference_stay_behind_with_its_engine() -> None:
    notices: list[str] = []
    made = changed(A68A_2022_KID, parse_settings(["stepping.scheme=quasi_static"]), notices=notices)
    assert "grounding.implicit" in notices[0]
    assert "compatibility.zero_start" in notices[0]
    assert made.calving.heat_of_one_class
    assert not made.quirks.zero_start
    again = changed(made, parse_settings(["stepping.scheme=mts"]))
    assert again.grounding.law == "linear"
    assert again.drag == A68A_2022_KID.drag


def test_each_engine_has_parameters_of_its_own_and_a_user_meets_few() -> None:
    """152 could be set with `quasi_static`, of which half did nothing. 80 are left."""
    sets = {engine: fields_by_path(engine) for engine in (QuasiStaticParameters, ExplicitParameters)}
    settable = [path for path, field in sets[QuasiStaticParameters].items() if not extra(field, "hidden")]
    assert len(settable) <= 80
    for engine, other, scheme in (
        (QuasiStaticParameters, ExplicitParameters, "quasi_static"),
        (ExplicitParameters, QuasiStaticParameters, "mts"),
    ):
        for path in sets[other].keys() - sets[engine].keys():
            group, name = path.split(".")
            named = {"stepping": {"scheme": scheme}}
            with pytest.raises(InputError, match=rf"{group}.*: it is of (the explicit schemes|quasi_static)"):
                Parameters(**{**named, group: {**named.get(group, {}), name: 1}})


@pytest.mark.parametrize("path", ["melt.gamma_t", "calving.heat_of_one_class"])
def test_what_kid_alone_sets_is_refused_in_files_sweeps_and_by_set(tmp_path: Path, path: str) -> None:
    group, name = path.split(".")
    file = tmp_path / "slab.yaml"
    file.write_text(f"{SLAB}parameters: {{{group}: {{{name}: 1}}}}\n")
    for ask in (lambda: read_file(file), lambda: parse_settings([f"{path}=1"]), lambda: read_varied([f"{path}=1,2"])):
        with pytest.raises(InputError, match="riftberg kid"):
            ask()


def test_files_of_the_version_before_hold_the_parameters_of_both_engines() -> None:
    """Those of the other engine never acted; quirks of melt and calving stood in one group with those of motion."""
    old = written(
        A68A_2022, contact={"spring": 1e-7, "distance": 4000.0}, bonds={"linear_bending": False}, stepping={"substeps": 90},
        compatibility={"zero_start": False, "half_west_rim": False, "sea_ice_shift": 0.0}, grounding={"coefficient": 1e4},
    )  # fmt: skip
    kid = written(A68A_2022_KID, damage={"enabled": False}, sea_ice={"capture": "none"}, melt={})
    for text, made in ((old, A68A_2022), (kid, A68A_2022_KID)):
        for goes_on in (False, True):
            assert read_parameters(text, Path("a.restart.nc"), goes_on=goes_on) == made
    values = json.loads(kid)
    values["compatibility"] |= {"half_west_rim": values["footloose"].pop("half_west_rim")}
    assert read_parameters(json.dumps(values), Path("run.nc")).footloose.half_west_rim


def test_what_another_engine_lacks_is_refused_by_name_unless_it_is_left_out_by_name() -> None:
    worn = Parameters(damage={"enabled": True}, grounding={"friction": 0.4})
    with pytest.raises(InputError, match=r"'mts' has no grounding.friction, damage.enabled"):
        worn.changed(stepping={"scheme": "mts"})
    made, left_out = worn.adapted(stepping={"scheme": "mts"})
    assert isinstance(made, ExplicitParameters)
    assert left_out == ["grounding.friction", "damage.enabled"]
    assert isinstance(made.changed(stepping={"scheme": "quasi_static"}), QuasiStaticParameters)
