"""One-dimensional axes of bent grids are no positions: the true ones are taken, or nominal ones where they hold, and told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from products.test_odd_files import CENTRE, FIELDS, START, elements, plain, refused, truth, written
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing

MOM6 = ("yh", "xh", "h point nominal latitude", "h point nominal longitude")
MOM5 = ("yt_ocean", "xt_ocean", "tcell latitude", "tcell longitude")
ROTATED = ("rlat", "rlon", "latitude in rotated pole grid", "longitude in rotated pole grid")
BARE = ("lat", "lon", "", "")


def bent(names: tuple[str, ...], positions: tuple[str, str] | None, bend: float = 0.8, **said: Any) -> xr.Dataset:
    """Currents on a grid whose rows bend by some degrees, with axes of its middle row and column."""
    ds = plain(names=("uo", "vo"))
    y, x = np.meshgrid(ds["lat"], ds["lon"], indexing="ij")
    y = y + bend * np.sin(0.5 * (x - CENTRE))
    rows, columns = names[:2]
    ds = ds.rename({"lat": rows, "lon": columns}) if rows != "lat" else ds
    for axis, title, units in zip(names[:2], names[2:], ("degrees_north", "degrees_east"), strict=True):
        ds[axis].attrs = {"units": units, **({"long_name": title} if title else {}), **said}
    for name in ("uo", "vo"):
        ds[name] = ("time", rows, columns), np.stack([truth(name, x, y)] * 4), ds[name].attrs
    if positions:
        for name, values, units in zip(positions, (y, x), ("degrees_north", "degrees_east"), strict=True):
            ds[name] = (rows, columns), values, {"units": units}
    return ds


def felt(path: Path, north: float = 0.0, **entry: Any) -> tuple[float, str]:
    """Return by how much the current of a run is wrong, and what the run says beforehand."""
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5 + north, -53.5 + north), "hold": 24.0}
    e = elements()
    e.lon[:] += 0.6
    e.lat[:] += north
    asked = FileForcing(kind="files", files=[{"file": path.name, **entry}], **box)
    forcing = forcing_from_files(asked, path.parent, Run.of(START, 0.1, e.thickness, 850.0))
    forcing.check(e, 0.0, 8640.0)
    forcing.sample(e, 3600.0)
    return float(np.abs(e.uo - truth("uo", e.lon, e.lat - north)).max()), "\n".join(forcing.notices)


@pytest.mark.quick(2)
@pytest.mark.parametrize("names", [MOM6, MOM5, ROTATED, BARE])
@pytest.mark.parametrize("positions", [("geolat", "geolon"), ("nav_lat", "nav_lon")])
def test_true_positions_beside_axes_are_taken(
    tmp_path: Path, names: tuple[str, ...], positions: tuple[str, str]
) -> None:
    wrong, said = felt(written(tmp_path, bent(names, positions)))
    assert wrong < 2e-3
    assert f"positions are those of {positions[0]} and {positions[1]}" in said
    assert f"the axes {names[0]} and {names[1]} lie up to 0." in said


def test_positions_missing_over_land(tmp_path: Path) -> None:
    ds = bent(MOM6, ("geolat", "geolon"))
    land = np.zeros(ds["geolat"].shape, bool)
    land[:3, :5] = True
    for name in ("geolat", "geolon", "uo", "vo"):
        ds[name] = ds[name].where(~xr.DataArray(land, dims=("yh", "xh"))).assign_attrs(ds[name].attrs)
    assert felt(written(tmp_path, ds))[0] < 2e-3


def test_positions_that_agree_with_the_axes_leave_a_plain_grid(tmp_path: Path) -> None:
    for names in (BARE, MOM6):
        path = written(tmp_path, bent(names, ("geolat", "geolon"), bend=0.0))
        assert {"lat", "lon"} <= set(open_product(path).dims)
        assert not {"aside", "nominal"} & set(felt(path)[1].split())


def test_axes_that_the_variable_names_are_meant(tmp_path: Path) -> None:
    """Positions of something else, here of a satellite's footprint, do not replace them."""
    ds = bent(BARE, ("footprint_lat", "footprint_lon"), bend=0.0)
    ds["footprint_lat"] = (ds["footprint_lat"] + 1.0).assign_attrs(ds["footprint_lat"].attrs)
    for name in ("uo", "vo"):
        ds[name].encoding["coordinates"] = "lat lon"
    path = tmp_path / "odd.nc"
    ds.to_netcdf(path)
    wrong, said = felt(path)
    assert wrong < 2e-3
    assert "aside" not in said


