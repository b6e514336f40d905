"""Output of models on grids of their own: real small files, and made ones whose true vectors are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from products.probe import at_points
from products.test_any_layout import START, elements, truth
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import open_all, recognise, window

TURN = np.deg2rad(35.0)
CENTRE = -39.0


@pytest.fixture
def models(shared: Path) -> Path:
    return shared / "data" / "samples" / "models"


def test_arome_wind_is_turned_by_the_convergence_of_its_lambert_grid(models: Path) -> None:
    """x_wind was taken as eastward, or the file ended in a traceback."""
    from pyproj import Proj

    path = models / "AROME_MetCoOp_00_DEF_20160114_subset.nc"
    ds, raw = open_product(path), xr.open_dataset(path, engine="netcdf4")
    projection = Proj("+proj=lcc +lon_0=15 +lat_0=63 +lat_1=63 +lat_2=63 +R=6.371e+06")
    factors = projection.get_factors(raw["longitude"].values, raw["latitude"].values)
    gamma = np.deg2rad(factors.meridian_convergence)
    u, v = raw["x_wind_10m"][0].values, raw["y_wind_10m"][0].values
    np.testing.assert_allclose(ds["ua"][0], u * np.cos(gamma) + v * np.sin(gamma), atol=2e-3)
    np.testing.assert_allclose(ds["va"][0], -u * np.sin(gamma) + v * np.cos(gamma), atol=2e-3)
    assert np.abs(gamma).max() > 0.01


def test_nemo_u_and_v_come_together_from_two_files(models: Path) -> None:
    """U and V of a C grid stand half a cell apart, in two files, along the grid; ORAS5's months were put on them."""
    paths = sorted(models.glob("ORCA025*"))
    [ds] = open_all(paths)
    assert ds.attrs["product"] == "nemo"
    assert {"uo", "vo"} <= set(ds.data_vars)
    assert ds["time"].values[0] == np.datetime64("2000-01-02T12:00")
    raw = [xr.open_dataset(path, engine="netcdf4") for path in paths]
    j, i = 20, 30
    u = float(raw[0]["uo"][0, 0, j, i])
    v = raw[1]["vo"][0, 0]
    around = float(np.mean([v[j, i], v[j, i + 1], v[j - 1, i], v[j - 1, i + 1]]))
    speed = float(np.hypot(ds["uo"], ds["vo"])[0, 0, j, i])
    assert np.isfinite(u)
    assert speed == pytest.approx(np.hypot(u, around), abs=2e-3)
    lon, lat = raw[0]["nav_lon"].values.astype(float), raw[0]["nav_lat"].values.astype(float)
    alpha = np.arctan2(lat[j, i + 1] - lat[j, i - 1], (lon[j, i + 1] - lon[j, i - 1]) * np.cos(np.deg2rad(lat[j, i])))
    assert float(ds["uo"][0, 0, j, i]) == pytest.approx(u * np.cos(alpha) - around * np.sin(alpha), abs=2e-3)


def test_nemo_u_alone_is_refused_in_words(models: Path) -> None:
    with pytest.raises(ForcingError, match=r"uo points along the rows or columns .* no file gives the other component"):
        open_all([models / "ORCA025-N06_20000104d05U_upper6.nc"])


def test_mom6_with_u_alone_is_refused_by_a_run_in_words(models: Path) -> None:
    asked = FileForcing(kind="files", files=["test_mom6.nc"], longitude=(-154, -150), latitude=(53.5, 56), hold=24)
    when = np.datetime64("2011-12-31T12:00").astype("datetime64[us]").item()
    with pytest.raises(ForcingError, match="gives uo and no file gives vo"):
        forcing_from_files(asked, models, Run.of(when, 0.2, np.full(3, 200.0), 850.0))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Nordic_subset_day1.nc", "lat_u and lon_u hold no positions"),
        ("croco_his.nc", "time has no units"),
        ("test_roms.nc", "time has no units"),
        ("test_leofs_fvcom.nc", "do not begin at the surface"),
    ],
)
def test_model_files_that_lack_something_are_refused_in_words(models: Path, name: str, words: str) -> None:
    with pytest.raises(ForcingError, match=words):
        open_all([models / name])
    assert words.split()[0] in doctor(models / name).text()


