"""Magnitudes without sense: possible, but hardly meant. They are told with the usual range, once, and refused by nobody."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from typer.testing import CliRunner

from keys import extra
from riftberg import A68A_2022, Forcing, Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.cli.main import app
from riftberg.config.usual_ranges import LAWS, USUAL, without_effect
from riftberg.parameters import QuasiStaticParameters, fields_by_path

MTS = {"scheme": "mts"}

NUMBERS_OF_METHOD = {
    "contact.radial_damping", "contact.tangential_damping", "contact.max_iterations", "bonds.max_bonds", "stepping.substeps",
    "stepping.safety", "earth.period", "earth.reference_latitude",
    "footloose.seed", "stepping.speed_limit", "grounding.anchor_way",
}  # fmt: skip
"""Numbers that have no usual magnitude: of the method, or of where a run is."""

SHARES = {
    "sea_ice.least_concentration",
    "sea_ice.locked_concentration",
    "damage.threshold",
    "grounding.adhesion",
    "melt.sea_ice_shift",
    "melt.bits_fraction",
}
"""Numbers whose limits leave only what is usual."""

EXPERIMENT = """\
start: 2020-12-09 13:00
days: 0.25
berg:
  rectangle: {length: 12 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing:
  kind: formula
  uniform: {current: [0.2, 0.0]}
"""

HALF_HOUR = "parameters: {stepping: {time_step: 30 min}}\n"


def berg(**options: Any) -> Iceberg:
    """Return a berg of 4 x 2 elements."""
    given = {"length": 12e3, "width": 6e3, "thickness": 200.0, "placement": (-39.0, -55.0), **options}
    return Iceberg.rectangle(**given)


def numeric_parameters() -> set[str]:
    """All parameters that are numbers, by group and name."""
    return {
        path for path, field in fields_by_path().items()
        if re.search(r"\b(float|int)\b", str(field.annotation)) and "tuple[float, ...]" not in str(field.annotation)
    }  # fmt: skip


def test_every_number_has_a_usual_range_or_none_with_a_reason() -> None:
    known = {path: usual for path, field in fields_by_path().items() if (usual := extra(field, "usual"))}
    assert known.keys() | NUMBERS_OF_METHOD | SHARES == numeric_parameters()
    assert all(usual.low < usual.high and usual.source for usual in {**USUAL, **known}.values())


@pytest.mark.parametrize("name", [name for name in USUAL if name[0].isupper()])
def test_every_range_of_a_formula_is_of_a_value_that_it_holds(name: str) -> None:
    """A name that no formula has would be looked for in vain, and nothing would ever be told."""
    everything = [
        Forcing.uniform(depth=500.0, slope=(1e-6, 0.0), temperature=1.0, salinity=34.0), Forcing.eddy((-39, -55), 3e4, 0.3),
        Forcing.jet((-39, -55), 90, 0.3, 3e4), Forcing.front((-39, -55), 90, 0.2, 3e4, temperature=(1.0, 5.0)),
        Forcing.tide(0.1), Forcing.seamount((-39, -55), 300, 5e3, 1000), Forcing.slope((-39, -55), 90, 0.01, 500),
        Forcing.turning_wind(5.0),
    ]  # fmt: skip
    kind, _, key = name.partition(".")
    holders = [part for part in everything if kind in [c.__name__ for c in type(part).__mro__]]
    assert holders
    assert all(getattr(part, key) is not None for part in holders)


@pytest.mark.parametrize("parameters", [Parameters(), A68A_2022])
def test_defaults_and_presets_are_usual(parameters: Parameters) -> None:
    assert Model(berg(), Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)), parameters).notices == ()


TIDE = Forcing.uniform(current=(0.1, 0.0)) + Forcing.tide(0.2)
SLIPS: list[tuple[dict[str, Any], Any, dict[str, Any], str]] = [
    # what the issue names
    ({"thickness": 0.3}, None, {}, "berg.thickness = 0.3 m is unusual: from 20 to 600 m"),
    ({"thickness": 3000.0}, None, {}, "berg.thickness = 3000 m"),
    ({}, None, {"fracture": {"normal_strength": 18.0}}, "fracture.normal_strength = 18 Pa is unusual: from 1000 to 2e+06 Pa"),
    ({}, TIDE, {"stepping": {"time_step": 43200.0}}, "the long step of 12 h is too long for a tide with a period of 12.42 h"),
    # its sisters
    ({}, None, {"bonds": {"youngs_modulus": 5.0}}, "bonds.youngs_modulus = 5 Pa"),
    ({}, None, {"ice": {"density": 0.85}}, "ice.density = 0.85 kg m-3"),
    ({}, None, {"drag": {"ocean_scale": 1e3}}, "drag.ocean_scale = 1000 is unusual"),
    ({}, None, {"melt": {"enabled": True, "temperature": 35.0, "salinity": 34.0}}, "melt.temperature = 35 degree_Celsius"),
    ({}, None, {"stepping": {"time_step": 0.01}}, "stepping.time_step = 0.01 s"),
    ({"placement": (-39.0, 5.0)}, None, {}, "berg.latitude = 5"),
    ({"velocity": (9.0, 0.0)}, None, {}, "berg.speed = 9 m s-1"),
    ({"length": 12.0, "width": 6.0, "radius": 1.5}, None, {}, "berg.radius = 1.5 m"),
    ({}, Forcing.uniform(wind=(0.0, 120.0)), {}, "forcing, Uniform: wind = 120 m s-1"),
    ({}, Forcing.uniform(current=(8.0, 0.0), slope=(0.0, 0.0)), {}, "forcing, Uniform: current = 8 m s-1"),
    ({}, Forcing.eddy((-39.0, -55.0), 30.0, 0.5), {}, "forcing, Eddy: radius = 30 m"),
    ({}, Forcing.tide(0.2, period=7200.0), {}, "forcing, Tide: period = 7200 s"),
    ({}, Forcing.uniform(temperature=25.0, salinity=34.0), {}, "forcing, Uniform: temperature = 25"),
]  # fmt: skip


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("made", "forcing", "changes", "words"), SLIPS, ids=lambda value: value if isinstance(value, str) else ""
)
def test_slips_of_magnitude_are_told_with_the_usual_range(
    made: dict[str, Any], forcing: Any, changes: dict[str, Any], words: str
) -> None:
    model = Model(
        berg(**made), forcing or Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)), Parameters().changed(**changes)
    )
    assert [text for text in model.notices if words in text], model.notices


KEEL = 850.0 / 1025.0 * 250.0


@pytest.mark.parametrize(
    ("floor", "grounding", "words"),
    [
        (Forcing.uniform(depth=KEEL - 35.0), {}, "starts up to 35 m below the sea floor, more than 20 m under 100 % of it"),
        (Forcing.slope((-39.0, -55.0), 90.0, 5e-3, KEEL - 15.0, (1.0, 500.0)), {}, "below the sea floor"),
        (Forcing.seamount((-36.0, -55.0), 400.0, 300.0, depth=600.0), {}, "a seamount with a width of 300 m is narrower"),
        (Forcing.seamount((-36.0, -55.0), 400.0, 500.0, depth=600.0), {"bending": False}, "a width of 500 m is narrower"),
    ],
)  # fmt: skip
def test_a_floor_that_is_no_place_for_a_keel_is_told(floor: Any, grounding: dict[str, Any], words: str) -> None:
    made = berg(length=12e3, width=6e3, radius=750.0, thickness=250.0, density=850.0)
    p = Parameters(ice={"density": 850.0}, grounding=grounding)
    assert [text for text in Model(made, floor, p).notices if words in text]
    assert not [text for text in Model(made, floor, p.changed(grounding={"law": "none"})).notices if words in text]


@pytest.mark.parametrize(
    ("floor", "grounding"),
    [
        (Forcing.uniform(depth=KEEL - 15.0), {}),
        (Forcing.seamount((-39.0, -55.0), 120.0, 1500.0, depth=KEEL + 90.0), {}),
        (Forcing.seamount((-36.0, -55.0), 400.0, 900.0, depth=600.0), {}),
        (Forcing.seamount((-36.0, -55.0), 400.0, 450.0, depth=600.0), {"ice_modulus": 1e9}),
        (Forcing.uniform((0.2, 0.0)), {}),
    ],
)  # fmt: skip
def test_a_keel_a_little_below_the_floor_or_on_a_knoll_is_as_usual(floor: Any, grounding: dict[str, Any]) -> None:
    made = berg(length=12e3, width=6e3, radius=750.0, thickness=250.0, density=850.0)
    notices = Model(made, floor, Parameters(ice={"density": 850.0}, grounding=grounding)).notices
    assert not [text for text in notices if "floor" in text]


@pytest.mark.parametrize(("depth", "velocity", "told"), [(5.0, 0.3, True), (5.0, 0.0, False), (-5.0, 0.3, False)])
def test_a_berg_that_is_given_a_velocity_and_stands_aground_is_told(depth: float, velocity: float, told: bool) -> None:
    made = berg(length=12e3, width=6e3, thickness=250.0, density=850.0, velocity=(velocity, 0.0))
    notices = Model(made, Forcing.uniform(depth=KEEL - depth), Parameters(ice={"density": 850.0})).notices
    words = "berg 1 is given a velocity of 0.3 m/s and stands up to 5 m deep in the sea floor, which holds it"
    assert bool([text for text in notices if words in text]) == told, notices


def test_a_law_that_is_left_out_by_zero_is_as_usual() -> None:
    for group, name in (("drag", "ocean_scale"), ("sea_ice", "strength")):
        assert Model(berg(), Forcing.uniform(), Parameters().changed(**{group: {name: 0.0}})).notices == ()
    assert Model(berg(), Forcing.uniform(), Parameters(grounding={"law": "none"})).notices == ()


def test_a_step_that_passes_over_records_is_told() -> None:
    lon, lat = np.meshgrid(-40.0 + 0.125 * np.arange(1, 17), -56.0 + 0.125 * np.arange(1, 17))
    grid = Grid.from_corners(lon, lat, radius_for_metrics=A68A_2022.earth.radius)
    ocean = GriddedForcing(grid, [grid.fields(uo=0.2, depth=500.0) for _ in range(5)], 600.0 * np.arange(5))
    told = Model(berg(), ocean, Parameters(stepping={"time_step": 1200.0})).notices
    assert "with records every 0.1667 h, which it passes over: set stepping.time_step to 600 s or less" in told[0]
    assert Model(berg(), ocean, Parameters(stepping={"time_step": 600.0})).notices == ()


def test_python_logs_notices_once(caplog: pytest.LogCaptureFixture) -> None:
    model = Model(
        berg(thickness=0.3),
        Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)),
        Parameters(stepping={"time_step": 1800.0}),
    )
    with caplog.at_level(logging.WARNING, "riftberg"):
        model.run(steps=3, every_hours=0.75)
    assert [record.message.split(" is ")[0] for record in caplog.records if "unusual" in record.message] == [
        "berg.thickness = 0.3 m"
    ]
    assert sum("records every 0.75 h are no whole number of long steps" in r.message for r in caplog.records) == 1


def test_run_and_doctor_tell_the_same_once(tmp_path: Path) -> None:
    path = tmp_path / "slip.yaml"
    text = EXPERIMENT.replace("  placement", "  thickness: 0.3\n  placement")
    path.write_text(text.replace("days: 0.25", "days: 0.0625\noutput_every_hours: 0.75") + HALF_HOUR)
    run = CliRunner().invoke(app, ["run", str(path), "-q", "--no-map", "-o", str(tmp_path / "out")])
    asked = CliRunner().invoke(app, ["doctor", "--for", str(path)])
    assert (run.exit_code, asked.exit_code) == (0, 0), run.output + asked.output
    for words in (
        "berg.thickness = 0.3 m is unusual",
        "records every 0.75 h are no whole number of long steps (0.5 h)",
    ):
        assert run.stderr.count(words) == asked.output.count(words) == 1


@pytest.mark.parametrize(
    ("days", "step", "end"),
    [
        (0.1, 1800.0, "after 5 of them, at 0.104167 days"),
        (1.0, 50e3, "after 2 of them, at 1.15741 days"),
        (0.1, 864.0, ""),
    ],
)
def test_an_end_between_two_steps_is_said(days: float, step: float, end: str, caplog: pytest.LogCaptureFixture) -> None:
    sea = Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0))
    with caplog.at_level(logging.WARNING, "riftberg"):
        Model(berg(), sea, Parameters(stepping={"time_step": step})).advance(days)
    said = [text for text in caplog.messages if "no whole number of time steps" in text]
    assert [end in text for text in said] == [True] * bool(end)


def test_run_doctor_and_python_say_once_where_a_run_ends(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "end.yaml"
    path.write_text(EXPERIMENT.replace("days: 0.25", "days: 0.05") + HALF_HOUR)
    run = CliRunner().invoke(app, ["run", str(path), "-q", "--no-map", "-o", str(tmp_path / "out")])
    asked = CliRunner().invoke(app, ["doctor", "--for", str(path)])
    words = "0.05 days are no whole number of time steps of 1800 s: the run ends after 2 of them, at 0.0416667 days"
    assert run.stderr.count(words) == asked.output.replace("\n", " ").count(words) == 1
    caplog.clear()
    with caplog.at_level(logging.WARNING, "riftberg"):
        Model(
            berg(), Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)), Parameters(stepping={"time_step": 1800.0})
        ).run(days=0.05)
    assert sum(words in record.message for record in caplog.records) == 1


def other_value(name: str) -> Any:
    """Return a value of a parameter that is not its default."""
    group, key = name.split(".")
    section = getattr(Parameters(), group)
    usual, field = getattr(section, key), type(section).model_fields[key]
    if isinstance(usual, bool):
        return not usual
    if isinstance(usual, str):
        allowed = get_args(field.annotation) or get_args(getattr(field.annotation, "__value__", None))
        return next(word for word in allowed if word != usual)
    if isinstance(usual, int) and usual == 0:
        return 5
    return {None: 0.5, 0.0: 0.5}.get(usual, 0.9 * usual if usual else 0.5)


def end_of(parameters: Parameters) -> tuple[Any, ...]:
    """Where bergs end that meet on a shelf, with their bonds."""
    pair = [
        Iceberg.rectangle(12e3, 6e3, placement=(x, -55.5), thickness=200.0, velocity=(u, 0.0))
        for x, u in ((-39.0, 0.5), (-38.8, -0.5))
    ]
    model = Model(
        Iceberg.join(pair),
        Forcing.uniform(
            current=(0.2, 0.1), wind=(9.0, 3.0), depth=168.0, temperature=3.0, salinity=34.0, slope=(0.0, 0.0)
        ),
        parameters,
    )
    model.advance(steps=6)
    el = model.elements
    return (
        *(a.tobytes() for a in (el.lon, el.lat, el.thickness, model.bonds.status, model.bonds.strength)),
        model.notices,
    )


def test_what_no_law_reads_is_told_and_has_no_effect() -> None:
    """Bug: a sediment without the law of the seabed, the friction of crushing faces with springs, were taken without a word."""
    *plain, quiet = end_of(Parameters())
    assert not any("no effect" in text for text in quiet)
    for law in LAWS:
        for key in law.names:
            name = f"{law.group}.{key}"
            if name not in fields_by_path(QuasiStaticParameters) or law.acts(Parameters()):
                continue
            parameters = Parameters(**{law.group: {key: other_value(name)}})
            told = without_effect(parameters)
            assert list(told) == [name]
            assert re.fullmatch(rf"{re.escape(name)} = \S+ has no effect: it needs {re.escape(law.needs)}", told[name])
    # All at once, which is one run instead of thirty.
    groups: dict[str, dict[str, Any]] = {}
    for law in LAWS:
        keys = [key for key in law.names if f"{law.group}.{key}" in fields_by_path(QuasiStaticParameters)]
        if keys and not law.acts(Parameters()):
            groups.setdefault(law.group, {}).update({key: other_value(f"{law.group}.{key}") for key in keys})
    *changed, notices = end_of(Parameters(**groups))
    assert changed == plain
    assert sum("no effect" in text for text in notices) == sum(len(values) for values in groups.values())


def test_a_law_that_acts_reads_its_parameters_and_numerics_of_the_reference_are_left_alone() -> None:
    acting = {"grounding.law": "seabed", "fracture.criterion": "toughness"}
    for name, value in acting.items():
        group, key = name.split(".")
        more = {"toughness": 1e5} if value == "toughness" else {}
        (law,) = (law for law in LAWS if law.needs == f"{name} = '{value}'")
        given = {key: value, **{n: other_value(f"{group}.{n}") for n in law.names}, **more}
        assert not any(text.endswith(law.needs) for text in without_effect(Parameters(**{group: given})).values())
    namelist = Parameters(stepping=MTS, rolling={"tip": 0.9}, compatibility={"forcing_lag": True})
    assert without_effect(namelist) == {}
