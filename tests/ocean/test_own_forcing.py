"""What a run may ask of a forcing: declared once, answered by every kind, and by an object of another class as far as it can."""

from __future__ import annotations

import pickle
from datetime import datetime
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Forcing, Iceberg, Model
from riftberg.errors import InputError
from riftberg.ocean.errors import Errors, UncertainForcing
from riftberg.ocean.forcing import Forcing as AnyForcing

POINTS = np.array([-37.0, -36.9]), np.array([-56.0, -56.1])
BERG = Iceberg.rectangle("6 km", "6 km", thickness="200 m", placement=(-37.0, -56.0))


class Brook:
    """A forcing that knows nothing of Riftberg's classes: what it has is read, the rest holds without an answer."""

    citations = ("Nobody (2001).",)

    def sample(self, elements: Any, time: float) -> None:
        elements.environment.uo[:] = 0.2
        elements.environment.depth[:] = 300.0

    def currents(self, lon: Any, lat: Any, time: float) -> tuple[Any, Any]:
        return np.full(np.shape(lon), 0.2), np.zeros(np.shape(lon))

    def depth(self, lon: Any, lat: Any) -> Any:
        return np.where(np.asarray(lon) < -36.95, 300.0, -10.0)


def product() -> Any:
    """Return currents, sea level and depth of one dataset."""
    lat, lon = np.linspace(-57, -55, 9), np.linspace(-39, -35, 17)
    shape = lat.size, lon.size
    fields = {
        "uo": (0.1, "eastward_sea_water_velocity", "m s-1"), "vo": (0.0, "northward_sea_water_velocity", "m s-1"),
        "zos": (-0.6, "sea_surface_height_above_geoid", "m"), "deptho": (180.0, "sea_floor_depth_below_geoid", "m"),
    }  # fmt: skip
    ds = xr.Dataset(
        {n: (("lat", "lon"), np.full(shape, v), {"standard_name": s, "units": u}) for n, (v, s, u) in fields.items()},
        {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})},
    )
    return Forcing.from_xarray(ds, start="2020-12-09")


KINDS = {
    "formula": lambda: Forcing.uniform((0.1, 0.0)),
    "tide": lambda: Forcing.tide(0.2, level=0.5),
    "sum": lambda: Forcing.uniform((0.1, 0.0)) + Forcing.seamount((-37.0, -56.0), 100.0, 5e3, depth=400.0),
    "product": product,
    "product and formula": lambda: product() + Forcing.uniform(wind=(5.0, 0.0)),
    "errors": lambda: UncertainForcing(product(), Errors(seed=3), BERG.elements),
    "another class": lambda: Model(BERG, Brook()).forcing,
    "another class and a formula": lambda: Forcing.uniform(wind=(5.0, 0.0)) + Brook(),  # type: ignore[operator]
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_answers_all_that_a_run_may_ask(kind: str) -> None:
    sea: AnyForcing = KINDS[kind]()
    assert isinstance(sea, AnyForcing)
    u, v = sea.currents(*POINTS, 0.0)
    depth, level, land = sea.depth(*POINTS), sea.sea_level(*POINTS, 0.0), sea.land(*POINTS)
    assert [np.shape(each) for each in (u, v, depth, level, land)] == [(2,)] * 5
    assert land.dtype == bool
    assert sea.start is None or isinstance(sea.start, datetime)
    assert sea.given is True
    assert isinstance(sea.provides, frozenset)
    assert all(
        isinstance(text, str) for text in (*sea.notices, *sea.citations, *sea.slope_remarks, sea.title, sea.level_gaps)
    )
    assert sea.has_own_level_datum == kind.startswith(("product", "errors"))
    assert sea.depth_spacing() is None or sea.depth_spacing() > 1e3
    assert len(sea.components()) >= 1
    assert type(sea).__name__ in repr(sea)
    model = Model(BERG, sea)
    model.step()
    assert np.isfinite(model.elements.lon).all()


def test_an_object_of_another_class_is_asked_for_what_it_has() -> None:
    sea = Model(BERG, Brook()).forcing  # type: ignore[arg-type]
    assert sea.citations == ("Nobody (2001).",)
    assert sea.depth(*POINTS).tolist() == [300.0, -10.0]
    assert sea.land(*POINTS).tolist() == [False, True]  # by its own depth
    assert pickle.loads(pickle.dumps(sea)).depth(*POINTS).tolist() == [300.0, -10.0]
    with pytest.raises(InputError, match="is no forcing"):
        Model(BERG, object())  # type: ignore[arg-type]


def test_what_changes_a_forcing_answers_for_it_in_all_else() -> None:
    inside = product() + Forcing.tide(0.1, level=0.25)
    around = UncertainForcing(inside, Errors(seed=1), BERG.elements)
    assert around.start == datetime(2020, 12, 9)
    assert around.provides == inside.provides
    assert around.sea_level(*POINTS, 0.0).tolist() == inside.sea_level(*POINTS, 0.0).tolist()
    assert np.abs(around.sea_level(*POINTS, 0.0)).max() > 0.3
