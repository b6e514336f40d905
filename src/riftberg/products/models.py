"""Reanalyses of the atmosphere, models on grids of their own, and the forcing files of the A68a experiment.

NCEP reanalyses, JRA-55 and ERA5; ROMS and CROCO, NEMO, FVCOM, FESOM, WRF.

Models on grids of their own are checked against real files of ROMS (Nordic-4km), CROCO (Benguela), NEMO (ORCA025, U and V on
their own points) and FVCOM (LEOFS); FESOM and WRF follow their documentation. Components along the grid are turned with the
angle of the file, or with the directions of the grid's own positions; levels that follow the sea floor become depths.

Forcing files of the A68a experiment (Huth et al. 2022) have a 1/8 degree grid and the fields uo, vo | SSH | ua, va |
taux, tauy | elevation. Checked against the real monthly files (ORAS5, JRA-55, GEBCO). The hourly files come in two forms: with
``lon``, ``lat`` and ``time``, or bare. Bare files get their positions from the grid file ``*_grid.nc`` beside them, read as
the model's driver reads it (its positions are the north-east corners of cells, where currents and winds live; sea level lives
half a cell to the south-west), and their hours from the month in their name (record 1 = first of the month, 00:00). A single
record without time means a field constant in time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.products.cf import USUAL_NAMES, find_role
from riftberg.products.oceans import depth_from_elevation
from riftberg.products.place import is_nominal_name
from riftberg.products.product import Evidence, Heading, Product, Source, noted, without_single
from riftberg.state import Ints
from riftberg.system.input_files import is_address
from riftberg.system.netcdf_lock import open_lazily

# NCEP reanalyses, 10 m wind on the T62 Gaussian grid: NCEP/NCAR NCEP_R1 and NCEP/DOE NCEP_R2 (NOAA PSL).
#
# NCEP_R1 was checked against a real file of the same layout (air.2m.gauss) and a published header of uwnd.10m.gauss; NCEP_R2
# (singleton ``level``, packed) follows the documentation. Latitudes are irregular and descend; old copies count hours
# since 1-1-1 on the mixed Julian/Gregorian calendar, which xarray decodes.

_NCEP_WINDS = (Source("ua", ("uwnd",), "m/s"), Source("va", ("vwnd",), "m/s"))
_HEADINGS = ("title", "dataset", "dataset_title", "description", "source", "References")


def _stated_here(heading: Heading) -> str:
    variables = " ".join(str(variable.get("dataset", "")) for variable in heading.variables.values()).lower()
    return f"{heading.says(*_HEADINGS)} {variables}"


def _is_ncep_r2(heading: Heading) -> bool:
    words = _stated_here(heading)
    is_named = any(word in words for word in ("reanalysis-2", "reanalysis 2", "ncep/doe", "reanalysis2"))
    return is_named or (("uwnd" in heading.names or "vwnd" in heading.names) and heading.sizes.get("level", 0) == 1)


def _is_ncep_r1(heading: Heading) -> bool:
    words = _stated_here(heading)
    is_named = any(word in words for word in ("nmc reanalysis", "ncep reanalysis", "ncep/ncar"))
    winds = bool({"uwnd", "vwnd"} & heading.names) and {"lat", "lon"} <= set(heading.sizes)
    return (is_named or winds) and not _is_ncep_r2(heading)


def _at_ten_metres(ds: xr.Dataset) -> xr.Dataset:
    """Refuse winds that are not at 10 m; their level, if they have one, is judged later."""
    for name in {"uwnd", "vwnd"} & set(ds.variables):
        words = " ".join(str(ds[name].attrs.get(key, "")) for key in ("long_name", "level_desc", "var_desc")).lower()
        if "sigma" in words or "pressure" in words or "995" in words:
            raise ForcingError(
                f"{name} is not the wind at 10 m ({words.strip()})",
                where=str(ds.encoding.get("source", "")),
                remedy="Use the files uwnd.10m.gauss.YYYY.nc and vwnd.10m.gauss.YYYY.nc of the folder surface_gauss",
            )
    return ds


_NCEP_NOTES = ("6-hourly values at their stamp", "about 200 km resolution: the wind is smooth over a berg")

NCEP_R1 = Product(
    name="ncep-r1",
    title="NCEP/NCAR Reanalysis 1, 10 m wind, 6-hourly",
    citation="Kalnay et al. 1996, Bull. Am. Meteorol. Soc. 77, 437; data provided by NOAA PSL, Boulder, https://psl.noaa.gov",
    evidence="layout",
    matches=_is_ncep_r1,
    sources=_NCEP_WINDS,
    reshape=_at_ten_metres,
    longest_step=SECONDS_PER_DAY,
    notes=(*_NCEP_NOTES, "a real file of the same layout was read too, but of the air temperature at 2 m"),
)
NCEP_R2 = Product(
    name="ncep-r2",
    title="NCEP/DOE Reanalysis 2, 10 m wind, 6-hourly",
    citation="Kanamitsu et al. 2002, Bull. Am. Meteorol. Soc. 83, 1631; data provided by NOAA PSL, Boulder, https://psl.noaa.gov",
    evidence="documentation",
    matches=_is_ncep_r2,
    sources=_NCEP_WINDS,
    reshape=_at_ten_metres,
    longest_step=SECONDS_PER_DAY,
    notes=_NCEP_NOTES,
)


# JRA-55 (GRIB converted by NCL) and JRA55-do (input4MIPs) 10 m wind.
#
# Written from documentation only: no original file was to be had (the JRA-55 fields of the A68a experiment are another
# layout, see `riftberg.products.models`).


_JRA55_EAST = ("UGRD_GDS4_HTGL", "UGRD_GDS0_HTGL", "uas", "uas_10m")
_JRA55_NORTH = ("VGRD_GDS4_HTGL", "VGRD_GDS0_HTGL", "vas", "vas_10m")


def _is_jra55(heading: Heading) -> bool:
    names = heading.names
    # NCL makes these names from the tables of GRIB; no other converter does.
    if any(str(name).startswith(("UGRD_GDS", "VGRD_GDS")) for name in names):
        return True
    return bool(names & {*_JRA55_EAST, *_JRA55_NORTH}) and "jra" in heading.says(
        "source_id", "source", "title", "institution_id"
    )


def _with_ncl_axes_named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes of NCL's conversion from GRIB."""
    axes = {}
    for name in ds.dims:
        text = str(name)
        if text.startswith("initial_time"):
            axes[name] = "time"
        elif text.startswith(("g4_lat", "g0_lat")):
            axes[name] = "lat"
        elif text.startswith(("g4_lon", "g0_lon")):
            axes[name] = "lon"
    return ds.rename(axes)


