"""What an experiment file says can be varied and set: berg, placement, start, forcing; of built-ins the berg."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from riftberg import Options, build, forecast, open_sweep, sweep
from riftberg.cli.compare import opened_result
from riftberg.ensembles.forecast import forecast_errors
from riftberg.ensembles.uncertain import with_errors
from riftberg.ensembles.vary import Draws, list_members, plan_from_design, read_varied, vary_with_file
from riftberg.errors import InputError
from riftberg.experiments.changes import parse_settings

YAML = """start: 2020-12-09
days: 0.125
forcing: {kind: formula, uniform: {current: [0.3, 0.1], wind: [4, 2]}, eddy: [{centre: [-39.2, -55], radius: 30 km, speed: 0.2}]}
berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39, -55], thickness: 200 m}
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    (tmp_path / "it.yaml").write_text(YAML)
    return str(tmp_path / "it.yaml")


def tracks(result):
    return result["lon"].values[:, 0], result["lat"].values[:, 0]


@pytest.mark.slow
def test_berg_placement_and_forcing_of_a_file_are_varied(file: str, tmp_path: Path) -> None:
    vary = ("berg.placement=[-39, -55],[-38, -55]", "forcing.eddy.speed=0.2..0.4:2")
    result = sweep(file, vary, every_hours=1, workers=0)
    assert result["status"].values.tolist() == [0] * 4
    lon, lat = tracks(result)
    np.testing.assert_allclose(lon[:, 0], [-39.0, -39.0, -38.0, -38.0], atol=1e-3)
    assert lat[1, -1] > lat[0, -1] + 1e-5  # east of an eddy that turns counter-clockwise
    assert result["forcing_eddy_speed"].values.tolist() == [0.2, 0.4, 0.2, 0.4]
    result = sweep(file, "berg.rectangle.length=9,18km", every_hours=1, workers=0)
    np.testing.assert_allclose(result["fragment_area"].values[:, 0], [54e6, 108e6])


def test_members_that_start_later_have_their_own_dates(file: str, tmp_path: Path) -> None:
    result = sweep(file, "start=2020-12-09,2020-12-11 06:00", every_hours=1, workers=0, output=tmp_path / "s")
    assert (result["fragment_birth_time"].diff("member") == np.timedelta64(54, "h")).all()
    assert opened_result(tmp_path / "s" / "sweep.nc#1")["time"].values[0] == np.datetime64("2020-12-11T06:00")
    assert open_sweep(tmp_path / "s")["time"].values[0] == np.datetime64("2020-12-09")


def test_current_and_wind_are_scaled(file: str) -> None:
    model = build(file)[0]
    plain = build(file)[0]
    scaled = with_errors(model, {"current_error.scale": 2.0, "wind_error.scale": 0.5})
    for one in (plain, scaled):
        one.forcing.sample(one.elements, 0.0)
    for name, factor in (("uo", 2.0), ("slope_x", 2.0), ("vorticity", 2.0), ("ua", 0.5)):
        np.testing.assert_allclose(getattr(scaled.elements, name), factor * getattr(plain.elements, name))
    assert "2 x current, 0.5 x wind" in scaled.forcing.describe()
    u = scaled.forcing.currents(np.array([-39.0]), np.array([-55.0]), 0.0)[0]
    np.testing.assert_allclose(u, 2.0 * plain.forcing.currents(np.array([-39.0]), np.array([-55.0]), 0.0)[0])


def test_members_with_another_depth_run_aground_on_it(file: str) -> None:
    """The keel is 166 m deep: the bed is that with the error of the depth, not that of the experiment."""
    shallow = YAML.replace("wind: [4, 2]", "wind: [4, 2], depth: 170 m")
    Path(file).write_text(shallow)
    result = sweep(file, "floor_error.offset=-10,0 m", every_hours=1, workers=0)
    assert result["first_aground"].notnull().values.tolist() == [True, False]


def test_the_berg_of_a_built_in_experiment_is_changed() -> None:
    plain = build("a68a")[0]
    settings = ("berg.thickness=150 m", "berg.placement=[-40, -57]", "berg.rotation=90", "berg.velocity=[0.1, 0.2]")
    other = build("a68a", Options(changes=parse_settings(settings)))[0]
    e, was = other.elements, plain.elements
    np.testing.assert_allclose(e.thickness, 150.0)
    np.testing.assert_allclose(e.mass, 0.75 * was.mass)
    share = e.mass / e.mass.sum()
    assert [share @ e.lon, share @ e.lat] == pytest.approx([-40.0, -57.0], abs=2e-3)
    assert [share @ e.u, share @ e.v] == pytest.approx([0.1, 0.2])
    # Long in the other direction now.
    stretch = [np.ptp(x.lon) * np.cos(np.radians(x.lat.mean())) / np.ptp(x.lat) for x in (was, e)]
    assert stretch[0] > 1.5
    assert stretch[1] < 0.7
    assert len(other.outlines) == len(plain.outlines)
    spinning = build("a68a", Options(changes=parse_settings(["berg.spin=1e-5"])))[0].elements
    assert set(spinning.spin) == {1e-5}
    varied = read_varied("berg.thickness=150m,250m")
    assert varied[0].values == (150.0, 250.0)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["forcing.edy.speed=1"], "forcing.edy.speed: the experiment file has no 'edy' there"),
        (["berg.rectangle.lenght=9 km"], "lenght: there is no such key. Did you mean 'length'"),
        (["start=yesterday"], "start"),
    ],
)
def test_what_the_file_cannot_say_is_refused(file: str, settings, words) -> None:
    with pytest.raises(InputError, match=words):
        build(file, Options(changes=parse_settings(settings)))


