"""A step that fails is taken back with all that the scheme keeps, and what is found once is found anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import A68A_2022, A68A_2022_MTS, Forcing, Iceberg, Model

BED: dict[str, Any] = {"law": "seabed", "sediment": "sand"}


def slope() -> Forcing:
    """A slope that the berg has run up."""
    return Forcing.uniform((0.3, 0.0)) + Forcing.slope((-37.95, -56.0), 270, 0.01, 250.5)


def on_a_slope() -> Model:
    """A berg of four elements that runs aground."""
    berg = Iceberg.rectangle("6 km", "6 km", thickness="300 m", placement=(-38.0, -56.0), velocity=(0.3, 0.0))
    bed = {"law": "seabed", "sediment": "clay"}
    return Model(berg, slope(), A68A_2022.changed(grounding=bed, fracture={"enabled": False}))


def fails(model: Any) -> None:
    """Fail after a step."""
    raise RuntimeError("so it is")


def test_a_restart_after_a_failed_step_is_that_of_its_start(tmp_path: Path) -> None:
    """Gouges, their work and the bodies stayed those of the end of the failed step, in the file that says: go on."""
    whole, broken = on_a_slope(), on_a_slope()
    whole.step()
    broken.step()
    broken.after_step.append(fails)
    with pytest.raises(RuntimeError):
        broken.step()
    assert broken._stepper.plastic.tolist() == whole._stepper.plastic.tolist()
    resumed = Model.resume(broken.save(tmp_path / "restart.nc"), slope())
    resumed.step()
    whole.step()
    assert whole.elements.keel.floor_load.any()
    for name, values in whole._stepper.state_dict().items():
        np.testing.assert_array_equal(values, resumed._stepper.state_dict()[name], err_msg=name)


def test_forces_before_the_first_step_are_zero_for_each_element() -> None:
    """There was none, and the docstring promised zeros."""
    model = on_a_slope()
    assert model.applied_forces().shape == (model.elements.size, 8, 2)
    assert not model.applied_forces().any()


def test_a_berg_that_is_lifted_off_the_floor_is_afloat() -> None:
    """The load of the floor stayed on it as long as another berg was aground, 62 km away."""
    one, two = (Iceberg.rectangle("6 km", "6 km", thickness="300 m", placement=(lon, -56.0)) for lon in (-38.0, -37.0))
    sea = Forcing.uniform((0.05, 0.0), depth=248.3)
    model = Model(Iceberg.join([one, two]), sea, A68A_2022.changed(grounding=BED, fracture={"enabled": False}))
    model.step()
    el = model.elements
    thin = el.lon < -37.5
    assert el.keel.floor_load[thin].all()
    el.thickness[thin] *= 0.5
    el.mass[thin] *= 0.5
    model.step()
    keel = model.elements.keel
    assert not any(array[thin].any() for array in keel)
    assert keel.floor_load[~thin].all()


def test_a_bed_of_sediment_sees_the_sea_level_of_products() -> None:
    """The linear law counted it in the depth, and the bed did not: a berg floated over a floor 1.8 m above its keel."""
    lat, lon = np.linspace(-57, -55, 9), np.arange(-39.0, -36.01, 0.05)
    shape = (lat.size, lon.size)
    dates = np.array(["2020-12-09", "2021-12-09"], "datetime64[ns]")
    names = {
        "uo": (0.3, "eastward_sea_water_velocity", "m s-1"), "vo": (0.0, "northward_sea_water_velocity", "m s-1"),
        "deptho": (250.0, "sea_floor_depth_below_geoid", "m"),
    }  # fmt: skip
    ds = xr.Dataset(
        {
            name: (("lat", "lon"), np.full(shape, value), {"standard_name": standard, "units": units})
            for name, (value, standard, units) in names.items()
        },
        {
            "lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"}),
            "time": ("time", dates),
        },
    )  # fmt: skip
    ds["zos"] = (
        ("time", "lat", "lon"), np.full((2, *shape), -3.0),
        {"standard_name": "sea_surface_height_above_geoid", "units": "m"},
    )  # fmt: skip
    sea = Forcing.from_xarray(ds, start="2020-12-09 13:00", max_gap="400 d")
    assert sea.sea_level(np.array([-38.0]), np.array([-56.0]), 0.0).tolist() == [-3.0]
    berg = Iceberg.rectangle("6 km", "6 km", thickness="300 m", placement=(-38.0, -56.0))
    model = Model(berg, sea, A68A_2022.changed(grounding={**BED, "start": "refuse"}, fracture={"enabled": False}))
    with pytest.raises(Exception, match="below the sea floor"):
        model.step()


def test_a_floor_of_ones_own_is_asked_at_the_longitudes_of_the_berg() -> None:
    """Blocks are numbered round the sphere, and the floor was asked at 322 for a berg at 38 degrees west: there was no shoal."""
    asked: list[float] = []

    class Shoal(Forcing.uniform):
        def depth(self, lon: Any, lat: Any) -> Any:
            asked.extend(np.ravel(lon).tolist())
            return 400.0 - 151.7 * np.exp(-(((np.asarray(lon) + 38.0) / 0.5) ** 2))

        def sample(self, elements: Any, time: float) -> None:
            super().sample(elements, time)
            elements.depth[:] = self.depth(elements.lon, elements.lat)

    sea = Shoal(current=(0.05, 0.0), slope=(0.0, 0.0))
    berg = Iceberg.rectangle("6 km", "6 km", thickness="300 m", placement=(-38.0, -56.0))
    model = Model(berg, sea, A68A_2022.changed(grounding=BED, fracture={"enabled": False}))
    model.step()
    assert max(asked) < -30.0
    assert model.elements.keel.floor_load.any()


def test_another_bond_breaks_after_a_step_that_was_taken_back() -> None:
    """Bug: the list of bonded pairs was that of the step that had been taken back, where as many bonds were broken."""

    def velocities(*broken: int) -> np.ndarray:
        berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, radius=1500.0, placement=(-37.0, -56.0))
        sea = Forcing.uniform(current=(0.3, 0.1), wind=(10.0, -4.0), slope=(0.0, 0.0))
        model = Model(
            berg,
            sea,
            A68A_2022_MTS.changed(stepping={"scheme": "verlet", "time_step": 20.0}, fracture={"enabled": False}),
        )
        model.elements.u[:] += np.linspace(-0.05, 0.05, model.elements.size)
        model.advance(steps=2)
        take_back = model.checkpoint()
        for bond in broken:
            take_back()
            model.bonds.status[bond] = 1
            model.advance(steps=4)
        return np.array([model.elements.u, model.elements.v])

    alone = velocities(2)
    assert (velocities(0, 2) == alone).all()
    assert (velocities(0) != alone).any()