JRA55 = Product(
    name="jra55",
    title="JRA-55 or JRA55-do, 10 m wind",
    citation="Kobayashi et al. 2015, J. Meteorol. Soc. Japan 93, 5; Tsujino et al. 2018, Ocean Modell. 130, 79",
    evidence="documentation",
    matches=_is_jra55,
    sources=(Source("ua", _JRA55_EAST, "m s-1"), Source("va", _JRA55_NORTH, "m s-1")),
    reshape=_with_ncl_axes_named,
    longest_step=SECONDS_PER_DAY,
    notes=("values at their stamp: 6-hourly (JRA-55) or 3-hourly (JRA55-do)",),
)


# ERA5 single levels (ECMWF, Climate Data Store): wind, stress, waves, sea ice, sea surface temperature.
#
# Three layouts: the old store (packed int16, hours since 1900; checked against a real file of wind and sea surface
# temperature), the new store
# (``valid_time``, ``number``, ``expver``; checked against a published header) and the ARCO Zarr stores (long names;
# documentation only).


_ERA5_FIELDS = (
    Source("ua", ("u10", "10m_u_component_of_wind"), "m s-1"),
    Source("va", ("v10", "10m_v_component_of_wind"), "m s-1"),
    Source("taux", ("iews", "avg_iews", "metss", "avg_ttss_x"), "N m-2", "documentation"),
    Source("tauy", ("inss", "avg_inss", "mntss", "avg_ttss_y"), "N m-2", "documentation"),
    Source("sst", ("sst", "sea_surface_temperature"), "K"),
    Source("ice_fraction", ("siconc", "ci", "sea_ice_cover"), "1", "documentation"),
    Source("wave_height", ("swh", "significant_height_of_combined_wind_waves_and_swell"), "m", "documentation"),
    Source("wave_period", ("mwp", "mean_wave_period", "mp2", "mp1"), "s", "documentation"),
    Source("wave_direction", ("mwd", "mean_wave_direction"), "degree", "documentation"),
)
_ERA5_NAMES = {"u10", "v10", "swh", "mwp", "mwd", "iews", "inss", "siconc", "ci", "sst"}


