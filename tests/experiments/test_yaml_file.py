"""Experiment files: what they may say, and what is said about mistakes."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Iceberg, Options, build
from riftberg.errors import BergError, InputError, RiftbergError
from riftberg.experiments.yaml_file import build_berg, read_file

SLAB = """\
start: 2020-12-09 13:00
days: 2
output_every_hours: 30 min
berg:
  rectangle: {length: 60 km, width: 15 km}
  placement: [-39.0, -55.0]
  thickness: 250 m
  rotation: 20
forcing:
  kind: formula
  uniform:
    {current: [20 cm/s, 0.0], wind: [5, -2], slope: [0, 0]}
parameters:
  fracture: {normal_strength: 20 kPa}
  bonds:
    youngs_modulus: 5e6
"""


@pytest.fixture
def slab(tmp_path: Path) -> Path:
    """Path of an experiment file."""
    path = tmp_path / "slab.yaml"
    path.write_text(SLAB)
    return path


def test_a_file_is_read_with_its_units(slab: Path) -> None:
    experiment, parameters, _ = read_file(slab)
    assert (experiment.name, experiment.start, experiment.days) == ("slab", datetime(2020, 12, 9, 13), 2.0)
    assert experiment.output_every_hours == 0.5
    assert experiment.berg.rectangle is not None
    assert experiment.berg.rectangle.length == 60e3
    assert experiment.forcing.uniform[0].current == (0.2, 0.0)
    assert (parameters.fracture.normal_strength, parameters.bonds.youngs_modulus) == (20e3, 5e6)
    assert parameters.drag.ocean_scale == 1.0  # what was tuned to A68a belongs to its preset
    slab.write_text(SLAB.replace("parameters:", "parameters:\n  preset: a68a-2022"))
    assert read_file(slab)[1].drag.ocean_scale == 17.8
    slab.write_text(SLAB.replace("parameters:", "parameters:\n  preset: a68a-2022\n  stepping: {scheme: mts}"))
    assert (read_file(slab)[1].contact.distance, read_file(slab)[1].stepping.substeps) == (4000.0, None)


@pytest.mark.parametrize(
    ("file", "name"),
    [("my berg.yaml", "my-berg"), ("_2.yaml", "2"), ("A68a (2020).yml", "A68a-2020-"), ("---.yaml", "experiment")],
)
def test_a_file_of_any_name_names_its_experiment(slab: Path, file: str, name: str) -> None:
    """A file with a space in its name was refused for a key ``name`` that it does not have."""
    text = "\n".join(line for line in slab.read_text().splitlines() if not line.startswith("name:"))
    path = slab.with_name(file)
    path.write_text(text)
    assert read_file(path)[0].name == name


def test_the_model_is_what_the_file_says(slab: Path) -> None:
    model, info = build(str(slab), Options(changes={"ice": {"density": 900.0}}, numerics="reference"))
    assert (info.name, info.days, info.output_every_hours) == ("slab", 2.0, 0.5)
    assert len(model.elements.id) == 100
    assert set(model.elements.thickness) == {250.0}
    np.testing.assert_allclose(model.elements.mass, 9e6 * 250.0 * 900.0)
    assert model.parameters.compatibility.zero_start
    assert model.start == datetime(2020, 12, 9, 13)


def test_hexagons_are_bonded_as_hexagons(slab: Path) -> None:
    slab.write_text(SLAB.replace("rotation: 20", "packing: hexagonal"))
    model, _ = build(str(slab))
    assert (model.parameters.bonds.packing, model.constants.max_bonds) == ("hexagonal", 6)


def test_the_quadratic_sea_floor_is_chosen_in_a_file(slab: Path) -> None:
    law = "grounding: {law: quadratic, quadratic_coefficient: 2e3}\n  stepping: {scheme: mts}"
    slab.write_text(SLAB.replace("parameters:\n", f"parameters:\n  {law}\n").replace("wind: [5, -2]", "depth: 150 m"))
    model, _ = build(str(slab), Options())
    assert (model.constants.ground_coefficient, model.constants.ground_quadratic) == (0.0, 2e3)
    slab.write_text(
        SLAB.replace("parameters:\n", "parameters:\n  grounding: {law: quadratic}\n  stepping: {scheme: mts}\n")
    )
    with pytest.raises(InputError, match="needs grounding"):
        read_file(slab)


def test_dates_with_a_zone_become_utc(slab: Path) -> None:
    slab.write_text(SLAB.replace("2020-12-09 13:00", "2020-12-09T15:00:00+02:00"))
    assert read_file(slab)[0].start == datetime(2020, 12, 9, 13)


def test_an_outline_is_found_beside_the_file(slab: Path) -> None:
    (slab.parent / "berg.csv").write_text("lon,lat\n-39,-55\n-38.5,-55\n-38.5,-54.8\n-39,-54.8\n")
    text = SLAB.replace("rectangle: {length: 60 km, width: 15 km}", "outline: {file: berg.csv}")
    slab.write_text(text.replace("  placement: [-39.0, -55.0]\n", ""))
    experiment, parameters, _ = read_file(slab)
    berg = build_berg(experiment, parameters, slab.parent)
    assert berg.area == pytest.approx(32e3 * 22.2e3, rel=0.05)


MISTAKES = [
    ("20 kPa", "20 m", 14, "parameters.fracture.normal_strength", "measured in Pa"),
    ("normal_strength", "normal_strenght", 14, "parameters.fracture.normal_strenght", "Did you mean 'normal_strength'"),
    ("kind: formula", "kind: formla", 10, "forcing.kind", "Did you mean 'formula'"),
    ("kind: formula", "kind: constant", 9, "forcing", "kind: constant is gone. Write forcing: {uniform: "),
    ("  kind: formula\n  uniform:", "  a:", 9, "forcing.kind", "missing"),
    ("days: 2", "days: -2", 2, "days", "-2 is not possible"),
    ("rectangle", "rectangl", 5, "berg.rectangl", "Did you mean 'rectangle'"),
    ("60 km", "60 kg", 5, "berg.rectangle.length", "measured in m"),
    ("60 km", "-3", 5, "berg.rectangle.length", "Allowed: a number > 0 and <= 1e+08, in m"),
    ("  placement: [-39.0, -55.0]\n", "", 4, "berg", "needs placement"),
    ("thickness: 250 m", "mask: {file: a.nc}", 4, "berg", "has 2 shapes"),
    ("thickness: 250 m", "thickness: [3]", 7, "berg.thickness", "Allowed"),
    ("fracture:", "fractur:", 14, "parameters.fractur", "Did you mean 'fracture'"),
    ("2020-12-09 13:00", "yesterday", 1, "start", "a date"),
    ("rotation: 20", "rotation: 20\n  rotation: 30", 9, "berg.rotation", "stands twice, first in line 8"),
    ("wind: [5, -2]", "wind: [5, -2", 12, "", "not valid YAML"),
    ("parameters:", "parameters:\n  preset: a68a-2021", 14, "parameters.preset", "Did you mean 'a68a-2022'"),
    ("5e6", "-1", 16, "parameters.bonds.youngs_modulus", "Allowed: a number >= 0 and <= 1e+12, in Pa"),
]


@pytest.mark.parametrize(("right", "wrong", "line", "key", "message"), MISTAKES)
def test_mistakes_are_shown_with_line_and_key(
    slab: Path, right: str, wrong: str, line: int, key: str, message: str
) -> None:
    assert right in SLAB
    slab.write_text(SLAB.replace(right, wrong))
    with pytest.raises(InputError) as caught:
        read_file(slab)
    text = str(caught.value)
    assert text.startswith(f"{slab}, line {line}")
    assert key in text
    assert message in text


def test_a_missing_key_is_named(slab: Path) -> None:
    slab.write_text(SLAB.replace("days: 2\n", ""))
    with pytest.raises(InputError, match="days: this key is missing"):
        read_file(slab)


def test_files_that_are_no_experiments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_file(tmp_path / "none.yaml")
    (tmp_path / "list.yaml").write_text("- 1\n- 2\n")
    with pytest.raises(InputError, match="list of sections"):
        read_file(tmp_path / "list.yaml")


def test_parts_can_be_left_out_of_named_oceans_only(slab: Path) -> None:
    with pytest.raises(InputError, match="has no named parts"):
        build(str(slab), Options(without=frozenset({"shoal"})))


def with_berg_keys(slab: Path, text: str) -> Path:
    """Add keys to the berg of the file."""
    slab.write_text(SLAB.replace("  rotation: 20\n", text))
    return slab


def built(slab: Path) -> Iceberg:
    experiment, parameters, _ = read_file(slab)
    return build_berg(experiment, parameters, slab.parent)


def test_rifts_and_strength_are_those_of_the_calls(slab: Path) -> None:
    plain = built(with_berg_keys(slab, ""))
    line = [[-39.2, -55.2], [-39.2, -54.8]]
    (slab.parent / "rift.csv").write_text("lon,lat\n-38.8,-55.2\n-38.8,-54.8\n")
    text = """\
  rifts:
    - {points: [[-39.2, -55.2], [-39.2, -54.8]], strength: 30 %}
    - {file: rift.csv, broken: yes}
  strength: {weibull: 6, seed: 3}