@pytest.mark.parametrize(
    "names", [MOM6, MOM5, ("yq", "xq", "", ""), ("y", "x", "nominal latitude", "nominal longitude")]
)
def test_nominal_axes_alone_serve_in_the_south_and_are_told(tmp_path: Path, names: tuple[str, ...]) -> None:
    wrong, said = felt(written(tmp_path, bent(names, None, bend=0.0)))
    assert wrong < 2e-3
    assert (
        f"{names[0]} and {names[1]} are nominal axes: north of 60 N, where tripolar grids bend, they are no positions"
        in said
    )


@pytest.mark.parametrize(("north", "box"), [(120.0, 123.0), (113.0, 116.0), (119.0, 119.0)])
def test_nominal_axes_alone_are_refused_in_the_north(tmp_path: Path, north: float, box: float) -> None:
    ds = bent(MOM6, None, bend=0.0)
    ds = ds.assign_coords(yh=("yh", ds["yh"].values + north, ds["yh"].attrs))
    with pytest.raises(ForcingError, match="nominal axes: north of 60 N"):
        felt(written(tmp_path, ds), box)


def test_positions_that_the_user_names_are_meant(tmp_path: Path) -> None:
    ds = bent(MOM6, ("geolat", "geolon"), bend=0.0)
    ds["geolat"] = (ds["geolat"] + 1.0).assign_attrs(ds["geolat"].attrs)
    path = written(tmp_path, ds)
    assert felt(path)[0] > 0.01
    wrong, said = felt(path, names={"lat": "yh", "lon": "xh"})
    assert wrong < 2e-3
    assert "nominal" not in said


def test_what_has_a_standard_name_is_a_position(tmp_path: Path) -> None:
    ds = bent(MOM5, None, bend=0.0)
    for name, said in zip(MOM5[:2], ("latitude", "longitude"), strict=True):
        ds[name].attrs["standard_name"] = said
    assert "nominal" not in felt(written(tmp_path, ds))[1]


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("names", "said"),
    [
        (ROTATED, {}),
        (("r_lat", "r_lon", "", ""), {}),
        (("y", "x", "latitude of the rotated system", "longitude of the rotated system"), {}),
        (("y", "x", "grid latitude", "grid longitude"), {"standard_name": "grid_latitude"}),
        (BARE, {"mapping": "rotated_latitude_longitude"}),
    ],
)
def test_axes_of_rotated_grids_alone_are_refused(tmp_path: Path, names: tuple[str, ...], said: dict[str, str]) -> None:
    ds = bent(names, None)
    if "mapping" in said:
        ds["pole"] = (), 0, {"grid_mapping_name": said["mapping"]}
        for name in ("uo", "vo"):
            ds[name].attrs["grid_mapping"] = "pole"
    elif said:
        for name, kind in zip(names[:2], ("grid_latitude", "grid_longitude"), strict=True):
            ds[name].attrs |= {"standard_name": kind, "units": "degrees"}
    refused(written(tmp_path, ds), "is an axis of a rotated grid: its numbers are no latitudes and longitudes")


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("names", "positions"),
    [
        (MOM6, ("geolat", "geolon")),
        (MOM5, ("geolat_t", "geolon_t")),
        (("yq", "xq", "", ""), ("geolat_c", "geolon_c")),
    ],
)
@pytest.mark.parametrize("whole", [True, False])
def test_the_static_grid_file_beside_gives_true_positions(
    tmp_path: Path, names: tuple[str, ...], positions: tuple[str, str], whole: bool
) -> None:
    """MOM writes positions once, into a file of their own; output is often a cut of the grid."""
    ds = bent(names, positions)
    ds[list(positions)].drop_vars("time", errors="ignore").to_netcdf(tmp_path / "19001201.ocean_static.nc")
    (tmp_path / "other_static.nc").write_bytes(b"no netCDF file")
    ds = ds.drop_vars(positions)
    path = written(tmp_path, ds if whole else ds.isel({names[0]: slice(1, None), names[1]: slice(2, -1)}))
    wrong, said = felt(path)
    assert wrong < 2e-3
    assert "true positions are those of the grid file 19001201.ocean_static.nc, by its axes" in said


def test_a_static_grid_file_of_another_grid_is_left_alone(tmp_path: Path) -> None:
    ds = bent(MOM6, ("geolat", "geolon"))
    moved = ds[["geolat", "geolon"]].assign_coords(yh=ds["yh"] + 0.1)
    moved.drop_vars("time", errors="ignore").to_netcdf(tmp_path / "ocean_static.nc")
    assert "yh and xh are nominal axes" in felt(written(tmp_path, ds.drop_vars(["geolat", "geolon"])))[1]