def _is_era5(heading: Heading) -> bool:
    names = heading.names
    words = heading.says("history", "institution", "GRIB_centre", "title", "source")
    ecmwf = any(word in words for word in ("grib_to_netcdf", "ecmf", "era5", "ecmwf", "cfgrib", "earthkit"))
    arco = (
        any(name.startswith("10m_u_component") for name in names)
        or "significant_height_of_combined_wind_waves_and_swell" in names
    )
    # By its names alone a file is one of ERA5 only where it holds nothing that ERA5 does not have.
    bare = {"u10", "v10"} <= names and not names & (USUAL_NAMES - _ERA5_NAMES)
    return arco or (bool(_ERA5_NAMES & names) and (ecmwf or "valid_time" in heading.sizes or bare))


def _one_version(ds: xr.Dataset) -> xr.Dataset:
    """Name the time axis, join final and preliminary version (old store: dimension ``expver``)."""
    if "expver" in ds.dims:
        versions = [ds.isel(expver=k, drop=True) for k in range(ds.sizes["expver"])]
        ds = versions[0]
        # The first version is the final one; the preliminary one fills the months that it does not have yet.
        for later in versions[1:]:
            ds = ds.fillna(later)
    if "valid_time" in ds.dims:
        # With both names, ``time`` is the start of the forecast and not the date of the values.
        ds = ds.drop_vars("time", errors="ignore").rename({"valid_time": "time"})
    if ds.sizes.get("number", 1) > 1:
        ds = without_single(ds, "number", remedy="This is an ensemble: ask for the product type 'reanalysis'")
    return ds.drop_vars("expver", errors="ignore")


ERA5 = Product(
    name="era5",
    title="ERA5 hourly data on single levels",
    citation="Hersbach et al. 2020, Q. J. R. Meteorol. Soc. 146, 1999; Copernicus C3S, doi:10.24381/cds.adbb2d47",
    evidence="sample",
    matches=_is_era5,
    sources=_ERA5_FIELDS,
    reshape=_one_version,
    longest_step=SECONDS_PER_DAY,
    variants=(("new Climate Data Store", "layout"), ("ARCO Zarr store", "documentation")),
    notes=(
        "instantaneous values at their stamp; monthly means (GRIB_stepType avgua, avgad) in mid-month",
        "mean wave direction is the direction the waves come FROM",
        "waves come on a half-degree grid in a file of their own",
    ),
)


_CITATION = "see the file"


def _is_roms(heading: Heading) -> bool:
    dims = set(heading.sizes)
    fields = {"u", "v", "u_eastward", "v_northward", "zeta", "h", "aice", "uice", "Uwind"}
    return bool(dims & {"xi_rho", "xi_u", "xi_v"}) and bool(fields & heading.names)


def _with_grid(ds: xr.Dataset) -> xr.Dataset:
    """Take positions, angle and depth from a grid file in the same folder where the file itself lacks them."""
    where = str(ds.encoding.get("source", ""))
    if {"lat_rho", "lon_rho"} <= set(ds.variables) or not where or is_address(where):
        return ds
    fields = ("lat_rho", "lon_rho", "lat_u", "lon_u", "lat_v", "lon_v", "angle", "h")
    sizes = {dim: size for dim, size in ds.sizes.items() if str(dim).startswith(("xi_", "eta_"))}
    grid = find_grid(
        ds, ("*[gG][rR][dD]*.nc*", "*[gG][rR][iI][dD]*.nc*"), fields,
        lambda other: all(other.sizes.get(dim, size) == size for dim, size in sizes.items()),
    )  # fmt: skip
    if grid is not None:
        added = {name: grid[name] for name in grid.variables if name not in ds.variables}
        return noted(_shared_dims(ds, ds.assign(added)), told=grid.attrs["told"])
    raise ForcingError(
        "has no positions (lat_rho, lon_rho): they are in the grid file of the model", where=where,
        remedy="Put the grid file (*_grd.nc) of the same size into the same folder",
    )  # fmt: skip