def positions(rows: Any, columns: Any) -> tuple[Any, Any]:
    """Return longitudes and latitudes of a grid with cells of 0.1 degrees, turned by `TURN`, around the centre."""
    x, y = 0.1 * (np.asarray(columns) - 25.0), 0.1 * (np.asarray(rows) - 25.0)
    lat = -55.5 + y * np.cos(TURN) + x * np.sin(TURN)
    return CENTRE + (x * np.cos(TURN) - y * np.sin(TURN)) / np.cos(np.deg2rad(-55.5)), lat


def along(lon: Any, lat: Any) -> tuple[Any, Any]:
    """Return the true current along the rows and the columns of the turned grid."""
    east, north = truth("uo", lon, lat, CENTRE)
    return east * np.cos(TURN) + north * np.sin(TURN), -east * np.sin(TURN) + north * np.cos(TURN)


def roms(
    path: Path, *, grid_apart: bool = False, angle: bool = True, levels: bool = True, transform: int = 0,
    lacks: str = "", croco: bool = False,
) -> list[Path]:  # fmt: skip
    """Write a ROMS file: C grid, s levels, angle; perhaps with the grid in a file of its own, as CROCO has it.

    ``croco``: u and v share dimensions with the cells, and the file of the grid has positions on dimensions of their own.
    """
    j, i = np.mgrid[0:50, 0:50]
    rho, at_u, at_v = (positions(*a) for a in ((j, i), (j[:, :-1], i[:, :-1] + 0.5), (j[:-1] + 0.5, i[:-1])))
    s = np.array([-0.875, -0.625, -0.375, -0.125, -0.005])
    # Depths over 400 m, as the two transforms of ROMS have them (Shchepetkin and McWilliams 2005, 2009).
    c, hc = (-(s**2), 200.0) if transform else (s, 20.0)
    share = {0: s, 1: (hc * s + (400.0 - hc) * c) / 400.0, 2: (hc * s + 400.0 * c) / (hc + 400.0)}[transform]
    u, v = along(*at_u)[0], along(*at_v)[1]
    up = ("s_rho",) if levels else ()
    sheared = (lambda q: (1.0 + share)[:, None, None] * q) if levels else (lambda q: q)
    grid = {
        "lon_rho": (("eta_rho", "xi_rho"), rho[0], {"units": "degree_east"}),
        "lat_rho": (("eta_rho", "xi_rho"), rho[1], {"units": "degree_north"}),
        "h": (("eta_rho", "xi_rho"), np.full((50, 50), 400.0), {"units": "meter"}),
        **({"angle": (("eta_rho", "xi_rho"), np.full((50, 50), TURN), {"units": "radians"})} if angle else {}),
    }
    fields = {
        "u": (("ocean_time", *up, "eta_u", "xi_u"), sheared(u)[None], {"units": "meter second-1"}),
        "v": (("ocean_time", *up, "eta_v", "xi_v"), sheared(v)[None], {"units": "meter second-1"}),
        "hc": ((), hc),
        "Vtransform": ((), transform or 2),
        "Cs_r": (("s_rho",), c),
    }
    words = {
        "standard_name": "ocean_s_coordinate" if transform else "ocean_s_coordinate_g2",
        "positive": "up",
        "formula_terms": "s: s_rho C: Cs_r depth: h depth_c: hc",
    }
    coords = {
        "ocean_time": np.array(["2020-12-16T07:00"], "M8[ns]"),
        **({"s_rho": ("s_rho", s, words)} if levels else {}),
    }
    files = [path / "his.nc"]
    held = xr.Dataset({**fields, **({} if grid_apart or croco else grid)}, coords)
    if croco:
        for name, own, shared, at in (("u", "eta_u", "eta_rho", at_u), ("v", "xi_v", "xi_rho", at_v)):
            for axis, values in zip(("lon", "lat"), at, strict=True):
                grid[f"{axis}_{name}"] = (f"eta_{name}", f"xi_{name}"), values, grid[f"{axis}_rho"][2]
            held[name] = held[name].rename({own: shared})
    held.drop_vars(lacks.split()).to_netcdf(files[0])
    if grid_apart or croco:
        xr.Dataset(grid).to_netcdf(path / "model_grd.nc")
    return files


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "options",
    [{}, {"grid_apart": True}, {"angle": False}, {"transform": 1}, {"transform": 2}, {"croco": True}],
    ids=lambda options: " ".join(f"{name} {value}" for name, value in options.items()) or "plain",
)
def test_roms_currents_are_turned_and_stand_on_depths(options: dict[str, Any], tmp_path: Path) -> None:
    [ds] = [part for part in open_all(roms(tmp_path, **options)) if "uo" in part]
    e = elements(CENTRE)
    found = at_points(ds[["uo", "vo"]].assign_attrs(ds.attrs), e.lon.reshape(3, 3), e.lat.reshape(3, 3))
    east, north = truth("uo", e.lon.reshape(3, 3), e.lat.reshape(3, 3), CENTRE)
    # The shear is linear in depth: at 200 m it leaves half of the surface current.
    for depth, share in ((5.0, 1.0 - 5.0 / 400.0), (200.0, 0.5)):
        np.testing.assert_allclose(found["uo"].sel(depth=depth)[0], share * east, atol=3e-3)
        np.testing.assert_allclose(found["vo"].sel(depth=depth)[0], share * north, atol=3e-3)


