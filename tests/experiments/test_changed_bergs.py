"""What a user changes of a berg changes all that belongs to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Iceberg, Model
from riftberg.ensembles.uncertain import with_errors
from riftberg.errors import InputError
from riftberg.experiments import build
from riftberg.experiments.registry import Options
from riftberg.experiments.yaml_file import read_file
from riftberg.plane import EqualAreaPlane

FILE = """start: 2020-12-09 13:00
days: 1
berg: {{rectangle: {{length: 24 km, width: 12 km}}, placement: [-38.5, -55.1], thickness: 200{more}}}
forcing: {{kind: constant, current: [0, 0]}}
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
    turn, growth = flow(file_model(tmp_path, ", spin: 3e-5"))
    assert turn == pytest.approx(3e-5, rel=5e-3)  # local axes of the elements
    assert abs(growth) < 1e-8


def test_each_of_several_pieces_turns_about_its_own_centre() -> None:
    """Pieces are bergs of their own; one of a single element has no velocity by its spin."""
    x, y = np.array([0.0, 2e3, 50e3]), np.zeros(3)
    e = Iceberg.from_points(x, y, thickness=200.0, radius=1e3, spin=1e-4, latlon=False).elements
    assert e.v.tolist() == pytest.approx([-0.1, 0.1, 0.0], abs=1e-12)
    assert not e.u.any()


def test_a_berg_that_is_turned_keeps_its_turning() -> None:
    """Positions were turned, and velocities were not: the rotation of A68a became a divergence."""
    turn, growth = flow(build("a68a", Options(changes={"berg": {"rotation": 90.0}}))[0])
    assert turn == pytest.approx(flow(build("a68a", Options())[0])[0], rel=1e-2)
    assert abs(growth) < 1e-8


@pytest.mark.parametrize("name", ["a68a", "a68a-melt", "grounding-fracture"])
def test_the_density_of_the_ice_is_that_of_its_mass(name: str) -> None:
    """The draft followed `ice.density`, and the mass stayed that of 850 kg m-3."""
    e = build(name, Options(changes={"ice": {"density": 900.0}}))[0].elements
    assert e.mass / (e.thickness * e.length * e.width) == pytest.approx(900.0)


def test_a_change_of_one_berg_leaves_another_that_shares_an_alias(tmp_path: Path) -> None:
    """Sections that an alias of YAML shares were one object, and changed together."""
    (tmp_path / "x.yaml").write_text(
        "start: 2020-12-09\ndays: 1\nbergs:\n"
        "  - {rectangle: &r {length: 12 km, width: 6 km}, placement: [-38.5, -55]}\n"
        "  - {rectangle: *r, placement: [-37.5, -55]}\nforcing: {kind: constant}\n"
    )
    found = read_file(tmp_path / "x.yaml", {"bergs": {"0.rectangle.length": 24e3}})[0]
    assert [berg.rectangle.length for berg in found.bergs] == [24e3, 12e3]


def test_a_grid_is_refused_where_no_file_needs_one(tmp_path: Path) -> None:
    """`--grid` did nothing with forcing by formula, and said so only of kind analytic."""
    file_model(tmp_path)
    with pytest.raises(InputError, match="needs no grid"):
        build(str(tmp_path / "x.yaml"), Options(grid=0.1))


def test_thicker_members_get_the_current_over_their_draft(tmp_path: Path) -> None:
    """Levels were cut at the keel of the berg as it is in the file, and members thicker than that failed."""
    depth = np.array([0.5, 50.0, 100.0, 150.0, 175.0, 200.0, 300.0, 400.0])
    lon, lat = np.linspace(-40.0, -37.0, 7), np.linspace(-56.0, -54.0, 5)
    u = np.broadcast_to(np.where(depth < 187.0, 0.1, 0.5)[:, None, None], (depth.size, lat.size, lon.size))
    xr.Dataset(
        {
            "uo": (
                ("depth", "latitude", "longitude"),
                u,
                {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"},
            ),
            "vo": (
                ("depth", "latitude", "longitude"),
                0.0 * u,
                {"units": "m s-1", "standard_name": "northward_sea_water_velocity"},
            ),
        },
        {
            "depth": ("depth", depth, {"units": "m", "positive": "down", "standard_name": "depth"}),
            "latitude": ("latitude", lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "longitude": ("longitude", lon, {"units": "degrees_east", "standard_name": "longitude"}),
        },
    ).to_netcdf(tmp_path / "levels.nc")
    text = FILE.format(more="").replace(
        "{kind: constant, current: [0, 0]}", "{kind: files, files: [levels.nc], sea_level: none, wind: none}"
    )
    (tmp_path / "x.yaml").write_text(text)
    model = build(str(tmp_path / "x.yaml"), Options())[0]
    thick = with_errors(model, {"start.thickness": 1.5})
    thick.check(1.0)
    thick.forcing.sample(thick.elements, 0.0)
    assert 0.12 < thick.elements.uo.mean() < 0.3
    model.forcing.sample(model.elements, 0.0)
    assert model.elements.uo.mean() == pytest.approx(0.1)