def _shared_dims(original: xr.Dataset, ds: xr.Dataset) -> xr.Dataset:
    """Give u and v of CROCO, on (eta_rho, xi_u) and (eta_v, xi_rho), the positions on (eta_u, xi_u) and (eta_v, xi_v)."""
    for name in [n for n in ds.variables if n not in original.variables]:
        for old, new in (("eta_u", "eta_rho"), ("xi_v", "xi_rho")):
            if old in ds[name].dims and old not in original.dims:
                ds = ds.assign(
                    {name: ((*(new if d == old else d for d in ds[name].dims),), ds[name].values, ds[name].attrs)}
                )
    return ds


def _staggered(ds: xr.Dataset) -> xr.Dataset:
    """Give u and v positions half-way between the cells where the file leaves them out or holds zeros."""
    for name, axis in (("u", "xi_"), ("v", "eta_")):
        if name not in ds.variables or not {"lat_rho", "lon_rho"} <= set(ds.variables):
            continue
        dims = [str(dim) for dim in ds[name].dims if str(dim).startswith(("eta_", "xi_"))]
        lat, lon = f"lat_{name}", f"lon_{name}"
        # Some versions write positions of u and v that are 0 throughout: these are none.
        if len(dims) != 2 or (lat in ds.variables and lon in ds.variables and np.ptp(ds[lat].values) > 0.0):
            continue
        shift = next(k for k, dim in enumerate(dims) if dim.startswith(axis))
        expected = list(ds["lat_rho"].shape)
        expected[shift] -= 1
        if [ds.sizes[dim] for dim in dims] == expected:
            positions = {}
            for target, rho in ((lat, "lat_rho"), (lon, "lon_rho")):
                values = np.asarray(ds[rho].values, float)
                halves = [np.take(values, range(k, k + expected[shift]), axis=shift) for k in (0, 1)]
                # The short way round, for the two may stand on either side of the seam.
                step = (halves[1] - halves[0] + 180.0) % 360.0 - 180.0
                positions[target] = (tuple(dims), halves[0] + 0.5 * step, ds[rho].attrs)
            ds = ds.drop_vars([lat, lon], errors="ignore").assign_coords(positions)
            ds[name].encoding["coordinates"] = f"{lon} {lat}"
    return ds


_ROMS_FIELDS = (
    Source("uo", ("u_eastward", "u"), "m s-1"),
    Source("vo", ("v_northward", "v"), "m s-1"),
    Source("ssh", ("zeta",), "m"),
    Source("sst", ("temp",), "degrees_C"),
    Source("sss", ("salt",), "1e-3"),
    Source("ua", ("Uwind_eastward", "Uwind"), "m s-1"),
    Source("va", ("Vwind_northward", "Vwind"), "m s-1"),
    Source("ice_fraction", ("aice",), "1"),
    Source("ice_thickness", ("hice",), "m"),
    Source("ui", ("uice_eastward", "uice"), "m s-1"),
    Source("vi", ("vice_northward", "vice"), "m s-1"),
    Source("depth_below_surface", ("h",), "m"),
)
_KNOWN_OVER_LAND = ("ua", "va", "depth_below_surface")


def _without_land(ds: xr.Dataset) -> xr.Dataset:
    """Turn values of the sea where the masks of the model say land into missing ones: the model writes zeros there."""
    of_sea = {name for field in _ROMS_FIELDS if field.quantity not in _KNOWN_OVER_LAND for name in field.names}
    for name in [n for n in ds.data_vars if n in of_sea]:
        for mask in ("mask_rho", "mask_u", "mask_v"):
            if mask in ds.variables and set(ds[mask].dims) <= set(ds[name].dims) and ds[mask].ndim == 2:
                ds = ds.assign({name: ds[name].where(ds[mask] > 0.5).assign_attrs(ds[name].attrs)})
    return ds


ROMS = Product(
    name="roms",
    title="Output of ROMS or CROCO",
    citation=_CITATION,
    evidence="sample",
    matches=_is_roms,
    sources=_ROMS_FIELDS,
    reshape=lambda ds: _without_land(_staggered(_with_grid(ds))),
    notes=(
        "u and v are brought to the points of u and turned with the angle of the file",
        "levels that follow the sea floor are interpolated to depths",
    ),
)


def _is_nemo(heading: Heading) -> bool:
    fields = {
        "vozocrtx", "vomecrty", "vozocrte", "vomecrtn", "sossheig", "uos", "vos", "uo", "vo", "zos", "ssh", "siconc",
    }  # fmt: skip
    return {"nav_lat", "nav_lon"} <= heading.names and bool(fields & heading.names)