"""
    berg = built(with_berg_keys(slab, text))
    called = plain.with_rifts(line, strength=0.3).with_rifts(slab.parent / "rift.csv", broken=True)
    called = called.with_strength("weibull", shape=6.0, seed=3)
    np.testing.assert_array_equal(berg.bonds.strength, called.bonds.strength)
    np.testing.assert_array_equal(berg.bonds.status, called.bonds.status)
    assert ((berg.bonds.status == 2).sum(), berg.elements.berg.max()) == (5, 2)
    model, _ = build(str(slab))
    np.testing.assert_array_equal(model.bonds.strength, berg.bonds.strength)


@pytest.mark.parametrize(("text", "call"), [
    ("{normal: 0.2}", ("normal", {"spread": 0.2, "seed": 1})),
    ("{uniform: 10 %, seed: 5}", ("uniform", {"spread": 0.1, "seed": 5})),
])  # fmt: skip
def test_distributions_of_strength(slab: Path, text: str, call: tuple[str, dict[str, Any]]) -> None:
    berg = built(with_berg_keys(slab, f"  strength: {text}\n"))
    expected = built(with_berg_keys(slab, "")).with_strength(call[0], **call[1])
    np.testing.assert_array_equal(berg.bonds.strength, expected.bonds.strength)


def test_masks_of_rifts_and_maps_of_strength_are_files(slab: Path) -> None:
    lon, lat = np.linspace(-40.0, -38.0, 101), np.linspace(-55.5, -54.5, 51)
    coords = {"lat": lat, "lon": lon}
    one = xr.DataArray(np.ones((51, 101)), coords, ("lat", "lon"))
    fields = {"rift": 1.0 * (abs(one.lon + 39) < 0.03) * one, "strength": 0.5 * one}
    xr.Dataset(fields).to_netcdf(slab.parent / "weak.nc")
    text = """\
  rifts: [{file: weak.nc, variable: rift, strength: 0.2}]
  strength: {file: weak.nc, variable: strength}
