"""The lattice of an experiment's berg as an option: what a result should not depend on can be changed from outside."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg import Options, build
from riftberg.errors import InputError
from riftberg.experiments.changes import parse_settings

FILE = """
start: 2020-12-09
days: 1
berg:
  rectangle: {length: 30 km, width: 15 km}
  placement: [-37.0, -56.0]
forcing: {uniform: {current: [0.1, 0.0], slope: [0, 0]}}
"""


def built(name, *settings):
    return build(str(name), Options(parse_settings(settings)))[0]


def angle_of(model):
    """Direction of the bonds, degrees from 0 to 90."""
    el, bonds = model.elements, model.bonds
    dx = (el.lon[bonds.second] - el.lon[bonds.first]) * np.cos(np.radians(el.lat.mean()))
    turn = np.degrees(np.arctan2(el.lat[bonds.second] - el.lat[bonds.first], dx)) % 90.0
    return float(np.median(turn))


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "slab.yaml"
    path.write_text(FILE)
    return path


def test_a_file_and_the_command_line_turn_the_lattice_alike(path):
    asked = built(path, "berg.lattice_angle=22.5")
    path.write_text(FILE.replace("berg:", "berg:\n  lattice_angle: 22.5"))
    given = built(path)
    np.testing.assert_array_equal(asked.elements.lon, given.elements.lon)
    assert angle_of(given) == pytest.approx(22.5, abs=0.5)
    area = (given.elements.length * given.elements.width).sum()
    assert area == pytest.approx(450e6, rel=1e-9)


def test_the_built_in_a68a_takes_another_lattice():
    plain, turned = built("a68a"), built("a68a", "berg.lattice_angle=30", "berg.radius=2 km")
    areas = [(m.elements.length * m.elements.width).sum() for m in (plain, turned)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-9)
    assert angle_of(turned) == pytest.approx(30.0, abs=1.0)


def test_packing_and_size_of_a_file_can_be_changed_both_ways(path):
    assert set(built(path, "berg.packing=hexagonal").elements.sides) == {6}
    path.write_text(FILE.replace("berg:", "berg:\n  packing: hexagonal"))
    small = built(path, "berg.packing=square", "berg.radius=750 m")
    assert set(small.elements.sides) == {4}
    assert small.elements.size == 200


@pytest.mark.parametrize(("setting", "message"), [
    ("berg.thicknes=300", "thickness"), ("berg.lattice_angl=3", "lattice_angle"), ("berg.offset=3,0", "offset"),
    ("berg.radius=-1", "radius"), ("bergz.radius=1", "berg"),
])  # fmt: skip
def test_what_is_no_key_of_a_lattice_is_refused_by_name(setting, message):
    with pytest.raises(InputError, match=message):
        parse_settings([setting])


@pytest.mark.parametrize("name", ["a68a-oras5", "a68a-paper"])
def test_an_experiment_whose_lattice_is_its_own_says_so(name):
    with pytest.raises(InputError, match="lattice"):
        built(name, "berg.lattice_angle=10")


@pytest.mark.parametrize("shape", ["field: {number: 5, area: [-40, -36, -58, -56]}"])
def test_a_shape_without_a_lattice_refuses_it(path, shape):
    path.write_text(FILE.replace("rectangle: {length: 30 km, width: 15 km}\n  placement: [-37.0, -56.0]", shape))
    with pytest.raises(InputError, match="lattice_angle"):
        built(path, "berg.lattice_angle=10")


def test_a_sweep_varies_the_lattice():
    from riftberg.ensembles.vary import read_varied

    one = read_varied(["berg.lattice_angle=0..45:4"])[0]
    assert (one.name, one.values, one.unit) == ("berg.lattice_angle", (0.0, 15.0, 30.0, 45.0), "degree")
    assert read_varied({"berg.packing": ["square", "hexagonal"]})[0].values == ("square", "hexagonal")