NEMO = Product(
    name="nemo",
    title="Output of NEMO on its own grid (ORCA and others, also IPSL)",
    citation=_CITATION,
    evidence="sample",
    matches=_is_nemo,
    sources=(
        Source("uo", ("vozocrte", "uoe", "uo", "vozocrtx", "uos"), "m s-1"),
        Source("vo", ("vomecrtn", "von", "vo", "vomecrty", "vos"), "m s-1"),
        Source("ssh", ("sossheig", "zos", "ssh"), "m"),
        Source("sst", ("sosstsst", "tos", "sst"), "degC"),
        Source("sss", ("sosaline", "sos", "sss"), "1e-3"),
        Source("taux", ("tauuo", "sozotaux"), "Pa"),
        Source("tauy", ("tauvo", "sometauy"), "Pa"),
        Source("ice_fraction", ("siconc", "ileadfra", "soicecov"), "1"),
        Source("ice_thickness", ("sithick", "iicethic"), "m"),
        Source("depth_below_surface", ("deptho", "bathymetry", "Bathymetry"), "m"),
    ),
    notes=("U and V stand on points of their own: give both files; they are brought together and turned",),
)


def _is_fvcom(heading: Heading) -> bool:
    return {"nv", "lonc"} <= heading.names or ("nele" in heading.sizes and "node" in heading.sizes)


def _even_levels(ds: xr.Dataset) -> xr.Dataset:
    """Turn levels that are the same share of the water everywhere, stored for each node, into one axis."""
    for name in ("siglay",):
        if name in ds.variables and ds[name].ndim == 2:
            values = np.asarray(ds[name].transpose(name, ...).values, float)
            if np.ptp(values, axis=1).max() > 0.02:
                raise ForcingError(
                    f"the levels {name} differ from node to node", where=str(ds.encoding.get("source", "")),
                    remedy="Interpolate them to depths first, or give the surface: ncks -d siglay,0 FILE OUT",
                )  # fmt: skip
            attributes = {
                "standard_name": "ocean_sigma_coordinate",
                "positive": "up",
                "formula_terms": f"sigma: {name} depth: h",
            }
            ds = ds.drop_vars(name).assign_coords({name: (name, np.median(values, axis=1), attributes)})
    return ds


FVCOM = Product(
    name="fvcom",
    title="Output of FVCOM on its triangles",
    citation=_CITATION,
    evidence="sample",
    matches=_is_fvcom,
    sources=(
        Source("uo", ("u",), "m s-1"),
        Source("vo", ("v",), "m s-1"),
        Source("ssh", ("zeta",), "m"),
        Source("ua", ("uwind_speed",), "m s-1"),
        Source("va", ("vwind_speed",), "m s-1"),
        Source("depth_below_surface", ("h",), "m"),
    ),
    reshape=_even_levels,
    notes=("values of the three nearest points, weighted by the inverse square of their distance",),
)


def _is_wrf(heading: Heading) -> bool:
    return {"XLAT", "XLONG"} <= heading.names and bool({"U10", "V10"} & heading.names)


def _fixed_grid(ds: xr.Dataset) -> xr.Dataset:
    """Drop the time of positions that do not move; refuse a nest that does."""
    for name in ("XLAT", "XLONG", "COSALPHA", "SINALPHA"):
        if name in ds.variables and ds[name].ndim == 3:
            moving = ds[name]
            # Positions are single precision: this is their rounding, some ten metres.
            if np.ptp(moving.values, axis=0).max() > 1e-4:
                raise ForcingError(
                    "the grid moves", where=str(ds.encoding.get("source", "")), remedy="Give a fixed domain"
                )
            ds = ds.drop_vars(name).assign({name: moving.reset_coords(drop=True).isel({moving.dims[0]: 0})})
    return ds


WRF = Product(
    name="wrf",
    title="Output of WRF, 10 m wind",
    citation=_CITATION,
    evidence="documentation",
    matches=_is_wrf,
    sources=(Source("ua", ("U10",), "m s-1"), Source("va", ("V10",), "m s-1")),
    reshape=_fixed_grid,
    notes=("U10 and V10 follow the grid: they are turned with COSALPHA and SINALPHA",),
)


def _is_fesom(heading: Heading) -> bool:
    words = "fesom" in heading.says("title", "source", "model", "Conventions", "history")
    return bool({"nod2", "ncells", "nodes_2d", "elem"} & set(heading.sizes)) or words


