"""Files that mean something else than they seem to: right, refused for the true reason, or told before the run."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from products.test_odd_files import (
    CENTRE,
    FIELDS,
    MAPS,
    START,
    arrives,
    elements,
    on_level,
    on_map,
    plain,
    refused,
    truth,
    written,
)
from riftberg import DatasetForcing, open_product
from riftberg.constants import EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import recognise

BOX = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 24.0}


def forcing_of(folder: Path, *names: str, melts: bool = False) -> DatasetForcing:
    asked = FileForcing(kind="files", files=list(names), **BOX)
    return forcing_from_files(asked, folder, Run.of(START, 0.1, np.full(9, 200.0), 850.0, melts=melts))


def told(folder: Path, ds: xr.Dataset, *words: str, melts: bool = False) -> DatasetForcing:
    """Return the forcing of a file about which one line of a run has all of these words, and one of Python as well."""
    forcing = forcing_of(folder, written(folder, ds).name, melts=melts)
    assert [line for line in forcing.notices if all(word in line for word in words)], forcing.notices
    return forcing


def not_told(folder: Path, ds: xr.Dataset, word: str) -> None:
    assert not [line for line in forcing_of(folder, written(folder, ds).name).notices if word in line]


# --- which way is up ----------------------------------------------------------------------------------------------------


def with_floor(name: str, standard_name: str, values: Any, **attributes: str) -> xr.Dataset:
    ds = plain(names=("uo", "vo"))
    x, y = np.meshgrid(ds["lon"], ds["lat"])
    given = {"units": "m", **({"standard_name": standard_name} if standard_name else {}), **attributes}
    ds[name] = ("lat", "lon"), values(x, y), given
    return ds


def depth(x: Any, y: Any) -> Any:
    return truth("deptho", x, y)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "said", "more", "is_told"),
    [
        ("elevation", "geoid_height_above_reference_ellipsoid", {}, True),
        ("elevation", "sea_surface_height_above_mean_sea_level", {}, True),
        ("elevation", "height_above_mean_sea_level", {}, False),
        ("bathymetry", "", {"positive": "up"}, False),
        ("deptho", "sea_floor_depth_below_geoid", {"positive": "Up"}, True),
    ],
)
def test_a_height_is_turned_into_a_depth_whatever_its_standard_name(
    tmp_path: Path, name: str, said: str, more: dict[str, str], is_told: bool
) -> None:
    """EMODnet calls the height of the ground a geoid height: depths came out as 1748 m above the water."""
    ds = with_floor(name, said, lambda x, y: np.where(x > CENTRE + 3.2, 92.0, -depth(x, y)), **more)
    e = elements()
    forcing = forcing_of(tmp_path, written(tmp_path, ds).name)
    forcing.check(e, 0.0, 8640.0)
    forcing.sample(e, 0.0)
    np.testing.assert_allclose(e.depth, depth(e.lon, e.lat), rtol=1e-5)
    assert any("is taken as a height, positive up" in line for line in forcing.notices) == is_told


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "said", "more"),
    [
        ("deptho", "sea_floor_depth_below_geoid", {}),
        ("bathymetry", "", {"long_name": "bathymetry"}),
        ("depth_below_surface", "sea_floor_depth_below_sea_level", {"positive": "down"}),
        ("floor", "sea_floor_depth_below_mean_sea_level", {}),
    ],
)
def test_depths_stored_negative_are_refused_and_the_doctor_doubts_them(
    tmp_path: Path, name: str, said: str, more: dict[str, str]
) -> None:
    """With a little land in the box, which is positive then, such files were taken as they stood."""
    ds = with_floor(name, said, lambda x, y: np.where(x > CENTRE + 1.4, 92.0, -depth(x, y)), **more)
    with pytest.raises(ForcingError, match=r"it looks like a height, positive up"):
        forcing_of(tmp_path, written(tmp_path, ds).name).check(elements(), 0.0, 8640.0)
    with pytest.raises(ForcingError, match=r"it looks like a height, positive up"):
        DatasetForcing.from_xarray(ds, START).check(elements(), 0.0, 8640.0)
    assert "it looks like a height" in doctor([tmp_path / "odd.nc"], needed=()).text()


def test_a_berg_where_the_depth_is_negative_is_told_the_number(tmp_path: Path) -> None:
    """Mountains higher than the water is deep do not show that the sign is wrong; the berg does."""
    ds = with_floor("bathymetry", "", lambda x, y: np.where(x > CENTRE + 1.4, 2900.0, -300.0))
    with pytest.raises(
        ForcingError,
        match=r"is on land: no depth_below_surface but -300 m is known there, or these are heights.*on bathymetry",
    ):
        forcing_of(tmp_path, written(tmp_path, ds).name).check(elements(), 0.0, 8640.0)
    land = with_floor("bathymetry", "", lambda x, y: np.where(x < CENTRE + 1.4, np.nan, 2900.0))
    with pytest.raises(ForcingError, match="is on land: no depth_below_surface is known there"):
        forcing_of(tmp_path, written(tmp_path, land).name).check(elements(), 0.0, 8640.0)


def test_depths_with_land_below_zero_are_still_read(tmp_path: Path) -> None:
    ds = with_floor(
        "deptho", "sea_floor_depth_below_geoid", lambda x, y: np.where(x > CENTRE + 1.4, -800.0, depth(x, y))
    )
    e, forcing = elements(), forcing_of(tmp_path, written(tmp_path, ds).name)
    forcing.check(e, 0.0, 8640.0)
    forcing.sample(e, 0.0)
    np.testing.assert_allclose(e.depth, depth(e.lon, e.lat), rtol=1e-5)


# --- fields without units, or with those of others ----------------------------------------------------------------------


@pytest.mark.quick(3)
@pytest.mark.parametrize("names", [("uo", "vo"), ("ua", "va"), ("ssh",), ("ice_thickness",)])
@pytest.mark.parametrize("keeps", ["standard_name", "nothing"])
def test_fields_without_units_are_refused_by_name(tmp_path: Path, names: tuple[str, ...], keeps: str) -> None:
    """Currents in knots were taken as metres per second of the A68a experiment, whose files have no units."""
    ds = plain(names=tuple({"uo": 0, "vo": 0, **dict.fromkeys(names, 0)}))
    for name in names:
        ds[name].attrs = {"standard_name": FIELDS[name][0]} if keeps == "standard_name" else {}
    refused(written(tmp_path, ds), "the file gives no units", "If it is in ")


def test_a_file_of_currents_alone_without_units_is_not_that_of_the_experiment(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    for name in ("uo", "vo"):
        ds[name].attrs = {}
    for name in ("odd.nc", "currents_hourly.nc", "my_a68a_currents.nc"):
        ds.to_netcdf(tmp_path / name)
        assert recognise(tmp_path / name).name == "cf"
    ds.isel(time=0, drop=True).to_netcdf(tmp_path / "a68_experiment_ocean_dec2020.nc")
    assert recognise(tmp_path / "a68_experiment_ocean_dec2020.nc").name == "a68a"


def test_waves_without_units_are_refused(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    ds["VHM0"] = ds["uo"] * 0.0 + 3.0
    ds["VHM0"].attrs = {"standard_name": "sea_surface_wave_significant_height"}
    refused(written(tmp_path, ds), "the file gives no units for wave_height")


def test_units_that_a_product_is_known_for_are_told_where_its_file_lacks_them(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    y, x = xr.broadcast(ds["lat"], ds["lon"])
    nemo = ds.rename(lat="y", lon="x").drop_vars(["y", "x"])
    nemo = nemo.assign_coords(
        nav_lat=(("y", "x"), y.values, {"units": "degrees_north"}),
        nav_lon=(("y", "x"), x.values, {"units": "degrees_east"}),
    )
    for name in ("uo", "vo"):
        nemo[name].attrs.pop("units")
    told(tmp_path, nemo, "uo has no units in the file: m s-1 is taken, as nemo writes it")


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("names", "units", "words"),
    [
        (("ice_fraction",), "%", "are these shares of 1?"),
        (("ice_fraction",), "percent", "are these shares of 1?"),
        (("uo", "vo"), "cm/s", "are these m s-1?"),
        (("ua", "va"), "cm s-1", "are these m s-1?"),
        (("ssh",), "cm", "are these m?"),
        (("ice_thickness",), "cm", "are these m?"),
    ],
)
def test_numbers_too_small_for_their_unit_are_told(
    tmp_path: Path, names: tuple[str, ...], units: str, words: str
) -> None:
    """Shares of 1 under per cent came in as a hundredth of the ice, metres under cm as a hundredth of the slope."""
    ds = plain(names=tuple({"uo": 0, "vo": 0, "ice_thickness": 0, **dict.fromkeys(names, 0)}))
    for name in names:
        ds[name].attrs["units"] = units
    told(tmp_path, ds, f"{names[0]} is at most", units, words)
    assert words in "\n".join(DatasetForcing.from_xarray(ds, START).notices)
    assert words in doctor([tmp_path / "odd.nc"]).text()
    for name in names:
        ds[name] = (100.0 * ds[name]).assign_attrs(ds[name].attrs)
    not_told(tmp_path, ds, words)


def test_shares_that_are_per_cent_are_refused_as_such(tmp_path: Path) -> None:
    ds = plain()
    ds["ice_fraction"] = (100.0 * ds["ice_fraction"]).assign_attrs(ds["ice_fraction"].attrs)
    refused(written(tmp_path, ds), "it looks like per cent, and the file does not say so")


# --- heights of the sea above something else ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("sea_surface_height_above_reference_ellipsoid", "height"),
        ("geoid_height_above_reference_ellipsoid", "geoid"),
        ("", "sea surface height above the WGS84 ellipsoid"),
        ("sea_surface_height", "Sea level relative to the TOPEX ellipsoid"),
    ],
)
def test_a_sea_level_above_the_ellipsoid_moves_nothing(tmp_path: Path, said: str, words: str) -> None:
    """The slope of the geoid, some metres in 100 km, drove the berg."""
    ds = plain(names=("uo", "vo", "ssh"))
    ds["ssh"].attrs = {"units": "m", "long_name": words, **({"standard_name": said} if said else {})}
    forcing, e = told(tmp_path, ds, "ssh is", "which is none of these"), elements()
    forcing.sample(e, 0.0)
    balanced = -2.0 * EARTH_ROTATION * np.sin(np.radians(e.lat)) * e.uo / GRAVITY
    np.testing.assert_allclose(e.slope_y, balanced, rtol=0.1)
    assert forcing.assumes_slope


def test_a_sea_level_above_the_ellipsoid_of_a_known_product_is_refused(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "ssh"))
    y, x = xr.broadcast(ds["lat"], ds["lon"])
    ds = (
        ds.rename(lat="y", lon="x")
        .drop_vars(["y", "x"])
        .assign_coords(
            nav_lat=(("y", "x"), y.values, {"units": "degrees_north"}),
            nav_lon=(("y", "x"), x.values, {"units": "degrees_east"}),
        )
    )
    ds["ssh"].attrs["standard_name"] = "sea_surface_height_above_reference_ellipsoid"
    with pytest.raises(ForcingError, match=r"ssh is the height of the sea above the ellipsoid.*Subtract the geoid"):
        open_product(written(tmp_path, ds))


def test_a_topography_that_names_the_geoid_is_taken(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "ssh"))
    ds["ssh"].attrs["long_name"] = "sea surface height above the geoid (heights above the ellipsoid less the geoid)"
    arrives(written(tmp_path, ds), ("uo", "vo", "ssh"))


# --- map projections without a radius -----------------------------------------------------------------------------------

LOST = ("crs_wkt", "semi_major_axis", "semi_minor_axis", "inverse_flattening", "reference_ellipsoid_name", "earth_radius",
        "geographic_crs_name", "horizontal_datum_name", "prime_meridian_name", "longitude_of_prime_meridian")  # fmt: skip
SPHERES = {
    "Lambert": MAPS["Lambert"],
    "polar stereographic": "+proj=stere +lat_0=-90 +lat_ts=-71 +lon_0=0 +R=6371000",
    "transverse Mercator": "+proj=tmerc +lon_0=-30 +lat_0=-50 +R=6370997",
}


def without_radius(name: str, *, positions: bool, **more: str) -> xr.Dataset:
    ds = on_map(name, mapping=True, positions=positions, flipped=False)
    ds["crs"].attrs = {key: value for key, value in ds["crs"].attrs.items() if key not in LOST} | more
    return ds


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", SPHERES)
def test_without_a_radius_the_positions_of_the_file_count(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """WGS84 was taken, 7 to 11 km beside the latitudes and longitudes in the same file."""
    monkeypatch.setitem(MAPS, name, SPHERES[name])
    path = written(tmp_path, without_radius(name, positions=True))
    arrives(path, ("uo", "vo"), near=1e-4)
    notices = "\n".join(forcing_of(tmp_path, path.name).notices)
    assert "km from its projection, whose radius of the Earth is not given" in notices


def test_without_a_radius_a_fine_grid_is_not_called_wrong(tmp_path: Path) -> None:
    """Cells smaller than the distance of the two Earths were refused: the grid mapping was 'wrong or missing'."""
    coarse = without_radius("Lambert", positions=True)
    fine = coarse.interp(
        x=np.linspace(*coarse["x"].values[[8, 32]], 121), y=np.linspace(*coarse["y"].values[[8, 32]], 121)
    )
    for name in fine.variables:
        fine[name].attrs = coarse[name].attrs
    forcing, e = forcing_of(tmp_path, written(tmp_path, fine).name), elements()
    forcing.sample(e, 0.0)
    np.testing.assert_allclose(e.uo, truth("uo", e.lon, e.lat), atol=1e-3)


def test_without_a_radius_a_text_that_has_one_counts(tmp_path: Path) -> None:
    """HIRLAM names its sphere in the attribute proj4 alone."""
    ds = without_radius("Lambert", positions=False, proj4=MAPS["Lambert"])
    path = written(tmp_path, ds)
    arrives(path, ("uo", "vo"), near=1e-4)
    assert "radius" not in "\n".join(forcing_of(tmp_path, path.name).notices)


def test_without_a_radius_and_without_positions_the_choice_is_told(tmp_path: Path) -> None:
    told(tmp_path, without_radius("Lambert", positions=False), "states no radius of the Earth: WGS84 is taken")


def test_a_projection_that_leads_elsewhere_is_still_refused(tmp_path: Path) -> None:
    ds = on_map("Lambert", mapping=True, positions=True, flipped=False)
    ds = ds.assign_coords(lat=(ds["lat"] + 1.0).assign_attrs(ds["lat"].attrs))
    refused(written(tmp_path, ds), "projection and positions of the file differ by 111")


def test_a_rotated_pole_beside_positions_is_compared_too(tmp_path: Path) -> None:
    import pyproj

    pole = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 30.0,
        "grid_north_pole_longitude": 140.0,
    }
    crs = pyproj.CRS.from_cf(pole)
    to_degrees = pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    middle = pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True).transform(CENTRE, -55.5)
    rlon, rlat = middle[0] + np.linspace(-3, 3, 31), middle[1] + np.linspace(-3, 3, 31)
    lon, lat = to_degrees.transform(*np.meshgrid(rlon, rlat))
    for moved, words in ((0.05, "km from its projection"), (1.0, "")):
        east = lon + moved
        ds = xr.Dataset(
            coords={
                "rlon": ("rlon", rlon, {"units": "degrees", "standard_name": "grid_longitude"}),
                "rlat": ("rlat", rlat, {"units": "degrees", "standard_name": "grid_latitude"}),
                "lat": (("rlat", "rlon"), lat, {"units": "degrees_north"}),
                "lon": (("rlat", "rlon"), east, {"units": "degrees_east"}),
            }
        )
        for name in ("uo", "vo"):
            given = {"units": "m s-1", "standard_name": FIELDS[name][0], "grid_mapping": "pole"}
            ds[name] = ("rlat", "rlon"), truth(name, east, lat), given
        ds["pole"] = (), 0, pole
        if words:
            forcing, e = told(tmp_path, ds, words), elements()
            forcing.sample(e, 0.0)
            np.testing.assert_allclose(e.uo, truth("uo", e.lon, e.lat), atol=1e-4)
        else:
            refused(written(tmp_path, ds), "projection and positions of the file differ by")


# --- what a file holds beside, and what is not read ---------------------------------------------------------------------


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("scalar", "value", "attributes"),
    [
        ("sigma", 0.995, {}),
        ("isobaricInhPa", 1000.0, {"units": "hPa"}),
        ("height_above_ground", 80.0, {"units": "m", "positive": "up"}),
        ("sigma", 0.995, {"standard_name": "atmosphere_sigma_coordinate"}),
    ],
)
def test_a_level_of_the_air_beside_those_of_the_sea_says_nothing_of_it(
    tmp_path: Path, scalar: str, value: float, attributes: dict[str, str]
) -> None:
    """A stray sigma among the coordinates of everything shut out currents on their own depth."""
    for ds in (
        on_level(plain(names=("uo", "vo")), ("uo", "vo"), "depth", 0.494, units="m", positive="down", axis="Z"),
        plain(names=("uo", "vo")).assign_coords(depth=((), 0.494, {"units": "m", "positive": "down"})),
        plain(names=("uo", "vo", "ssh")).drop_vars(["uo", "vo"]),
    ):
        if "uo" not in ds:
            path = written(tmp_path, ds.assign_coords({scalar: ((), value, attributes)}))
            assert "\n  ssh " in doctor([path], needed=()).text()
            assert f"{scalar} = {value:g} says nothing of ssh" in doctor([path], needed=()).text()
            continue
        path = written(tmp_path, ds.assign_coords({scalar: ((), value, attributes)}))
        arrives(path, ("uo", "vo"))
        assert f"{scalar} = {value:g} says nothing of uo" in "\n".join(forcing_of(tmp_path, path.name).notices)


def test_a_level_of_the_air_alone_still_shuts_currents_out_and_a_depth_is_judged_beside_it(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    refused(written(tmp_path, ds.assign_coords(sigma=((), 0.995))), "uo holds at sigma = 0.995")
    deep = ds.assign_coords(sigma=((), 0.995), depth=((), 500.0, {"units": "m", "positive": "down"}))
    refused(written(tmp_path, deep), "uo begins at depth = 500 m")


def test_sea_ice_without_its_thickness_is_told(tmp_path: Path) -> None:
    words = "sea ice without its thickness (ice_thickness)"
    told(tmp_path, plain(names=("uo", "vo", "ice_fraction")), f"{words} and velocity (ui) exerts no force")
    told(tmp_path, plain(names=("uo", "vo", "ui", "vi", "ice_fraction")), f"{words} exerts no force")
    not_told(tmp_path, plain(names=("uo", "vo", "ui", "vi", "ice_thickness", "ice_fraction")), "exerts no force")


OF_THE_ICE: dict[str, dict[str, str]] = {
    "nothing said": {}, "plain words": {"long_name": "Sea ice thickness"},
    "where there is ice": {"cell_methods": "area: mean where sea_ice"},
    "CMIP": {"cell_methods": "area: time: mean where sea_ice (comment: mask=siconc)"},
    "a mean in time": {"cell_methods": "time: mean"}, "over the ice": {"long_name": "thickness over ice-covered water"},
}  # fmt: skip
OF_THE_CELL: dict[str, dict[str, str]] = {
    "CMIP volume": {"long_name": "Sea-Ice Volume per Area", "cell_methods": "area: mean where sea time: mean"},
    "CICE": {"long_name": "grid cell mean ice thickness"}, "ROMS": {"long_name": "average ice thickness in cell"},
    "effective": {"long_name": "Effective sea ice thickness"}, "FESOM": {"description": "ice height per unit area"},
    "area": {"cell_methods": "time: mean area: mean"},
}  # fmt: skip


@pytest.mark.quick(3)
@pytest.mark.parametrize(("said", "factor"), [
    *(pytest.param(words, 1.0, id=name) for name, words in OF_THE_ICE.items()),
    *(pytest.param(words, 2.0, id=name) for name, words in OF_THE_CELL.items()),
])  # fmt: skip
def test_thickness_spread_over_a_cell_becomes_that_of_the_ice(
    said: dict[str, str], factor: float, tmp_path: Path
) -> None:
    """Where half of a cell is open, its ice is twice as thick as its volume per area; files say which one they give."""
    ds = plain(names=("uo", "vo", "ui", "vi", "ice_fraction", "ice_thickness"))
    name = next(name for name in ds.data_vars if ds[name].attrs.get("standard_name") == "sea_ice_thickness")
    cover = next(name for name in ds.data_vars if ds[name].attrs.get("standard_name") == "sea_ice_area_fraction")
    ds[cover][:] = 0.5
    ds[name].attrs |= said
    read = open_product(written(tmp_path, ds))
    np.testing.assert_allclose(read["ice_thickness"].values, factor * ds[name].values, rtol=1e-6)
    words = f"{name} is sea ice spread over the whole cell: divided by {cover}"
    assert (words in read.attrs.get("told", "")) == (factor == 2.0)
    ds[cover][:] = 0.01  # round-off must not make mountains of a few floes
    thin = open_product(written(tmp_path, ds))["ice_thickness"].values
    np.testing.assert_allclose(thin, (1.0 if factor == 1.0 else 1.0 / 0.15) * ds[name].values, rtol=1e-6)


def test_thickness_of_a_cell_without_a_concentration_is_told(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "ui", "vi", "ice_thickness"))
    name = next(name for name in ds.data_vars if ds[name].attrs.get("standard_name") == "sea_ice_thickness")
    ds[name].attrs["long_name"] = "grid cell mean thickness"
    told(tmp_path, ds, "spread over the whole cell, and no concentration stands beside it")


def test_fields_of_melt_are_told_where_nothing_melts(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "sst", "sss"))
    told(tmp_path, ds, "sst, sss are for melt alone, which is off")
    assert not any("serve melt" in line for line in forcing_of(tmp_path, "odd.nc", melts=True).notices)


def test_stress_beside_wind_is_told(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "ua", "va"))
    for name, way in (("taux", "eastward"), ("tauy", "northward")):
        ds[name] = (ds["ua"] * 0.0 + 0.1).assign_attrs(units="Pa", standard_name=f"surface_downward_{way}_stress")
    told(tmp_path, ds, "wind stress (taux, tauy) is not used beside a wind")


# --- stores, archives, single points ------------------------------------------------------------------------------------


def test_a_zip_archive_is_a_store_or_an_archive(tmp_path: Path) -> None:
    """It was 'Check the address and the network'."""
    plain(names=("uo", "vo")).to_zarr(tmp_path / "ocean.zarr", zarr_format=2)
    store = sorted(path for path in (tmp_path / "ocean.zarr").rglob("*") if path.is_file())
    for name, folder in (("inside", tmp_path), ("bare", tmp_path / "ocean.zarr")):
        with zipfile.ZipFile(tmp_path / f"{name}.zarr.zip", "w") as archive:
            for path in store:
                archive.write(path, path.relative_to(folder))
        read = open_product(tmp_path / f"{name}.zarr.zip")
        np.testing.assert_array_equal(read["uo"], open_product(tmp_path / "ocean.zarr")["uo"])
    with zipfile.ZipFile(tmp_path / "empty.zarr.zip", "w") as archive:
        archive.writestr(".zgroup", '{"zarr_format": 2}')
    with pytest.raises(ForcingError, match="the file holds nothing"):
        open_product(tmp_path / "empty.zarr.zip")
    with zipfile.ZipFile(tmp_path / "files.zip", "w") as archive:
        archive.writestr("ocean.nc", b"CDF")
    with pytest.raises(ForcingError, match=r"this is a zip archive.*the \.zarr folder inside"):
        open_product(tmp_path / "files.zip")


def test_a_store_that_is_not_there_or_not_whole_is_no_matter_of_the_network(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="Check the name and the folder"):
        open_product(tmp_path / "missing.zarr")
    (tmp_path / "empty.zarr").mkdir()
    with pytest.raises(ForcingError, match="incomplete"):
        open_product(tmp_path / "empty.zarr")


def test_a_file_in_a_folder_that_is_called_after_a_store_is_a_file(tmp_path: Path) -> None:
    folder = tmp_path / "old.zarr.copies"
    folder.mkdir()
    arrives(written(folder, plain(names=("uo", "vo"))), ("uo", "vo"))
    shutil.copy(folder / "odd.nc", tmp_path / "odd.zarr")
    assert set(open_product(tmp_path / "odd.zarr")) == {"uo", "vo"}


@pytest.mark.parametrize("axis", ["lat", "lon"])
def test_a_single_row_of_points_is_no_more_ready_for_the_doctor_than_for_a_run(tmp_path: Path, axis: str) -> None:
    path = written(tmp_path, plain(names=("uo", "vo")).sel({axis: [CENTRE if axis == "lon" else -55.5]}))
    report = doctor([path], needed=("uo", "vo"))
    assert not report.ready
    assert f"only one point along {axis}" in report.text()
    with pytest.raises(ForcingError, match=f"only one point along {axis}"):
        forcing_of(tmp_path, path.name)