def test_a_key_of_a_file_is_refused_for_a_built_in_experiment() -> None:
    with pytest.raises(InputError, match="a68a has no experiment file with this key"):
        build("a68a", Options(changes=parse_settings(["forcing.eddy.speed=1"])))
    with pytest.raises(InputError, match=r"an experiment file has no key forcing\.edy\.speed"):
        read_varied("forcing.edy.speed~uniform(0, 1)")


def test_keys_of_a_file_have_distributions_in_their_unit(file: str) -> None:
    drawn = [
        "forcing.eddy.radius~normal(20 km, 10 %)",
        "forcing.eddy.speed~uniform(20, 40 cm/s)",
        "forcing.uniform.current.0~normal(0.1, 0.02)",
        "start~choice(2020-12-09, 2020-12-12)",
    ]
    varied = read_varied(drawn)
    assert [v.unit for v in varied] == ["m", "m s-1", "m s-1", ""]
    assert varied[0].distribution.numbers == (20e3, 2e3)
    assert varied[0].distribution.limits.low == 0.0
    assert varied[1].distribution.numbers == pytest.approx((0.2, 0.4))
    members = list_members(varied, Draws(4))
    assert all(0.2 <= member["forcing.eddy.speed"] <= 0.4 for member in members)
    assert {member["start"] for member in members} <= {"2020-12-09", "2020-12-12"}
    changes = parse_settings([f"{name}={value}" for name, value in members[2].items()])
    model = build(file, Options(changes=changes))[0]
    sample = model.forcing.parts if hasattr(model.forcing, "parts") else []
    assert any(getattr(part, "radius", None) == members[2]["forcing.eddy.radius"] for part in sample)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("forcing.edy.speed~uniform(0, 1)", "an experiment file has no key forcing.edy.speed"),
        ("forcing.eddy.radius~normal(20 s, 10 %)", "20 s"),
        ("start~uniform(1, 2)", "no number"),
    ],
)
def test_distributions_that_no_key_has_are_refused(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_varied(text)


def test_several_bergs_are_changed_alike_or_one_by_its_number(tmp_path: Path) -> None:
    """Two elements each, of 100 and 200 m."""
    (tmp_path / "two.yaml").write_text(
        "start: 2020-12-09\ndays: 1\nforcing: {uniform: {slope: [0, 0]}}\nbergs:\n"
        "  - {rectangle: {length: 6 km, width: 3 km}, placement: [-39, -55], thickness: 100 m, radius: 1500}\n"
        "  - {rectangle: {length: 6 km, width: 3 km}, placement: [-37, -55], thickness: 200 m, radius: 1500}\n"
    )
    for setting, thickness in (
        ("berg.thickness=300 m", [300.0] * 4), ("bergs.1.thickness=300 m", [100.0, 100.0, 300.0, 300.0]),
    ):  # fmt: skip
        model = build(str(tmp_path / "two.yaml"), Options(changes=parse_settings([setting])))[0]
        assert model.elements.thickness.tolist() == thickness


VARY = """vary:
  forcing.eddy.speed: normal(0.2, 0.5 m/s)
  berg.rectangle.length: uniform(8, 10 km)
  start.thickness: lognormal(1, 15 %)
  current_error.speed: 0.2 m/s
  fracture.normal_strength: 14..24kPa:3
"""


def test_numbers_of_the_file_are_drawn_in_their_units_within_their_limits() -> None:
    speed, length = read_varied(["forcing.eddy.speed~normal(20, 2 cm/s)", "berg.rectangle.length~uniform(8, 10 km)"])
    members = list_members([speed, length], Draws(64))
    speeds, lengths = (np.array([m[name] for m in members]) for name in ("forcing.eddy.speed", "berg.rectangle.length"))
    assert np.mean(speeds) == pytest.approx(0.2, abs=1e-3)
    assert np.std(speeds) == pytest.approx(0.02, rel=0.05)
    assert 8e3 < lengths.min() < 8.1e3 < 9.9e3 < lengths.max() < 10e3
    (v,) = read_varied("berg.rectangle.length~normal(1 km, 1 km)")
    assert "which cuts off 16 %" in v.told()
    assert min(m[v.name] for m in list_members([v], Draws(32))) > 0.0
    (shift,) = read_varied("forcing.uniform.current~normal(0, 0.1)")
    assert all(len(m[shift.name]) == 2 for m in list_members([shift], Draws(2)))


@pytest.mark.slow
def test_what_the_file_varies_is_drawn_by_sweep_forecast_and_sensitivity(tmp_path: Path) -> None:
    path = tmp_path / "it.yaml"
    path.write_text(YAML + VARY)
    found = vary_with_file(path, "fracture.normal_strength~lognormal(18 kPa, 20 %)")
    assert found["forcing.eddy.speed"] == "~normal(0.2, 0.5 m/s)"
    assert found["current_error.speed"] == [0.2]
    assert found["fracture.normal_strength"] == "~lognormal(18 kPa, 20 %)"  # what is given comes before the file
    of_forecast = forecast_errors(path, ())
    assert of_forecast["current_error.speed"] == [0.2]  # and the file before the errors that a forecast has
    assert of_forecast["fracture.normal_strength"] == [14e3, 19e3, 24e3]
    assert "wind_error.speed" in of_forecast
    result = sweep(path, members=2, workers=0, every_hours=3)
    assert result.sizes["member"] == 6
    assert result["status"].values.tolist() == [0] * 6
    assert len(set(result["forcing_eddy_speed"].values)) == 2
    made = forecast(
        path, ["fracture.normal_strength=18 kPa"], members=2, default_errors=False, workers=0, every_hours=3
    )
    assert made["status"].values.tolist() == [0, 0]
    assert float(made["control_lon"].isel(control_fragment=0, time=0)) == pytest.approx(-39.0, abs=1e-3)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("fracture.normal_strength: lognormal(18 kPa, 20)", r"line 6, vary.fracture.normal_strength.*factor of"),
        ("forcing.eddy.sped: uniform(0, 1)", r"line 6, vary.forcing.eddy.sped.*no key forcing.eddy.sped"),
        ("berg.thickness: normal(-100 m, 10 m)", r"line 6, vary.berg.thickness.*100 % of the probability"),
    ],
)
def test_what_is_wrong_under_vary_is_told_with_its_line(line: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "it.yaml"
    path.write_text(YAML + "vary:\n  " + line + "\n")
    with pytest.raises(InputError, match="(?s)" + words):
        sweep(path, members=2, workers=0)


def test_what_is_taken_in_turn_does_not_go_with_what_is_drawn() -> None:
    """By the number of the member alone, all even members had the lower half of every Sobol' number."""
    members = list_members(
        read_varied(["forcing.eddy.speed~each(0.1, 0.2)", "start.east~normal(0 km, 1 km)"]), Draws(256)
    )
    east = np.array([m["start.east"] for m in members])
    first = np.array([m["forcing.eddy.speed"] for m in members]) == 0.1
    assert first.sum() == 128
    assert abs(east[first].mean() - east[~first].mean()) < 300.0
    assert east[first].std() > 800.0


def test_values_are_taken_in_turn() -> None:
    vary = read_varied(["forcing.eddy.speed~each(0.1, 0.2, 0.3)", "start.thickness~lognormal(1, 15 %)"])
    members = list_members(vary, Draws(7))
    speeds = [m["forcing.eddy.speed"] for m in members]
    assert sorted(speeds[:3]) == sorted(speeds[3:6]) == [0.1, 0.2, 0.3]
    assert [m["forcing.eddy.speed"] for m in list_members(vary, Draws(4))] == speeds[
        :4
    ]  # the same where more are added
    alone = list_members(read_varied("start.thickness~lognormal(1, 15 %)"), Draws(7))
    assert [m["start.thickness"] for m in members] == [m["start.thickness"] for m in alone]
    assert "each of 0.1, 0.2, 0.3 in turn" in vary[0].told()


def test_a_column_of_a_design_has_units_everywhere_or_nowhere(tmp_path: Path) -> None:
    """Bug: 18 kPa in one row and 20 in the next were 20 Pa."""
    for column in (["18 kPa", "20"], ["20", "18 kPa"], ["18 kPa", "2e4", "20 kPa"]):
        with pytest.raises(
            InputError, match=r"--design, fracture.normal_strength: (20|2e4) has no unit, but 18 kPa has"
        ):
            plan_from_design({"fracture.normal_strength": column})
    _, members = plan_from_design(
        {"fracture.normal_strength": ["18 kPa", "20000 Pa", "0"], "bonds.packing": ["square"] * 3}
    )
    assert [row["fracture.normal_strength"] for row in members] == [18e3, 20e3, 0.0]