FESOM = Product(
    name="fesom",
    title="Output of FESOM on its triangles",
    citation=_CITATION,
    evidence="documentation",
    matches=lambda heading: (
        _is_fesom(heading) and bool({"u", "v", "unod", "vnod", "ssh", "a_ice", "uice"} & heading.names)
    ),
    sources=(
        Source("uo", ("unod", "u"), "m s-1"),
        Source("vo", ("vnod", "v"), "m s-1"),
        Source("ssh", ("ssh",), "m"),
        Source("ice_fraction", ("a_ice",), "1"),
        Source("ui", ("uice",), "m s-1"),
        Source("vi", ("vice",), "m s-1"),
    ),
    notes=(
        "positions must be in the file: cdo -setgrid,mesh.nc FILE OUT writes them",
        "values of the three nearest points, weighted by the inverse square of their distance",
    ),
)


_SAME = ("h", "mask_rho", "mask_u", "mask_v")
"""Fields of a grid that output often repeats, by which a grid is known to be its own."""


def find_grid(
    ds: xr.Dataset, patterns: Sequence[str], fields: Sequence[str], fits: Callable[[xr.Dataset], bool]
) -> xr.Dataset | None:
    """Return the fields of the one grid file beside a file; None if there is none."""
    where = str(ds.encoding.get("source", ""))
    folder = Path(where).parent
    grid_name = Path(str(ds.attrs.get("grd_file", ""))).name
    stated = bool(grid_name) and (folder / grid_name).is_file()
    files = sorted({path for pattern in patterns for path in folder.glob(pattern)} - {Path(where)})
    alike: dict[str, xr.Dataset] = {}
    proven: dict[str, xr.Dataset] = {}
    others: list[str] = []
    for path in [folder / grid_name] if stated else files:
        try:
            # Times of a grid file matter to nobody, and those of a stray file may be none.
            with open_lazily(path, decode_times=False) as opened:
                if not set(fields[:2]) <= set(opened.variables):
                    continue
                common = [name for name in _SAME if name in ds.variables and name in opened.variables]
                shared = [name for name in common if 0 < ds[name].ndim == opened[name].ndim]
                if not fits(opened) or not all(_alike(ds[name], opened[name]) for name in shared):
                    others.append(path.name)
                    continue
                loaded = opened[[name for name in fields if name in opened.variables]].load().reset_coords()
        except Exception:  # a neighbour that cannot be read is no grid of this file
            others.append(path.name)
            continue
        (proven if shared or stated else alike)[path.name] = loaded
    # Grids that share a field with the file go before those of the same size only.
    fitting = proven or alike
    names, remedy = ", ".join(fitting or others), "Put its own grid file, and no other, into the same folder"
    if not fitting and not others:
        return None
    if not fitting:
        fault = f"the grid files beside it are those of another grid, or cannot be read: {names}"
        raise ForcingError(fault, where=where, remedy=remedy)
    # Of the same size is no proof where the file names a grid that is not there.
    if grid_name and not proven:
        fault = (
            f"its positions are in its grid file {grid_name}, which is not beside it; {names} may be that of another"
        )
        raise ForcingError(fault, where=where, remedy=remedy)
    first = next(iter(fitting.values()))
    if not all(_alike(grid[name], first[name]) for grid in fitting.values() for name in fields[:2]):
        raise ForcingError(f"{len(fitting)} different grids beside it fit: {names}", where=where, remedy=remedy)
    by = "named in the file" if stated else "of the same sea floor or mask" if proven else "of the same size"
    return first.assign_attrs(told=f"positions are those of the grid file {next(iter(fitting))}, {by}")