def test_roms_levels_of_which_only_the_name_tells_the_formula_bend_as_it_says(tmp_path: Path) -> None:
    """They were taken as even shares of the water: a level at 28 m stood at 50 m."""
    [ds] = [part for part in open_all(roms(tmp_path, transform=1, lacks="Vtransform")) if "uo" in part]
    speed = np.hypot(ds["uo"], ds["vo"]).isel(time=0)
    np.testing.assert_allclose(speed.sel(depth=200.0) / speed.sel(depth=0.0), 0.5, atol=5e-3)


def test_levels_of_which_nothing_tells_a_formula_are_shares_of_the_water(tmp_path: Path) -> None:
    [path] = roms(tmp_path)
    with xr.open_dataset(path) as ds:
        plain = ds.load().drop_vars(["Vtransform", "hc", "Cs_r"])
    plain["s_rho"].attrs = {"positive": "up"}
    plain.to_netcdf(tmp_path / "other.nc")
    [ds] = [part for part in open_all([tmp_path / "other.nc"]) if "uo" in part]
    speed = np.hypot(ds["uo"], ds["vo"]).isel(time=0)
    # The shear of the file is linear in the share: at 200 of 400 m it leaves half of the surface current.
    np.testing.assert_allclose(speed.sel(depth=200.0) / speed.sel(depth=0.0), 0.5 / 0.995, atol=5e-3)