# Positions of several points of a cell stand on the same rows and columns, half a cell apart.


def on_two_points(names: tuple[str, str, str, str], listed: str | None = None) -> xr.Dataset:
    """Currents on the corners and a temperature in the middle of bent cells, with the positions of both."""
    j, i = np.meshgrid(np.arange(25.0), np.arange(33.0), indexing="ij")

    def at(half: float) -> tuple[Any, Any]:
        y = -59.0 + 0.3 * (j + half) + 0.1 * np.sin(0.2 * (i + half))
        return CENTRE - 5.0 + 0.3 * (i + half) + 0.1 * np.cos(0.2 * (j + half)), y

    ds = xr.Dataset(coords={"time": np.datetime64("2020-12-16", "ns") + np.arange(4) * np.timedelta64(12, "h")})
    for name, values in zip(names, (*at(0.0), *at(0.5)), strict=True):
        east = "lon" in name.lower() or "lam" in name
        ds[name] = ("nlat", "nlon"), values, {"units": "degrees_east" if east else "degrees_north"}
    for name, half in (("uo", 0.5), ("vo", 0.5), ("sst", 0.0)):
        told = {"standard_name": FIELDS[name][0], "units": FIELDS[name][1]}
        ds[name] = ("time", "nlat", "nlon"), np.stack([truth(name, *at(half))] * 4), told
        ds[name].encoding["coordinates"] = listed
    return ds.set_coords(list(names))


def all_right(path: Path) -> str:
    """Check currents and temperature at the elements; return what the run says."""
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 24.0}
    e = elements()
    forcing = forcing_from_files(
        FileForcing(kind="files", files=[path.name], **box), path.parent, Run.of(START, 0.1, e.thickness, 850.0)
    )
    forcing.sample(e, 3600.0)
    for name in ("uo", "vo", "sst"):
        np.testing.assert_allclose(getattr(e, name), truth(name, e.lon, e.lat), atol=2e-3, err_msg=name)
    return "\n".join(forcing.notices)


POP = ("TLONG", "TLAT", "ULONG", "ULAT")


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("names", "listed"),
    [
        (POP, None),
        (POP, "TLAT TLONG ULAT ULONG"),
        (("glamt", "gphit", "glamu", "gphiu"), None),
        (("XLONG", "XLAT", "XLONG_U", "XLAT_U"), None),
        (("lont", "latt", "lonu", "latu"), None),
        (("nav_lon", "nav_lat", "geolon_c", "geolat_c"), None),
    ],
)
def test_a_field_lies_on_its_own_points_of_the_cells(
    tmp_path: Path, names: tuple[str, str, str, str], listed: str | None
) -> None:
    """Currents of POP were taken on the centres: those came first in the alphabet."""
    said = all_right(written(tmp_path, on_two_points(names, listed)))
    assert f"positions of uo are those of {names[3]} and {names[2]}, not of {names[1]} and {names[0]}" in said
    assert f"positions of sst are those of {names[1]} and {names[0]}, not of {names[3]} and {names[2]}" in said


def test_points_that_the_field_names_count_first(tmp_path: Path) -> None:
    ds = on_two_points(POP)
    for name in ("uo", "vo"):
        ds[name].encoding["coordinates"] = "ULONG ULAT"
    assert "positions of uo" not in all_right(written(tmp_path, ds))


@pytest.mark.parametrize("names", [("lon_a", "lat_a", "lon_b", "lat_b"), ("glamt", "gphit", "glamf", "gphif")])
def test_points_that_nothing_tells_apart_are_refused_with_both_named(
    tmp_path: Path, names: tuple[str, str, str, str]
) -> None:
    both = [f"{lat}, {lon}" for lon, lat in sorted([names[:2], names[2:]])]
    path = written(tmp_path, on_two_points(names)[["uo", "vo"]])
    refused(path, f"{both[0]} and {both[1]} both hold positions of uo", remedy="names: {lat: ")
    assert "both hold positions" not in felt(path, names={"lat": names[3], "lon": names[2]})[1]


def test_positions_given_twice_need_no_choice(tmp_path: Path) -> None:
    ds = on_two_points(POP)[["uo", "vo"]]
    ds["ULAT"], ds["ULONG"] = (ds[name].copy(data=ds[other]) for name, other in (("ULAT", "TLAT"), ("ULONG", "TLONG")))
    assert "positions of uo" not in felt(written(tmp_path, ds))[1]