"""
    berg = built(with_berg_keys(slab, text))
    assert sorted(set(np.round(berg.bonds.strength, 12))) == [0.1, 0.5]
    assert (berg.bonds.strength < 0.2).sum() >= 5


BERG_MISTAKES = [
    ("rifts: 5", "line 8, berg.rifts", "is no section and no list of sections. Each has the keys file, points"),
    ("rifts: [5]", "line 8, berg.rifts.0", "5 is not a section"),
    ("strength: weibull", "line 8, berg.strength", "'weibull' is not a section"),
    ("rifts: [{fille: a}]", "line 8, berg.rifts.0.fille", "Did you mean 'file'"),
    ("rifts: [{file: a, strength: 2}]", "line 8, berg.rifts.0.strength", "Allowed: a number >= 0 and <= 1"),
    ("rifts: [{file: a, strength: 3 kPa}]", "line 8, berg.rifts.0.strength", "measured in"),
    (
        "rifts:\n    - {points: [[0, 1], [2, 3]]}\n    - {strength: 0.1}",
        "line 10, berg.rifts.1",
        "one of file and points",
    ),
    ("rifts: [{points: [[0, 1]]}]", "line 8, berg.rifts.0", "at least two"),
    ("rifts: [{points: [[0, 1], [2]]}]", "line 8, berg.rifts.0.points.1.1", "missing"),
    (
        "rifts: [{file: a, broken: yes, strength: 0.1}]",
        "line 8, berg.rifts.0",
        "one of strength, broken: true and depth",
    ),
    ("strength: 0.5", "line 8, berg.strength", "0.5 is not a section. It has the keys weibull"),
    ("strength: {weibul: 5}", "line 8, berg.strength.weibul", "Did you mean 'weibull'"),
    ("strength: {weibull: 0}", "line 8, berg.strength.weibull", "Allowed: a number > 0"),
    ("strength: {uniform: 1}", "line 8, berg.strength.uniform", "Allowed: a number >= 0 and < 1"),
    ("strength: {weibull: 5, normal: 0.1}", "line 8, berg.strength", "exactly one of weibull, normal"),
    ("strength: {weibull: 5, seed: -1}", "line 8, berg.strength.seed", "Allowed: a whole number >= 0"),
    ("rifts: [{points: [[0, 1], [2, 3]], crs: EPSG:3031}]", "line 8, berg.rifts.0", "points of a rift have no crs"),
    ("rifts: [{points: [[0, 1], [2, 3]], threshold: 1}]", "line 8, berg.rifts.0", "points of a rift have no threshold"),
    ("strength: {weibull: 5, variable: s}", "line 8, berg.strength", "variable is that of a map; weibull has none"),
    ("strength: {normal: 0.1, variable: s}", "line 8, berg.strength", "variable is that of a map; normal has none"),
    ("strength: {seed: 1}", "line 8, berg.strength", "exactly one of weibull, normal"),
]


@pytest.mark.parametrize(("text", "place", "message"), BERG_MISTAKES)
def test_mistakes_in_rifts_and_strength_are_shown_with_line_and_key(
    slab: Path, text: str, place: str, message: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_file(with_berg_keys(slab, f"  {text}\n"))
    assert f"{slab}, {place}: " in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(("text", "message"), [
    ("rifts: [{points: [[0, 1], [2, 3]]}]", "berg.rifts.0, rift: the rift crosses no bond"),
    ("rifts: [{file: none.geojson}]", r"berg.rifts.0, .*none.geojson: file not found"),
    ("strength: {file: none.nc}", r"berg.strength, .*none.nc: file not found"),
])  # fmt: skip
def test_rifts_and_strengths_that_do_not_fit_name_their_key(slab: Path, text: str, message: str) -> None:
    with pytest.raises(BergError, match=message):
        built(with_berg_keys(slab, f"  {text}\n"))


BERGS = """\
start: 2020-12-09
days: 1
bergs:
  - name: A
    rectangle: {length: 12 km, width: 6 km}
    placement: [-37.0, -56.0]
    rifts:
      - {points: [[-37.0, -56.1], [-37.0, -55.9]], strength: 0.5}
  - rectangle: {length: 2 km, width: 2 km}
    radius: 250 m
    packing: hexagonal
    placement: [-36.7, -56.0]
  - field: {number: 12, area: [-36.5, -36.0, -56.5, -56.2], sizes: tournadre, seed: 3}
    velocity: [0.1, 0.0]
