"""What a user changes of a berg changes all that belongs to it."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import collision
from riftberg import Iceberg, Model, Options, build
from riftberg.errors import InputError
from riftberg.experiments.changes import change_berg
from riftberg.experiments.yaml_file import read_file
from riftberg.ocean.story import StoryOcean
from riftberg.plane import EqualAreaPlane

FILE = """start: 2020-12-09 13:00
days: 1
berg: {{rectangle: {{length: 24 km, width: 12 km}}, placement: [-38.5, -55.1], thickness: 200{more}}}
forcing: {{uniform: {{current: [0, 0], slope: [0, 0]}}}}
"""


def flow(model: Any) -> tuple[float, float]:
    """Rotation (s-1) and divergence of the velocities of the ice."""
    e = model.elements
    share = e.mass / e.mass.sum()
    x, y = EqualAreaPlane(share @ e.lon, share @ e.lat, 6.378e6).forward(e.lon, e.lat)
    (_, ux, uy), (_, vx, vy) = (np.linalg.lstsq(np.c_[np.ones(x.size), x, y], a, rcond=None)[0] for a in (e.u, e.v))
    return 0.5 * (vx - uy), ux + vy


def file_model(folder: Path, more: str = "") -> Model:
    """A berg of a file."""
    (folder / "x.yaml").write_text(FILE.format(more=more))
    return build(str(folder / "x.yaml"), Options())[0]


def test_the_spin_of_a_file_turns_the_berg(tmp_path: Path) -> None:
    """Its elements had the spin, and no velocity about its centre: a fiftieth of it was left after an hour."""
    model = file_model(tmp_path, ", spin: 3e-5")
    turn, growth = flow(model)
    assert turn == pytest.approx(3e-5, rel=5e-3)  # in local axes
    assert abs(growth) < 1e-8
    model.advance(1.0 / 24.0)
    assert flow(model)[0] == pytest.approx(2.9e-5, rel=0.1)


def test_each_of_several_pieces_turns_about_its_own_centre() -> None:
    """Pieces are bergs of their own; one of a single element has no velocity by its spin."""
    x, y = np.array([0.0, 2e3, 50e3]), np.zeros(3)
    e = Iceberg.from_points(x, y, thickness=200.0, radius=1e3, spin=1e-4, latlon=False).elements
    assert e.v.tolist() == pytest.approx([-0.1, 0.1, 0.0], abs=1e-12)
    assert not e.u.any()


def test_a_rigid_rotation_is_that_of_the_sphere_and_knows_no_dateline() -> None:
    """By the exact velocity of a rotation about a point of the sphere, in local east and north."""
    lon, lat = (a.ravel() for a in np.meshgrid(180.0 + 0.05 * np.arange(-3, 4), -64.0 + 0.025 * np.arange(-2, 3)))
    berg = Iceberg.from_points((lon + 180.0) % 360.0 - 180.0, lat, thickness=200.0, radius=1.2e3, spin=1e-5)
    assert berg.elements.berg.max() == 1
    a, b, b0 = np.radians(lon - 180.0), np.radians(lat), np.radians(lat.mean())
    speed = 1e-5 * berg.earth_radius
    u = speed * (np.sin(b0) * np.cos(b) - np.cos(b0) * np.sin(b) * np.cos(a))
    v = speed * np.cos(b0) * np.sin(a)
    np.testing.assert_allclose(berg.elements.u, u, atol=1e-5)
    np.testing.assert_allclose(berg.elements.v, v, atol=1e-5)


def test_bergs_of_an_experiment_turn_each_about_itself() -> None:
    """Both bergs of a collision turned about the middle between them."""
    plain, spun = collision().elements, change_berg(collision(), {"spin": 1e-5}).elements
    for name in np.unique(plain.berg):
        some = plain.berg == name
        share = plain.mass[some] / plain.mass[some].sum()
        for way in ("u", "v"):
            assert share @ getattr(spun, way)[some] == pytest.approx(share @ getattr(plain, way)[some], abs=1e-6)


def test_a_berg_that_is_turned_keeps_its_turning() -> None:
    """Positions were turned, and velocities were not: the rotation of A68a became a divergence."""
    turn, growth = flow(build("a68a", Options(changes={"berg": {"rotation": 90.0}}))[0])
    assert turn == pytest.approx(flow(build("a68a", Options())[0])[0], rel=1e-2)
    assert abs(growth) < 1e-8


@pytest.mark.parametrize("name", ["a68a", "a68a-melt"])
def test_the_density_of_the_ice_is_that_of_its_mass(name: str) -> None:
    """The draft followed `ice.density`, and the mass stayed that of 850 kg m-3."""
    e = build(name, Options(changes={"ice": {"density": 900.0}}))[0].elements
    assert e.mass / (e.thickness * e.length * e.width) == pytest.approx(900.0)


def test_a_change_of_one_berg_leaves_another_that_shares_an_alias(tmp_path: Path) -> None:
    """Sections that an alias of YAML shares were one object, and changed together."""
    (tmp_path / "x.yaml").write_text(
        "start: 2020-12-09\ndays: 1\nbergs:\n"
        "  - {rectangle: &r {length: 12 km, width: 6 km}, placement: [-38.5, -55]}\n"
        "  - {rectangle: *r, placement: [-37.5, -55]}\nforcing: {uniform: {}}\n"
    )
    found = read_file(tmp_path / "x.yaml", {"bergs": {"0.rectangle.length": 24e3}})[0]
    assert [berg.rectangle.length for berg in found.bergs] == [24e3, 12e3]


def test_a_grid_is_refused_where_no_file_needs_one(tmp_path: Path) -> None:
    """`--grid` did nothing with forcing by formula, and said so only of kind analytic."""
    file_model(tmp_path)
    with pytest.raises(InputError, match="needs no grid"):
        build(str(tmp_path / "x.yaml"), Options(grid=0.1))


STORY = """start: {start}
days: 1
berg: {{rectangle: {{length: 24 km, width: 12 km}}, placement: [-38.5, -55.1]}}
forcing: {{experiment: a68a}}
"""


def test_the_ocean_of_a_file_is_that_of_its_dates(tmp_path: Path) -> None:
    """A run that started on 15 December met the ocean of the 9th."""
    lon, lat = np.array([-38.5, -37.5]), np.array([-55.1, -56.0])
    (tmp_path / "x.yaml").write_text(STORY.format(start="2020-12-15 01:00"))
    model = build(str(tmp_path / "x.yaml"), Options())[0]
    assert model.forcing.currents(lon, lat, 3600.0) == pytest.approx(
        np.array(StoryOcean().currents(lon, lat, 3600.0 + 5.5 * 86400.0))
    )
    assert model.forcing.instant(0.0) == StoryOcean().instant(5.5 * 86400.0)
    assert "from 2020-12-15 01:00" in model.forcing.describe()
    (tmp_path / "x.yaml").write_text(STORY.format(start="2020-12-01"))
    with pytest.raises(InputError, match="begins on 2020-12-09 13:00, the run on 2020-12-01"):
        build(str(tmp_path / "x.yaml"), Options())
    with pytest.raises(InputError, match="counts its time from"):
        Model(
            Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-38.5, -55.1)),
            StoryOcean(),
            start=datetime(2020, 12, 15),
        )


def test_an_unknown_part_of_that_ocean_is_refused(tmp_path: Path) -> None:
    """A misspelt part of `forcing.without` was left in without a word."""
    (tmp_path / "x.yaml").write_text(STORY.format(start="2020-12-10").replace("a68a", "a68a, without: [shole]"))
    with pytest.raises(InputError, match="shole"):
        build(str(tmp_path / "x.yaml"), Options())


def test_each_berg_of_a_file_draws_strengths_of_its_own(tmp_path: Path) -> None:
    """Bergs with the same seed, that of the default too, had the same strengths bond by bond."""
    one = "{{rectangle: {{length: 12 km, width: 6 km}}, placement: [{}, -55], strength: {{weibull: 5{}}}}}"

    def strengths(*bergs: str) -> np.ndarray:
        (tmp_path / "x.yaml").write_text(
            "start: 2020-12-09\ndays: 1\nforcing: {uniform: {}}\nbergs:\n" + "".join(f"  - {b}\n" for b in bergs)
        )
        return build(str(tmp_path / "x.yaml"), Options())[0].bonds.strength.reshape(len(bergs), -1)

    alone, both = strengths(one.format(-38, ""))[0], strengths(one.format(-38, ""), one.format(-37, ""))
    assert (both[0] == alone).all()
    assert not (both[0] == both[1]).any()
    assert (strengths(one.format(-38, ""), one.format(-37, "")) == both).all()
    assert (strengths(one.format(-38, ", seed: 4"), one.format(-37, ""))[1] == alone).all()
