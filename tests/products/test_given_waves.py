"""Waves of a file push the berg: with their significant height, along their own direction, in every scheme."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from contract import FORCES
from products.test_odd_files import AIR, CENTRE, START, elements, plain, truth, written
from riftberg import DatasetForcing, Iceberg, Model, Parameters
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, _coarse, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.runs.restart import load_state
from twins import waves as twin

HEIGHT, PERIOD = (6.0, 0.4, 0.3), (11.0, 0.5, 0.2)
FROM = 200.0
"""Bearing (degrees) from which the waves come: they travel to the north-north-east."""


def linear(law: tuple[float, float, float], lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    return law[0] + law[1] * (lon - CENTRE) + law[2] * (lat + 55.5)


def with_waves(names: tuple[str, ...] = ("uo", "vo"), **bearing: float) -> xr.Dataset:
    """Currents with linear waves beside them that come from one side."""
    ds = plain(names=names)
    x, y = np.meshgrid(ds["lon"], ds["lat"])
    told = {
        "VHM0": ("sea_surface_wave_significant_height", "m", linear(HEIGHT, x, y)),
        "VTM10": ("sea_surface_wave_mean_period", "s", linear(PERIOD, x, y)),
        "VMDR": ("sea_surface_wave_from_direction", "degree", np.full(x.shape, bearing.get("coming", FROM))),
    }
    for name, (said, units, values) in told.items():
        ds[name] = ("time", "lat", "lon"), np.stack([values] * 4), {"standard_name": said, "units": units}
    return ds


def forced(folder: Path, ds: xr.Dataset, *, melts: bool = False, **others: object) -> DatasetForcing:
    path = written(folder, ds)
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 24.0}
    asked = FileForcing(kind="files", files=[path.name], **box, **others)
    return forcing_from_files(asked, folder, Run.of(START, 0.1, np.full(9, 200.0), 850.0, melts=melts))


def travel(e) -> np.ndarray:
    size = np.hypot(e.wave_x, e.wave_y)
    return np.stack([e.wave_x / size, e.wave_y / size])


@pytest.mark.parametrize("way", ["run", "model grid", "python"])
def test_height_period_and_direction_arrive_at_the_berg(tmp_path: Path, way: str) -> None:
    e, ds = elements(), with_waves()
    if way == "python":
        forcing = DatasetForcing.from_xarray(ds, START)
    else:
        forcing = forced(tmp_path, ds, **({"spacing": 0.25} if way == "model grid" else {}))
    forcing.check(e, 0.0, 8640.0)
    forcing.sample(e, 3600.0)
    np.testing.assert_allclose(e.wave_height, linear(HEIGHT, e.lon, e.lat), atol=1e-5)
    np.testing.assert_allclose(e.wave_period, linear(PERIOD, e.lon, e.lat), atol=1e-5)
    expected = np.array([-np.sin(np.deg2rad(FROM)), -np.cos(np.deg2rad(FROM))])
    np.testing.assert_allclose(travel(e), np.repeat(expected[:, None], 9, axis=1), atol=1e-6)
    assert not any("wave" in text for text in forcing.notices)


def test_directions_are_interpolated_across_north(tmp_path: Path) -> None:
    ds = with_waves()
    across = np.where(ds["lon"] > CENTRE + 0.25, 10.0, 350.0)
    ds["VMDR"] = (ds["VMDR"] * 0.0 + across[None, None, :]).assign_attrs(ds["VMDR"].attrs)
    e = elements()
    e.lon[:] = CENTRE + 0.25
    forced(tmp_path, ds).sample(e, 0.0)
    np.testing.assert_allclose(travel(e)[1], -1.0, atol=1e-6)


def test_means_of_blocks_have_the_direction_of_the_mean_of_unit_vectors() -> None:
    angles = [[350.0, 10.0, 80.0, 130.0], [350.0, 10.0, 80.0, 130.0]]
    ds = xr.Dataset({"wave_direction": (("lat", "lon"), angles, {"units": "degree"})})
    found = _coarse(ds, {"lat": 2, "lon": 2})["wave_direction"]
    np.testing.assert_allclose((found.values + 90.0) % 360.0 - 90.0, [[0.0, 105.0]], atol=1e-9)
    assert found.attrs == {"units": "degree"}


@pytest.mark.parametrize(
    ("said", "units", "value"),
    [
        ("sea_surface_wave_to_direction", "degree", FROM - 180.0),
        ("sea_surface_wave_from_direction", "degree", FROM - 360.0),
        ("sea_surface_wave_from_direction", "radian", np.deg2rad(FROM)),
        ("sea_surface_wave_to_direction", "radians", np.deg2rad(FROM - 180.0)),
    ],
)
def test_a_direction_is_that_which_its_name_says(tmp_path: Path, said: str, units: str, value: float) -> None:
    ds = with_waves(coming=value)
    ds["VMDR"].attrs = {"standard_name": said, "units": units}
    e = elements()
    forced(tmp_path, ds).sample(e, 0.0)
    np.testing.assert_allclose(np.rad2deg(np.arctan2(-e.wave_x, -e.wave_y)) % 360.0, FROM, atol=1e-6)


SCHEMES = {
    "verlet": {"scheme": "verlet", "time_step": 5.0},
    "runge_kutta": {"scheme": "runge_kutta", "time_step": 5.0},
    "mts": {"scheme": "mts"},
    "quasi_static": {"scheme": "quasi_static"},
}


def one_berg() -> Iceberg:
    return Iceberg.rectangle(6e3, 4e3, thickness=200.0, placement=(CENTRE, -55.5), radius=1000.0, packing="square")


def pushes(model: Model) -> np.ndarray:
    return model.applied_forces()[:, FORCES.index("waves")]


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("period", [True, False])
def test_the_force_in_every_scheme_is_that_of_the_given_waves(scheme: str, period: bool) -> None:
    """Height 6 m, 11 s, from the south-south-west, against a wind from the north-west that would push elsewhere."""
    ds = with_waves(("uo", "vo", *AIR))
    ds = ds if period else ds.drop_vars("VTM10")
    asked = Parameters(stepping={"time_step": 600.0, **SCHEMES[scheme]}, fracture={"enabled": False})
    model = Model(one_berg(), DatasetForcing.from_xarray(ds, START), asked)
    model.advance(steps=2)  # the first one of mts begins with half a kick
    e, got = model.elements, pushes(model)
    freeboard = 200.0 * (1.0 - 850.0 / 1025.0)
    way = (-np.sin(np.deg2rad(FROM)), -np.cos(np.deg2rad(FROM)))
    for k in range(e.size):
        height = linear(HEIGHT, e.lon[k], e.lat[k])
        law = twin.acceleration_by_given(
            height,
            linear(PERIOD, e.lon[k], e.lat[k]) if period else None,
            way,
            e.mass[k],
            freeboard,
            6e3,
            4e3,
        )
        # The waves push the berg; each element bears its part of the sides: 2 of 10 at a corner, 1 in the middle of a side.
        share = 0.2 if e.bond_count[k] == 2 else 0.1
        np.testing.assert_allclose(got[k], share * e.mass[k] * law, rtol=2e-3)


def test_waves_as_high_as_those_of_the_wind_push_alike() -> None:
    ds = plain(names=("uo", "vo", *AIR))
    speed = np.hypot(truth("ua", CENTRE, -55.5) * 3.0, truth("va", CENTRE, -55.5) * 3.0)
    for name in ("uo", "vo", *AIR):
        ds[name] = (ds[name] * 0.0 + (0.0 if name in ("uo", "vo") else 3.0 * truth(name, CENTRE, -55.5))).assign_attrs(
            ds[name].attrs
        )
    given = ds.assign(
        hs=(ds["ua"] * 0.0 + 0.02025 * speed**2).assign_attrs(
            standard_name="sea_surface_wave_significant_height", units="m"
        ),
        mwd=(np.rad2deg(np.arctan2(-ds["ua"], -ds["va"]))).assign_attrs(
            standard_name="sea_surface_wave_from_direction", units="degree"
        ),
    )
    own, of_file = (
        Model(one_berg(), DatasetForcing.from_xarray(each, START), Parameters(stepping={"time_step": 600.0}))
        for each in (ds, given)
    )
    for model in (own, of_file):
        model.advance(steps=2)
    np.testing.assert_allclose(pushes(of_file), pushes(own), rtol=1e-9)


def test_swell_pushes_in_a_calm_and_small_pieces_ride_long_waves(tmp_path: Path) -> None:
    small = twin.acceleration_by_given(4.0, 14.0, (1.0, 0.0), 1e9, 30.0, 40.0, 40.0)[0]
    short = twin.acceleration_by_given(4.0, 5.0, (1.0, 0.0), 1e9, 30.0, 40.0, 40.0)[0]
    assert small < 0.1 * short
    model = Model(
        one_berg(), DatasetForcing.from_xarray(with_waves(), START), Parameters(stepping={"time_step": 600.0})
    )
    model.advance(steps=1)
    assert (pushes(model)[:, 1] > 0.0).all()


def test_waves_missing_in_sea_ice_are_none_and_stop_no_run(tmp_path: Path) -> None:
    """ERA5 has no waves where there is ice: not those of the wind, which would push a berg in pack ice."""
    ds = with_waves(("uo", "vo", *AIR))
    for name in ("VHM0", "VTM10", "VMDR"):
        ds[name] = ds[name].where(False)
    forcing, e = forced(tmp_path, ds), elements()
    forcing.check(e, 0.0, 8640.0)
    forcing.sample(e, 0.0)
    assert (e.wave_height == 0.0).all()


def test_without_given_waves_they_follow_from_the_wind(tmp_path: Path) -> None:
    e = elements()
    forced(tmp_path, with_waves()).sample(e, 0.0)
    forced(tmp_path, plain(names=("uo", "vo"))).sample(e, 0.0)
    assert (e.wave_height < 0.0).all()


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("left", "words"),
    [
        (("VHM0",), "wave_height not used"),
        (("VHM0", "VTM10"), "wave_height, wave_period not used"),
        (("VMDR",), "wave_direction not used"),
    ],
)
def test_half_of_what_waves_need_is_told(tmp_path: Path, left: tuple[str, ...], words: str) -> None:
    ds = with_waves()
    ds = ds.drop_vars([name for name in ("VHM0", "VTM10", "VMDR") if name not in left])
    forcing, e = forced(tmp_path, ds), elements()
    assert [text for text in forcing.notices if words in text and "follow from the wind" in text]
    forcing.sample(e, 0.0)
    assert (e.wave_height < 0.0).all()
    assert words in "\n".join(DatasetForcing.from_xarray(ds, START).notices)
    assert words in doctor([tmp_path / "odd.nc"], needed=()).text()


@pytest.mark.parametrize("part", ["sea_surface_swell_wave", "sea_surface_wind_wave", "sea_surface_primary_swell_wave"])
def test_a_part_of_the_sea_state_is_not_taken_for_the_whole(tmp_path: Path, part: str) -> None:
    ds = with_waves().rename(VHM0="VHM0_SW1").drop_vars("VTM10")
    ds["VHM0_SW1"].attrs["standard_name"] = f"{part}_significant_height"
    ds["VMDR"].attrs["standard_name"] = f"{part}_from_direction"
    forcing = forced(tmp_path, ds)
    assert "no sea state is taken from this file; not read: VHM0_SW1" in "\n".join(forcing.notices)


def test_melt_by_waves_still_follows_from_the_wind_and_that_is_told(tmp_path: Path) -> None:
    assert "what waves melt follows from the wind" in "\n".join(forced(tmp_path, with_waves(), melts=True).notices)


def test_of_two_files_of_waves_the_later_gives_all_of_them(tmp_path: Path) -> None:
    """The period of one set of waves is never put beside the height of another."""
    with_waves().to_netcdf(tmp_path / "first.nc")
    later = with_waves(())
    later = later.drop_vars("VTM10").assign(VHM0=(2.0 * later["VHM0"]).assign_attrs(later["VHM0"].attrs))
    later.isel(lat=slice(1, None)).to_netcdf(tmp_path / "later.nc")
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 24.0}
    asked = FileForcing(kind="files", files=["first.nc", "later.nc"], **box)
    e = elements()
    forcing_from_files(asked, tmp_path, Run.of(START, 0.1, e.thickness, 850.0)).sample(e, 0.0)
    np.testing.assert_allclose(e.wave_height, 2.0 * linear(HEIGHT, e.lon, e.lat), atol=1e-5)
    assert (e.wave_period == 0.0).all()


def test_a_restart_keeps_the_waves(tmp_path: Path) -> None:
    forcing = DatasetForcing.from_xarray(with_waves(), START)
    model = Model(one_berg(), forcing, Parameters(stepping={"time_step": 600.0, "scheme": "mts"}))
    model.advance(steps=1)
    model.save(tmp_path / "a.restart.nc")
    kept = load_state(tmp_path / "a.restart.nc").elements
    assert (kept.wave_height > 4.0).all()
    np.testing.assert_array_equal(kept.wave_height, model.elements.wave_height)
