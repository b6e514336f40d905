"""Experiment files: what they may say, and what is said about mistakes."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from riftberg.errors import InputError
from riftberg.experiments import Options, build
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
  kind: constant
  current: [20 cm/s, 0.0]
  wind: [5, -2]
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
    assert experiment.forcing.current == (0.2, 0.0)
    assert (parameters.fracture.normal_strength, parameters.bonds.youngs_modulus) == (20e3, 5e6)
    assert parameters.drag.ocean_scale == 17.8  # the preset that a file starts from


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
    assert (model.parameters.bonds.packing, model.parameters.bonds.max_bonds) == ("hexagonal", 6)


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
    ("kind: constant", "kind: constnt", 10, "forcing.kind", "Did you mean 'constant'"),
    ("  kind: constant\n", "", 9, "forcing.kind", "missing"),
    ("days: 2", "days: -2", 2, "days", "-2 is not possible"),
    ("rectangle", "rectangl", 5, "berg.rectangl", "Did you mean 'rectangle'"),
    ("60 km", "60 kg", 5, "berg.rectangle.length", "measured in m"),
    ("60 km", "-3", 5, "berg.rectangle.length", "Allowed: a number > 0, in m"),
    ("  placement: [-39.0, -55.0]\n", "", 4, "berg", "needs placement"),
    ("thickness: 250 m", "mask: {file: a.nc}", 4, "berg", "has 2 shapes"),
    ("thickness: 250 m", "thickness: [3]", 7, "berg.thickness", "Allowed"),
    ("fracture:", "fractur:", 14, "parameters.fractur", "Did you mean 'fracture'"),
    ("2020-12-09 13:00", "yesterday", 1, "start", "a date"),
    ("rotation: 20", "rotation: 20\n  rotation: 30", 9, "berg.rotation", "stands twice, first in line 8"),
    ("wind: [5, -2]", "wind: [5, -2", 13, "", "not valid YAML"),
    ("parameters:", "parameters:\n  preset: a68a-2021", 14, "parameters.preset", "Did you mean 'a68a-2022'"),
    ("5e6", "-1", 16, "parameters.bonds.youngs_modulus", "Allowed: a number >= 0, in Pa"),
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