def with_static_grid(ds: xr.Dataset) -> xr.Dataset:
    """Give output of MOM on nominal axes alone the true positions, by the static file in the same folder.

    The rows and columns are known by the nominal axes of both files, so that a part of the grid finds its own.
    """
    where = str(ds.encoding.get("source", ""))
    axes = [dim for dim in ds.dims if dim in ds.variables and is_nominal_name(str(dim))]
    if len(axes) < 2 or not where or is_address(where) or any("geolon" in str(name) for name in ds.variables):
        return ds
    beside = Path(where).parent
    for path in sorted(
        {path for pattern in ("*static*", "*grid*", "*geometry*") for path in beside.glob(f"{pattern}.nc*")}
    ):
        try:
            with open_lazily(path, decode_times=False) as opened:
                names = [name for name in opened.variables if re.match(r"geol(at|on)", str(name))]
                loaded = opened[names].load().reset_coords()
        except Exception:  # a neighbour that cannot be read is no grid of this file
            continue
        rows = {dim: _find_rows(loaded, ds, dim) for dim in axes if dim in loaded.dims and dim in loaded.variables}
        chosen = loaded.isel({dim: index for dim, index in rows.items() if index is not None})
        fitting = [n for n in names if all(rows.get(dim) is not None for dim in loaded[n].dims)]
        if fitting:
            ds = ds.assign({n: (chosen[n].dims, chosen[n].values, chosen[n].attrs) for n in fitting})
            return noted(ds, told=f"true positions are those of the grid file {path.name}, by its axes")
    return ds


def _find_rows(grid: xr.Dataset, ds: xr.Dataset, dim: Hashable) -> Ints | None:
    """Return at which rows of a grid the values of an axis stand; None if one stands at none."""
    differences = np.abs(np.subtract.outer(ds[dim].values.astype(float), grid[dim].values.astype(float)))
    rows = np.argmin(differences, axis=1)
    return rows if differences.min(axis=1).max(initial=0.0) < 1e-4 else None


def _alike(a: xr.DataArray, b: xr.DataArray) -> bool:
    return a.shape == b.shape and bool(np.allclose(a.values, b.values, rtol=1e-3, atol=1e-3, equal_nan=True))


_A68A_FIELDS = {"uo", "vo", "SSH", "ssh_bgrid", "ua", "va", "taux", "tauy", "elevation"}
_AT_CENTRES = {"SSH", "elevation"}
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")

_A68A_FILES = re.compile(rf"a68_experiment|({'|'.join(_MONTHS)})\d{{4}}_hourly", re.IGNORECASE)
"""Names of the files of the experiment."""

_A68A_GRID = {"lat": 152, "lon": 232}
"""Its grid."""


def _has_a68a_name(heading: Heading) -> bool:
    return _A68A_FILES.search(Path(heading.source).name) is not None


def _is_a68a(heading: Heading) -> bool:
    """Tell the bare style: fields named as in the model, no units; by its name or grid, for others have no units too."""
    if not _has_a68a_name(heading) and {name: heading.sizes.get(name) for name in _A68A_GRID} != _A68A_GRID:
        return False
    present = _A68A_FIELDS & heading.names
    bare = present and all(
        "units" not in heading.variables[name] and "Unit" not in heading.variables[name] for name in present
    )
    alone = not (USUAL_NAMES - _A68A_FIELDS) & heading.names  # a file of others has fields that these never have
    return (
        bool(bare)
        and alone
        and {"lat", "lon"} <= set(heading.sizes)
        and not str(heading.attributes.get("title", "")).startswith("The GEBCO")
    )


def _add_positions(ds: xr.Dataset) -> xr.Dataset:
    """Give the file its latitudes and longitudes, at cell centres where the field lives there."""
    centred = bool(_AT_CENTRES & set(map(str, ds.data_vars)))
    if {"actual_lon", "actual_lat"} <= set(ds.variables) and centred:
        lon, lat = ds["actual_lon"].values, ds["actual_lat"].values
        return ds.drop_vars(["actual_lon", "actual_lat"]).assign_coords(lon=("lon", lon), lat=("lat", lat))
    along = {
        find_role(name, variable) for name, variable in ds.variables.items() if {"lat", "lon"} & set(variable.dims)
    }
    if {"lon", "lat"} <= set(ds.variables) or {"lat", "lon"} <= along:  # its own, or those of other variables
        return ds
    where = str(ds.encoding.get("source", ""))
    size = ds.sizes["lat"], ds.sizes["lon"]
    names = ("longitude", "latitude")
    grid = find_grid(ds, ("*_grid.nc",), names, lambda other: other["latitude"].shape == size) if where else None
    if grid is None and not _has_a68a_name(Heading.of(ds)):
        return ds  # not a file of the experiment: what it lacks is said in general words
    if grid is None:
        raise ForcingError(
            "has no positions", where=where, remedy="Put the experiment's grid file *_grid.nc in the same folder"
        )
    lon, lat = grid["longitude"].values[0], grid["latitude"].values[:, 0]
    shift = 0.5 * (lon[1] - lon[0]) if centred else 0.0
    ds = noted(ds, told=grid.attrs["told"])
    return ds.assign_coords(lon=("lon", lon - shift), lat=("lat", lat - shift))