@pytest.mark.parametrize("transform", [1, 2])
def test_roms_levels_without_their_stretching_are_refused(transform: int, tmp_path: Path) -> None:
    """``sc_r``, the levels themselves, was taken for it."""
    [path] = roms(tmp_path, transform=transform, lacks="Cs_r")
    with xr.open_dataset(path) as ds:
        ds.load().assign(sc_r=("s_rho", ds["s_rho"].values)).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(ForcingError, match=r"follow the sea floor, and the file lacks Cs_r"):
        open_all([tmp_path / "other.nc"])


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "quantity"),
    [("temp", "sst"), ("salt", "sss"), ("zeta", "ssh"),
     ("aice", "ice_fraction"), ("uice_eastward", "ui"), ("vice_northward", "vi")],
)  # fmt: skip
def test_roms_fields_of_the_sea_are_unknown_on_land(name: str, quantity: str, tmp_path: Path) -> None:
    """Zeros of temperature and salinity on land were mixed into the water beside it."""
    [path] = roms(tmp_path, levels=False)
    with xr.open_dataset(path) as ds:
        ds = ds.load()
    mask = np.ones((50, 50))
    mask[:, :20] = 0.0
    plane = ("eta_rho", "xi_rho")
    for own in ("temp", "salt", "zeta", "aice", "uice_eastward", "vice_northward", "Uwind_eastward", "Vwind_northward"):
        ds[own] = ("ocean_time", *plane), 0.8 * mask[None], {"coordinates": "lon_rho lat_rho"}
    ds.assign(mask_rho=(plane, mask)).to_netcdf(tmp_path / "other.nc")
    parts = open_all([tmp_path / "other.nc"])
    found = next(part[quantity] for part in parts if quantity in part).isel(time=0)
    np.testing.assert_array_equal(np.isfinite(found), mask > 0.5)
    assert any(np.isfinite(part["ua"]).all() for part in parts if "ua" in part)


def test_roms_without_its_grid_says_where_to_put_it(tmp_path: Path) -> None:
    files = roms(tmp_path, grid_apart=True)
    (tmp_path / "model_grd.nc").unlink()
    with pytest.raises(ForcingError, match=r"has no positions .* Put the grid file"):
        open_all(files)


def test_angle_in_other_units_than_it_says_is_refused(tmp_path: Path) -> None:
    [path] = roms(tmp_path)
    with xr.open_dataset(path) as ds:
        wrong = ds.load()
    wrong["angle"] = wrong["angle"] + np.pi / 2
    path.unlink()
    wrong.to_netcdf(path)
    with pytest.raises(ForcingError, match="differs from the direction of its grid by 90 degrees"):
        open_all([path])


