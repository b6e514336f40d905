"""One-dimensional axes of bent grids are no positions: the true ones are taken, or nominal ones where they hold, and told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from products.test_odd_files import CENTRE, START, elements, plain, refused, truth, written
from riftberg.errors import ForcingError
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import open_product

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


@pytest.mark.parametrize("north", [120.0, 113.0])
def test_nominal_axes_alone_are_refused_in_the_north(tmp_path: Path, north: float) -> None:
    ds = bent(MOM6, None, bend=0.0)
    ds = ds.assign_coords(yh=("yh", ds["yh"].values + north, ds["yh"].attrs))
    with pytest.raises(ForcingError, match="nominal axes: north of 60 N"):
        felt(written(tmp_path, ds), north + 3.0)


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
