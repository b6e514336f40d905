"""Good files that are made bad: an experiment, a run, a restart, a KID folder, outlines, tables, fields."""

from __future__ import annotations

import json
import shutil
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from fakes import FakeModel
from kid.conftest import namelist_text, restart_variables, write_nc
from riftberg import build
from riftberg.diagnostics.summary import summarize
from riftberg.runs.run_file import RunWriter
from riftberg.system.atomic_files import write_json

EXPERIMENT = """\
start: 2020-12-09 13:00
days: 0.0625
output_every_hours: 0.5
berg:
  rectangle: {length: 9 km, width: 6 km}
  placement: [-39.0, -55.5]
  thickness: 200
  radius: 1500
  rotation: 10
  velocity: [0.1, 0.0]
  spin: 0
forcing:
  kind: formula
  uniform:
    current: [0.2, 0.0]
    wind: [5, 1]
    slope: [0, 0]
    sea_ice: [0, 0, 0]
    depth: 1000
parameters:
  fracture: {normal_strength: 20 kPa}
"""
RING = [[-39.2, -55.6], [-38.8, -55.6], [-38.8, -55.4], [-39.2, -55.4], [-39.2, -55.6]]
GEOJSON: dict[str, Any] = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"date": "2020-12-10"},
            "geometry": {"type": "Polygon", "coordinates": [RING]},
        }
    ],
}
CSV = "date,vertex,lat,lon\n" + "".join(f"2020-12-10,{k},{y},{x}\n" for k, (x, y) in enumerate(RING))
TRACK = "date,lat,lon\n2020-12-10,-55.0,-39.0\n2020-12-11,-55.1,-38.9\n"
KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>2020-12-10</name>'
    "<Polygon><outerBoundaryIs><LinearRing><coordinates>"
    + " ".join(f"{x},{y},0" for x, y in RING)
    + "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"
)


@cache
def store() -> Path:
    """Folder of the good files, made once in a process."""
    folder = Path(mkdtemp(prefix="riftberg-fuzz-"))
    (folder / "good.yaml").write_text(EXPERIMENT)
    FakeModel(6, 3).advance(2, recorders=[writer := RunWriter(folder / "run.nc", every_hours=6, experiment="fake")])
    model = FakeModel(6, 3)
    model.advance(2)
    write_json(summarize(model, experiment="fake"), folder / "summary.json")  # type: ignore[arg-type]
    assert writer.records > 2
    real, _ = build(str(folder / "good.yaml"))
    real.advance(steps=1)
    real.save(folder / "good.restart.nc")
    write_nc(folder / "case" / "INPUT" / "icebergs.res.nc", restart_variables(3))
    (folder / "case" / "input.nml").write_text(namelist_text({"ibhrs": 1}, {"manually_initialize_bonds": False}))
    write_nc(folder / "case" / "INPUT" / "bonds_iceberg.res.nc", bond_variables())
    write_nc(folder / "case" / "INPUT" / "icebergs.res.nc", identified(restart_variables(3)), drop=("iceberg_num",))
    _fields(folder)
    return folder


def identified(variables: dict[str, Any]) -> dict[str, Any]:
    """Return variables of a restart with identifiers."""
    size = len(variables["lon"])
    return {**variables, "id_cnt": np.arange(1, size + 1, dtype="i4"), "id_ij": np.full(size, 7, dtype="i4")}


def bond_variables() -> dict[str, Any]:
    """Return a bond restart of three elements in a row."""
    first, other = np.array([1, 2, 2, 3], dtype="i4"), np.array([2, 3, 1, 2], dtype="i4")
    order = [0, 2, 1, 3]
    values: dict[str, Any] = {
        "first_id_cnt": first[order], "first_id_ij": np.full(4, 7, "i4"), "other_id_cnt": other[order],
        "other_id_ij": np.full(4, 7, "i4"), "broken": np.zeros(4, "i4"),
    }  # fmt: skip
    return values | {name: np.zeros(4) for name in ("tangd1", "tangd2", "nstress", "sstress", "rel_rotation")}


def _fields(folder: Path) -> None:
    lon, lat = np.arange(-40.0, -37.9, 0.1), np.arange(-56.5, -54.4, 0.1)
    inside = (np.abs(lon + 39.0) < 0.3) & np.ones((lat.size, 1), bool) & (np.abs(lat + 55.5) < 0.15)[:, None]
    coords = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    xr.DataArray(inside.astype("f8"), coords, ("lat", "lon"), "mask", {"date": "2020-12-10"}).to_netcdf(
        folder / "mask.nc"
    )
    time = ("time", np.arange(8) * 6.0, {"units": "hours since 2020-12-09 00:00"})
    made = {}
    for name, standard in (("uo", "eastward_sea_water_velocity"), ("vo", "northward_sea_water_velocity")):
        values = np.full((8, lat.size, lon.size), 0.1)
        made[name] = (("time", "lat", "lon"), values, {"units": "m s-1", "standard_name": standard})
    xr.Dataset(made, {**coords, "time": time}).to_netcdf(folder / "ocean.nc")


def copied(folder: Path, *names: str) -> Path:
    """Copy good files into a folder."""
    for name in names:
        source = store() / name
        if source.is_dir():
            shutil.copytree(source, folder / name)
        else:
            shutil.copyfile(source, folder / name)
    return folder


def summary() -> dict[str, Any]:
    """Return a good summary."""
    made: dict[str, Any] = json.loads((store() / "summary.json").read_text())
    return made


def changed_nc(path: Path, change: Any) -> None:
    """Write a NetCDF file anew with a change of its table of variables and attributes.

    ``change`` takes ``{name: [dtype, dims, values, attributes]}``, the sizes of the dimensions and the global attributes.
    """
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        file.set_auto_chartostring(False)
        kind = file.data_model
        sizes = {name: len(dimension) for name, dimension in file.dimensions.items()}
        table = {
            n: [v.dtype, v.dimensions, v[...], {a: v.getncattr(a) for a in v.ncattrs()}]
            for n, v in file.variables.items()
        }
        attributes = {a: file.getncattr(a) for a in file.ncattrs()}
        extra = {n: v[...] for n, v in file["extra"].variables.items()} if "extra" in file.groups else {}
    table = {f"extra/{n}": [v.dtype, (), v, {}] for n, v in extra.items()} | table
    change(table, sizes, attributes)
    with netCDF4.Dataset(path, "w", format=kind) as file:
        for name, size in sizes.items():
            file.createDimension(name, size)
        file.setncatts(attributes)
        for name, (dtype, dims, values, own) in table.items():
            group = file.createGroup("extra") if name.startswith("extra/") else file
            if group is not file:  # as `riftberg.runs.restart` does: numbers and tables with dimensions of their own
                dims = tuple(f"{name.removeprefix('extra/')}_{axis}" for axis in range(np.ndim(values)))
                for dim, size in zip(dims, np.shape(values), strict=True):
                    group.createDimension(dim, size)
            variable = group.createVariable(
                name.removeprefix("extra/"), dtype, dims, fill_value=own.pop("_FillValue", None)
            )
            variable.set_auto_maskandscale(False)
            variable.set_auto_chartostring(False)
            variable.setncatts(own)
            variable[...] = values
        if extra:
            file.createGroup("extra")