@pytest.mark.quick(2)
@pytest.mark.parametrize("degrees", [0.15, 6.2, 20.0])
@pytest.mark.parametrize("unit", ["degree", "radian"])
def test_the_unit_of_an_angle_without_one_is_that_which_fits_the_grid(
    degrees: float, unit: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """6.2 and 0.15 degrees everywhere were taken as radians: the current turned by 11 and 8 degrees too far."""
    monkeypatch.setattr("products.test_models.TURN", np.deg2rad(degrees))
    [path] = roms(tmp_path, levels=False)
    with xr.open_dataset(path) as ds:
        ds = ds.load()
    del ds["angle"].attrs["units"]
    if unit == "degree":
        ds["angle"] = np.rad2deg(ds["angle"])
    ds.to_netcdf(tmp_path / "other.nc")
    [ds] = [part for part in open_all([tmp_path / "other.nc"]) if "uo" in part]
    east, north = truth("uo", ds["lon"].values, ds["lat"].values, CENTRE)
    inner = (slice(2, -2), slice(2, -2))
    np.testing.assert_allclose(ds["uo"][0].values[inner], east[inner], atol=3e-3)
    np.testing.assert_allclose(ds["vo"][0].values[inner], north[inner], atol=3e-3)


def test_a_wrong_angle_without_unit_is_no_small_one_in_degrees(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("products.test_models.TURN", np.deg2rad(0.2))
    [path] = roms(tmp_path, levels=False)
    with xr.open_dataset(path) as ds:
        ds = ds.load()
    ds["angle"] = (ds["angle"] - np.pi / 2).drop_attrs()
    ds.to_netcdf(tmp_path / "other.nc")
    with pytest.raises(ForcingError, match="differs from the direction of its grid by 90 degrees"):
        open_all([tmp_path / "other.nc"])


def fvcom(path: Path) -> Path:
    """Write an FVCOM file: scattered faces with currents on sigma layers, nodes with sea level and depth."""
    rng = np.random.default_rng(1)

    def told(way: str) -> dict[str, str]:
        return {"units": "meters s-1", "standard_name": f"{way}_sea_water_velocity"}

    node, face = (np.stack([CENTRE + rng.uniform(-3, 3, n), -55.5 + rng.uniform(-2, 2, n)]) for n in (9000, 12000))
    u, v = truth("uo", *face, CENTRE)
    sigma = np.repeat([[-0.05], [-0.5], [-0.95]], 9000, axis=1)
    east, north = {"units": "degrees_east"}, {"units": "degrees_north"}
    fields = {
        "u": (("time", "siglay", "nele"), np.stack([u] * 3)[None], told("eastward")),
        "v": (("time", "siglay", "nele"), np.stack([v] * 3)[None], told("Northward")),
        "zeta": (("time", "node"), (0.1 * (node[1] + 55.5))[None], {"units": "meters"}),
        "h": (("node",), np.full(9000, 300.0), {"units": "m"}),
        "lon": (("node",), node[0], east), "lat": (("node",), node[1], north),
        "lonc": (("nele",), face[0], east), "latc": (("nele",), face[1], north),
        "sigma_layers": (("siglay", "node"), sigma),
        "nv": (("three", "nele"), np.zeros((3, 12000), np.int32)),
    }  # fmt: skip
    ds = xr.Dataset(fields, {"time": np.array(["2020-12-16T07:00"], "M8[ns]")})
    ds.rename(sigma_layers="siglay_").to_netcdf(path / "fvcom.nc")
    import netCDF4

    with netCDF4.Dataset(path / "fvcom.nc", "a") as file:
        file.renameVariable("siglay_", "siglay")
        file["siglay"].standard_name = "ocean_sigma_coordinate"
    return path / "fvcom.nc"


def test_fvcom_by_nearest_points(tmp_path: Path) -> None:
    parts = open_all(fvcom(tmp_path))
    currents = next(part for part in parts if "uo" in part)
    level = next(part for part in parts if "ssh" in part)
    e = elements(CENTRE)
    lon, lat = e.lon.reshape(3, 3), e.lat.reshape(3, 3)
    found = at_points(currents[["uo", "vo"]].assign_attrs(currents.attrs), lon, lat)
    for name, values in zip(("uo", "vo"), truth("uo", lon, lat, CENTRE), strict=True):
        np.testing.assert_allclose(found[name][0, 0], values, atol=5e-3)
    np.testing.assert_allclose(
        at_points(level[["ssh"]].assign_attrs(level.attrs), lon, lat)["ssh"][0], 0.1 * (lat + 55.5), atol=5e-3
    )


def test_scattered_components_of_unknown_direction_are_refused(tmp_path: Path) -> None:
    path = fvcom(tmp_path)
    import netCDF4

    with netCDF4.Dataset(path, "a") as file:
        file["u"].delncattr("standard_name")
    with pytest.raises(ForcingError, match="does not say that it points east or north"):
        open_all(path)


def test_mom6_components_on_staggered_axes_come_to_one_grid(tmp_path: Path) -> None:
    """U on (yh, xq) and v on (yq, xh) made two datasets, and the run took v as 0."""
    xh, yh = CENTRE + np.arange(-4, 4.01, 0.25), -55.5 + np.arange(-3, 3.01, 0.25)
    xq, yq = xh + 0.125, yh + 0.125
    u = truth("uo", *np.meshgrid(xq, yh), CENTRE)[0]
    v = truth("uo", *np.meshgrid(xh, yq), CENTRE)[1]
    east, north = {"units": "degrees_east", "cartesian_axis": "X"}, {"units": "degrees_north", "cartesian_axis": "Y"}
    stamps = np.array(["2020-12-16T05:00", "2020-12-16T12:00"], "M8[ns]")
    fields = {
        "uo": (("time", "yh", "xq"), np.stack([u, u]), {"units": "m s-1", "standard_name": "sea_water_x_velocity"}),
        "vo": (("time", "yq", "xh"), np.stack([v, v]), {"units": "m s-1", "standard_name": "sea_water_y_velocity"}),
    }
    coords = {
        "xh": ("xh", xh, east),
        "xq": ("xq", xq, east),
        "yh": ("yh", yh, north),
        "yq": ("yq", yq, north),
        "time": stamps,
    }
    xr.Dataset(fields, coords).to_netcdf(tmp_path / "mom6.nc")
    asked = FileForcing(kind="files", files=["mom6.nc"], longitude=(-41, -37), latitude=(-57, -54))
    e = elements(CENTRE)
    forcing = forcing_from_files(asked, tmp_path, Run.of(START, 0.2, e.thickness, 850.0))
    forcing.sample(e, 3600.0)
    for got, values in zip((e.uo, e.vo), truth("uo", e.lon, e.lat, CENTRE), strict=True):
        np.testing.assert_allclose(got, values, atol=1e-5)


def test_components_with_different_records_are_refused(tmp_path: Path) -> None:
    lon, lat = CENTRE + np.arange(-4, 4.01, 0.5), -55.5 + np.arange(-3, 3.01, 0.5)
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    for name, hours, told in (("u", (0, 12), "eastward"), ("v", (3, 15), "northward")):
        stamps = np.datetime64("2020-12-16", "ns") + np.array(hours) * np.timedelta64(1, "h")
        field = (
            ("time", "lat", "lon"),
            np.full((2, lat.size, lon.size), 0.1),
            {"units": "m/s", "standard_name": f"{told}_sea_water_velocity"},
        )
        xr.Dataset({name: field}, {**axes, "time": stamps}).to_netcdf(tmp_path / f"{name}.nc")
    asked = FileForcing(kind="files", files=["u.nc", "v.nc"], longitude=(-41, -37), latitude=(-57, -54), hold=24)
    with pytest.raises(ForcingError, match="gives uo and no file gives vo with the same records on the same grid"):
        forcing_from_files(asked, tmp_path, Run.of(START, 0.2, np.full(3, 200.0), 850.0))


def test_a_rotated_pole_is_read_through_its_grid_mapping(tmp_path: Path) -> None:
    from pyproj import CRS, Transformer

    pole = {
        "grid_mapping_name": "rotated_latitude_longitude",
        "grid_north_pole_latitude": 30.0,
        "grid_north_pole_longitude": 150.0,
    }
    crs = CRS.from_cf(pole)
    way = Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
    x0, y0 = way.transform(CENTRE, -55.5)
    rlon, rlat = x0 + np.arange(-3, 3.01, 0.25), y0 + np.arange(-3, 3.01, 0.25)
    lon, lat = way.transform(*np.meshgrid(rlon, rlat), direction="INVERSE")
    east, north = truth("uo", lon, lat, CENTRE)
    told = {"units": "m s-1", "grid_mapping": "rotated_pole"}
    fields = {
        "u": (("rlat", "rlon"), east, {**told, "standard_name": "eastward_sea_water_velocity"}),
        "v": (("rlat", "rlon"), north, {**told, "standard_name": "northward_sea_water_velocity"}),
        "rotated_pole": ((), 0, pole),
    }
    axes = {
        "rlon": ("rlon", rlon, {"standard_name": "grid_longitude", "units": "degrees"}),
        "rlat": ("rlat", rlat, {"standard_name": "grid_latitude", "units": "degrees"}),
    }
    xr.Dataset(fields, axes).to_netcdf(tmp_path / "rotated.nc")
    e = elements(CENTRE)
    found = at_points(open_product(tmp_path / "rotated.nc"), e.lon.reshape(3, 3), e.lat.reshape(3, 3))
    np.testing.assert_allclose(found["uo"].values.ravel(), truth("uo", e.lon, e.lat, CENTRE)[0], atol=1e-3)


def other_layout(kind: str) -> xr.Dataset:
    """Return a small file as HYCOM, WRF and GRIB readers write it: the field is 1 eastward, 0 northward."""
    lat, lon = np.arange(-60, -50, 0.5), np.arange(-45, -33, 0.5)
    columns, rows = np.meshgrid(lon, lat)
    stamps = np.array(["2020-12-16", "2020-12-17"], "M8[ns]")
    one = np.ones((2, lat.size, lon.size))
    north, east = {"units": "degrees_north"}, {"units": "degrees_east"}
    if kind == "hycom":
        dims = ("MT", "Depth", "Y", "X")
        names = [f"{way}_sea_water_velocity" for way in ("eastward", "northward")]
        fields = {
            n: (dims, k * one[:, None], {"units": "m/s", "standard_name": told})
            for n, k, told in zip("uv", (1, 0), names, strict=True)
        }
        axes = {
            "MT": stamps, "Depth": ("Depth", [0.0], {"units": "m", "axis": "Z"}),
            "Y": ("Y", np.arange(lat.size), {"axis": "Y"}), "X": ("X", np.arange(lon.size), {"axis": "X"}),
            "Latitude": (("Y", "X"), rows, north), "Longitude": (("Y", "X"), columns, east),
        }  # fmt: skip
        return xr.Dataset(fields, axes)
    if kind == "wrf":
        dims = ("Time", "south_north", "west_east")
        fields = {"U10": (dims, 0 * one), "V10": (dims, -one), "COSALPHA": (dims, 0 * one), "SINALPHA": (dims, one)}
        places = {"XLAT": (dims, np.stack([rows.T] * 2), north), "XLONG": (dims, np.stack([columns.T[::-1]] * 2), east)}
        turned = {n: (d, np.swapaxes(v, 1, 2), {"units": "m s-1"}) for n, (d, v) in fields.items()}
        return xr.Dataset({**turned, **places, "XTIME": (("Time",), stamps)})
    fields = {
        n: (("step", "latitude", "longitude"), k * one, {"units": "m s**-1"}) for n, k in (("u10", 1), ("v10", 0))
    }
    axes = {
        "time": ((), stamps[0], {"standard_name": "forecast_reference_time"}),
        "step": ("step", [0, 6], {"units": "hours"}),
        "valid_time": ("step", stamps[0] + np.arange(2) * np.timedelta64(6, "h"), {"standard_name": "time"}),
        "heightAboveGround": ((), 10.0, {"units": "m"}),
        "latitude": ("latitude", lat, north), "longitude": ("longitude", lon, east),
    }  # fmt: skip
    return xr.Dataset(fields, axes)


@pytest.mark.parametrize("kind", ["hycom", "wrf", "cfgrib"])
def test_layouts_of_other_producers(kind: str, tmp_path: Path) -> None:
    other_layout(kind).to_netcdf(tmp_path / "file.nc")
    ds = open_product(tmp_path / "file.nc")
    east, north = ("uo", "vo") if kind == "hycom" else ("ua", "va")
    np.testing.assert_allclose(ds[east], 1.0, atol=1e-12)
    np.testing.assert_allclose(ds[north], 0.0, atol=1e-12)
    later = np.timedelta64(6, "h") if kind == "cfgrib" else np.timedelta64(24, "h")
    assert ds["time"].values[1] == np.datetime64("2020-12-16") + later


def test_a_wrf_file_has_its_places_and_its_wind(tmp_path: Path) -> None:
    lon, lat = np.meshgrid(CENTRE + np.arange(5.0), -57.0 + np.arange(4.0))
    dims = ("south_north", "west_east")
    wind = {name: (dims, np.ones((4, 5)), {"units": "m s-1"}) for name in ("U10", "V10")}
    places = {"XLONG": (dims, lon), "XLAT": (dims, lat)}
    xr.Dataset(wind | places).to_netcdf(tmp_path / "wrf.nc")
    assert recognise(tmp_path / "wrf.nc").name == "wrf"
    xr.Dataset(wind).to_netcdf(tmp_path / "wind.nc")
    assert recognise(tmp_path / "wind.nc").name != "wrf"
    xr.Dataset(places).to_netcdf(tmp_path / "places.nc")
    with pytest.raises(ForcingError, match="not recognised"):
        recognise(tmp_path / "places.nc")


@pytest.mark.quick(2)
@pytest.mark.parametrize("edge", ["south", "north", "west", "east"])
def test_nodes_around_a_box_are_kept_with_it(tmp_path: Path, edge: str) -> None:
    """At its edges the cut field is the whole one."""
    whole = next(part for part in open_all(fvcom(tmp_path)) if "ssh" in part)[["ssh"]]
    west, east, south, north = CENTRE - 0.5, CENTRE + 0.5, -55.9, -55.1
    part = window(whole, (west, east), (south, north), margin=0.02)
    assert part.sizes["node"] < whole.sizes["node"] / 10
    along = np.linspace(0.0, 1.0, 40)
    lon = {"west": west, "east": east}.get(edge, west + along * (east - west))
    lat = {"south": south, "north": north}.get(edge, south + along * (north - south))
    at = [q.reshape(1, -1) for q in np.broadcast_arrays(lon, lat)]
    found = [at_points(ds, *at)["ssh"].values for ds in (whole, part)]
    np.testing.assert_allclose(*found, rtol=0.0, atol=1e-12)


def around_the_pole(side: float = 400e3, step: float = 25e3) -> xr.Dataset:
    """Return a field linear in a plane that touches the sphere at the North Pole, on cells of which positions alone tell."""
    axis = np.arange(-side, side + 1.0, step)
    x, y = np.meshgrid(axis, axis)
    lat, lon = 90.0 - np.rad2deg(np.hypot(x, y) / 6.371e6), np.rad2deg(np.arctan2(x, -y))
    about = {"lat": {"units": "degrees_north"}, "lon": {"units": "degrees_east"}}
    words = {"units": "m s-1", "standard_name": "eastward_sea_water_velocity", "coordinates": "lon lat"}
    fields = {"uo": (("y", "x"), 1e-6 * (x + 2.0 * y), words),
              "vo": (("y", "x"), 1e-6 * (y - x), {**words, "standard_name": "northward_sea_water_velocity"})}  # fmt: skip
    return xr.Dataset({**fields, "lat": (("y", "x"), lat, about["lat"]), "lon": (("y", "x"), lon, about["lon"])})


def test_cells_around_the_pole_give_what_lies_between_their_points(tmp_path: Path) -> None:
    """Where meridians meet, longitudes are no coordinates of a plane."""
    around_the_pole().to_netcdf(tmp_path / "pole.nc")
    [ds] = open_all([tmp_path / "pole.nc"])
    x, y = np.random.default_rng(3).uniform(-350e3, 350e3, (2, 4, 25))
    lat, lon = 90.0 - np.rad2deg(np.hypot(x, y) / 6.371e6), np.rad2deg(np.arctan2(x, -y))
    found = at_points(ds, lon, lat)
    np.testing.assert_allclose(found["uo"][0], 1e-6 * (x + 2.0 * y), atol=5e-3)
    np.testing.assert_allclose(found["vo"][0], 1e-6 * (y - x), atol=5e-3)


def test_a_box_within_one_cell_of_a_bent_grid_keeps_the_points_around_it(tmp_path: Path) -> None:
    around_the_pole(step=100e3).to_netcdf(tmp_path / "pole.nc")
    [ds] = open_all([tmp_path / "pole.nc"])
    x, y = 170e3, -240e3
    lat, lon = 90.0 - np.rad2deg(np.hypot(x, y) / 6.371e6), np.rad2deg(np.arctan2(x, -y))
    cut = window(ds, (lon - 0.5, lon + 0.5), (lat - 0.05, lat + 0.05))
    assert cut.sizes["x"] * cut.sizes["y"] < 30
    found = at_points(cut.assign_attrs(ds.attrs), np.array([[lon]]), np.array([[lat]]))
    assert float(found["uo"].values.ravel()[0]) == pytest.approx(1e-6 * (x + 2.0 * y), abs=5e-3)