def _dated(ds: xr.Dataset) -> xr.Dataset:
    """Date the hourly records of a bare file by the month in its name; drop the time of a single undated record."""
    if "time" not in ds.dims or "since" in str(ds.variables.get("time", xr.Variable((), 0)).attrs.get("units", "")):
        return ds
    if ds.sizes["time"] == 1:
        return ds.isel(time=0, drop=True)
    where = str(ds.encoding.get("source", ""))
    match = re.search(rf"({'|'.join(_MONTHS)})(\d{{4}}).*hourly", Path(where).name, re.IGNORECASE)
    if match is None:
        remedy = "Write time units on it, or keep the original name with month and HOURLY (dec2020_HOURLY)"
        raise ForcingError("has records without dates", where=where, remedy=remedy)
    units = f"hours since {match[2]}-{1 + _MONTHS.index(match[1].lower()):02d}-01 00:00:00"
    hours = np.arange(ds.sizes["time"])
    return ds.assign_coords(time=("time", hours, {"units": units, "calendar": "standard"}))


def _mend_a68a(ds: xr.Dataset) -> xr.Dataset:
    """Give the file the positions and dates that it leaves out."""
    return _dated(_add_positions(ds))


def _without_zeros(ds: xr.Dataset) -> xr.Dataset:
    """Turn the zeros that stand for land into NaN: both currents exactly zero in an unpacked field.

    Packed files are left alone: there a zero may be slack water rounded to the packing step.
    """
    if {"uo", "vo"} <= set(ds.data_vars) and "scale_factor" not in ds["uo"].encoding:
        wet = (ds["uo"] != 0.0) | (ds["vo"] != 0.0)
        return ds.assign({name: ds[name].where(wet) for name in ("uo", "vo")})
    return ds


def _finish_a68a(ds: xr.Dataset) -> xr.Dataset:
    return depth_from_elevation(_without_zeros(ds))


def _a68a_sources(east: str, north: str) -> tuple[Source, ...]:
    return (
        Source("uo", (east,), "m s-1"),
        Source("vo", (north,), "m s-1"),
        Source("ssh", ("SSH", "ssh_bgrid"), "m"),
        Source("ua", ("ua",), "m s-1"),
        Source("va", ("va",), "m s-1"),
        Source("taux", ("taux",), "Pa"),
        Source("tauy", ("tauy",), "Pa"),
        Source("depth_below_surface", ("elevation",), "m"),
    )


_A68A_CAUTIONS = ("units are not in the files: m s-1, m and Pa are taken, as the experiment does",)
_A68A_NOTES = (
    "currents of exactly zero in unpacked files are land",
    "sea level and depth live at cell centres, currents and winds at cell corners",
    "bare hourly files have no positions: those of the grid file are taken as corners, as the experiment's driver does",
)
_HUTH = "Huth, Adcroft, Sergienko and Khan 2022, Sci. Adv. 8, eabq6974, doi:10.1126/sciadv.abq6974"

_A68A_VARIANTS: tuple[tuple[str, Evidence], ...] = (("hourly files", "documentation"),)

A68A = Product(
    name="a68a",
    title="Forcing files of the A68a experiment of Huth et al. (2022)",
    citation=_HUTH,
    evidence="sample",
    matches=_is_a68a,
    sources=_a68a_sources("uo", "vo"),
    mend=_mend_a68a,
    finish=_finish_a68a,
    longest_step=31 * SECONDS_PER_DAY,
    cautions=_A68A_CAUTIONS,
    notes=_A68A_NOTES,
    variants=_A68A_VARIANTS,
)
A68A_KEEL_MEAN = Product(
    name="a68a-keel-mean",
    title="Forcing files of the A68a experiment, currents averaged from the surface to 200 m",
    citation=_HUTH,
    evidence="sample",
    matches=lambda heading: False,
    sources=_a68a_sources("uo_mean_over_berg_depth", "vo_mean_over_berg_depth"),
    mend=_mend_a68a,
    finish=_finish_a68a,
    longest_step=31 * SECONDS_PER_DAY,
    variants=_A68A_VARIANTS,
    cautions=_A68A_CAUTIONS,
    notes=(*_A68A_NOTES, "uo, vo are means from the surface to 200 m"),
)
