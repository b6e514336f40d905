"""Output of ocean and weather models on grids of their own: ROMS and CROCO, NEMO, FVCOM, FESOM, WRF.

Checked against real files of ROMS (Nordic-4km), CROCO (Benguela), NEMO (ORCA025, U and V on their own points) and FVCOM
(LEOFS); FESOM and WRF follow their documentation. Components along the grid are turned with the angle of the file, or
with the directions of the grid's own positions; levels that follow the sea floor become depths.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.product import Heading, Product, Source, noted
from riftberg.system.input_files import is_address
from riftberg.system.netcdf_lock import open_lazily

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
    wanted = ("lat_rho", "lon_rho", "lat_u", "lon_u", "lat_v", "lon_v", "angle", "h")
    sizes = {dim: size for dim, size in ds.sizes.items() if str(dim).startswith(("xi_", "eta_"))}
    grid = grid_of(
        ds, ("*[gG][rR][dD]*.nc*", "*[gG][rR][iI][dD]*.nc*"), wanted,
        lambda other: all(other.sizes.get(dim, size) == size for dim, size in sizes.items()),
    )  # fmt: skip
    if grid is not None:
        held = {name: grid[name] for name in grid.variables if name not in ds.variables}
        return noted(_shared_dims(ds, ds.assign(held)), told=grid.attrs["told"])
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
    """Give u and v positions half-way between those of the cells where the file leaves them out or holds zeros."""
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
            made = {}
            for own, rho in ((lat, "lat_rho"), (lon, "lon_rho")):
                values = np.asarray(ds[rho].values, float)
                halves = [np.take(values, range(k, k + expected[shift]), axis=shift) for k in (0, 1)]
                # The short way round, for the two may stand on either side of the seam.
                step = (halves[1] - halves[0] + 180.0) % 360.0 - 180.0
                made[own] = (tuple(dims), halves[0] + 0.5 * step, ds[rho].attrs)
            ds = ds.drop_vars([lat, lon], errors="ignore").assign_coords(made)
            ds[name].encoding["coordinates"] = f"{lon} {lat}"
    return ds


def _without_land(ds: xr.Dataset) -> xr.Dataset:
    """Turn values where the masks of the model say land into missing ones."""
    for name in [
        n for n in ds.data_vars if n in ("u", "v", "u_eastward", "v_northward", "zeta", "aice", "hice", "uice", "vice")
    ]:
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
    sources=(
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
    ),
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


def grid_of(
    ds: xr.Dataset, patterns: Sequence[str], wanted: Sequence[str], fits: Callable[[xr.Dataset], bool]
) -> xr.Dataset | None:
    """Return what the one grid file beside a file gives; None if there is none."""
    where = str(ds.encoding.get("source", ""))
    folder = Path(where).parent
    own = Path(str(ds.attrs.get("grd_file", ""))).name
    stated = bool(own) and (folder / own).is_file()
    files = sorted({path for pattern in patterns for path in folder.glob(pattern)} - {Path(where)})
    alike: dict[str, xr.Dataset] = {}
    proven: dict[str, xr.Dataset] = {}
    others: list[str] = []
    for path in [folder / own] if stated else files:
        try:
            # Times of a grid file matter to nobody, and those of a stray file may be none.
            with open_lazily(path, decode_times=False) as opened:
                if not set(wanted[:2]) <= set(opened.variables):
                    continue
                shared = [name for name in _SAME if _comparable(ds, opened, name)]
                if not fits(opened) or not all(_alike(ds[name], opened[name]) for name in shared):
                    others.append(path.name)
                    continue
                held = opened[[name for name in wanted if name in opened.variables]].load().reset_coords()
        except Exception:  # a neighbour that cannot be read is no grid of this file
            others.append(path.name)
            continue
        (proven if shared or stated else alike)[path.name] = held
    # Grids that share a field with the file go before those of the same size only.
    fitting = proven or alike
    names, remedy = ", ".join(fitting or others), "Put its own grid file, and no other, into the same folder"
    if not fitting and not others:
        return None
    if not fitting:
        what = f"the grid files beside it are those of another grid, or cannot be read: {names}"
        raise ForcingError(what, where=where, remedy=remedy)
    # Of the same size is no proof where the file names a grid that is not there.
    if own and not proven:
        what = f"its positions are in its grid file {own}, which is not beside it; {names} may be that of another"
        raise ForcingError(what, where=where, remedy=remedy)
    first = next(iter(fitting.values()))
    if not all(_alike(grid[name], first[name]) for grid in fitting.values() for name in wanted[:2]):
        raise ForcingError(f"{len(fitting)} different grids beside it fit: {names}", where=where, remedy=remedy)
    by = "named in the file" if stated else "of the same sea floor or mask" if proven else "of the same size"
    return first.assign_attrs(told=f"positions are those of the grid file {next(iter(fitting))}, {by}")


def _comparable(ds: xr.Dataset, grid: xr.Dataset, name: str) -> bool:
    return name in ds.variables and name in grid.variables and 0 < ds[name].ndim == grid[name].ndim


def _alike(a: xr.DataArray, b: xr.DataArray) -> bool:
    return a.shape == b.shape and bool(np.allclose(a.values, b.values, rtol=1e-3, atol=1e-3, equal_nan=True))