forcing:
  kind: formula
  uniform: {current: [10 cm/s, 0.0], depth: 300 m}
  eddy:
    - {centre: [-37.0, -56.3], radius: 40 km, speed: -0.5}
    - {centre: [-36.0, -56.3], radius: 20 km, speed: 50 cm/s, velocity: [0.1, 0.0]}
  tide: [{major: 0.1, period: 12 h}]
  seamount: [{centre: [-37.0, -56.0], height: 200 m, width: 10 km, depth: 400 m}]
  turning_wind: [{speed: 10, turning: 30}]
"""


def test_a_list_of_bergs_and_formulas(tmp_path: Path) -> None:
    path = tmp_path / "bergs.yaml"
    path.write_text(BERGS)
    model, _ = build(str(path))
    names = [name for name, _ in model.fragments.bergs]
    assert names[:2] == ["A", "berg 2"]
    assert len(names) == 14
    assert (model.bonds.strength < 1.0).sum() == 2
    np.testing.assert_array_equal(model.elements.u[-12:], 0.1)
    model.forcing.sample(model.elements, 0.0)
    assert model.elements.depth.min() == pytest.approx(200.0, abs=15.0)
    assert model.elements.depth.max() == 300.0
    assert np.hypot(model.elements.ua, model.elements.va) == pytest.approx(10.0)
    assert "eddy" in model.forcing.describe()


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("old", "new", "where", "what"),
    [
        ("bergs:\n", "berg:\n  lattice: {rows: [[0, 0, 2]]}\n  placement: [-37, -50]\nbergs:\n", "", "one of berg and bergs"),
        ("packing: hexagonal", "packing: round", "bergs.1.packing", "round"),
        ("[-36.7, -56.0]", "[-37.0, -56.0]", "bergs", "overlap"),
        ("name: A", "name: berg 2", "bergs", "two bergs are called"),
        ("velocity: [0.1, 0.0]\nforcing", "radius: 100 m\nforcing", "bergs.2", "field has no radius"),
        ("number: 12", "number: 0", "bergs.2.field.number", "0"),
        ("sizes: tournadre", "between: [1e5, 1e6]", "bergs.2.field", "between is that of sizes: tournadre"),
        ("sizes: tournadre", "sizes: tournadre, between: [1e6, 1e5]", "bergs.2.field", "areas between 1e+06 and 100000"),
        ("name: A", "thickness: heights.nc", "bergs.0", "a berg from a rectangle takes no map of thickness"),
        ("velocity: [0.1, 0.0]\nforcing", "thickness: heights.nc\nforcing", "bergs.2", "from a field takes no map of thickness"),
        ("period: 12 h", "period: 12.42", "forcing.tide.0.period", "Allowed: a number >= 600, in s"),
        ("period: 12 h", "minor: -0.2", "forcing.tide.0", "minor = -0.2 m/s is faster than major = 0.1 m/s"),
        ("  turning_wind", "  slope: {point: [-37, -56], towards: 0, gradient: 0.01, depth: 300, between: [500, 100]}\n"
         "  turning_wind",
         "forcing.slope.0", "between = [500.0, 100.0] is not in order"),
        ("area: [-36.5, -36.0,", "area: [-36.0, -36.5,", "bergs.2.field", "area"),
        ("radius: 40 km, speed: -0.5", "radius: 40 km", "forcing.eddy.0.speed", "missing"),
        ("speed: -0.5", "sped: -0.5", "forcing.eddy.0.sped", "Did you mean 'speed'"),
        ("placement: [-36.7, -56.0]", "placement: [-56.0, -136.7]", "bergs.1.placement", "latitude"),
    ],
)  # fmt: skip
def test_mistakes_in_lists_of_bergs_are_told_with_their_place(
    tmp_path: Path, old: str, new: str, where: str, what: str
) -> None:
    path = tmp_path / "bergs.yaml"
    assert old in BERGS
    path.write_text(BERGS.replace(old, new))
    with pytest.raises(RiftbergError) as told:
        build(str(path))
    assert what in str(told.value)
    assert where in str(told.value)


def test_a_field_by_formula_that_says_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bergs.yaml"
    path.write_text(BERGS[: BERGS.index("  uniform")])
    with pytest.raises(RiftbergError, match="no formula is given"):
        build(str(path))
