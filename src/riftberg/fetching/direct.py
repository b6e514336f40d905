"""Fetching by plain HTTPS, without login or client: NCEP/NCAR R1 wind from NOAA PSL, GEBCO's sea floor from an ERDDAP."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from riftberg.errors import ForcingError
from riftberg.fetching.download import Progress, Resuming, Tell, fetch_one, progressing
from riftberg.system.netcdf_lock import open_netcdf

NCEP_URL = "https://downloads.psl.noaa.gov/Datasets/ncep.reanalysis/surface_gauss/"
GEBCO_URL = "https://coastwatch.pfeg.noaa.gov/erddap/griddap/"
"""ERDDAP of NOAA CoastWatch, which cuts boxes out of the GEBCO_2020 grid; GEBCO itself has no address for that."""
GEBCO_GRID = "GEBCO_2020"
_PER_DEGREE = 240  # 15 arc seconds
_LARGEST = 500e6

Span = tuple[float, float]


def fetch_ncep(
    folder: Path, years: range, *, progress: Progress | bool, tell: Tell, base_url: str = NCEP_URL
) -> list[Path]:
    """Fetch NCEP/NCAR R1 10 m wind of whole years; files that have changed at their source since are fetched again."""
    names = [f"{part}.10m.gauss.{year}.nc" for year in years for part in ("uwnd", "vwnd")]
    with progressing(progress) as show:
        downloader = Resuming(show)
        return [fetch_one(name, None, folder, base_url, downloader, renew=True, tell=tell) for name in names]


def fetch_gebco(
    folder: Path, lon: Span, lat: Span, *, progress: Progress | bool, tell: Tell, base_url: str = GEBCO_URL
) -> list[Path]:
    """Fetch the elevations of GEBCO_2020 over a box, at its full 15 arc seconds; a box that is there is not asked for.

    ``lon``, ``lat``: box (degrees, -180..180).
    """
    _check_box(lon, lat)
    target = folder / f"gebco_2020_{lon[0]:g}_{lon[1]:g}_{lat[0]:g}_{lat[1]:g}.nc"
    if target.exists() and not _fault_of_floor(target, lon, lat):
        return [target]
    cells = [round((ends[1] - ends[0]) * _PER_DEGREE) + 2 for ends in (lon, lat)]
    size = 2.0 * cells[0] * cells[1]
    if size > _LARGEST:
        raise ForcingError(
            f"this box of GEBCO has {size / 1e6:,.0f} MB",
            where="fetch gebco",
            remedy=f"Ask for at most {_LARGEST / 1e6:.0f} MB, or get the whole grid from https://www.gebco.net",
        )
    tell(f"{target.name}: {cells[0]} x {cells[1]} cells, {size / 1e6:.1f} MB")
    with progressing(progress) as show:
        Resuming(show)(base_url + gebco_query(lon, lat), target)
    fault = _fault_of_floor(target, lon, lat)
    if fault:
        target.unlink()
        raise ForcingError(
            fault, where=base_url, remedy="Nothing was kept: run again, or get it from https://www.gebco.net"
        )
    return [target]


def gebco_query(lon: Span, lat: Span) -> str:
    """Return the address, below that of the ERDDAP, of the elevations in a box and one cell around it."""
    ends = []
    for low, high, limit in ((*lat, 90.0), (*lon, 180.0)):
        cell = 1.0 / _PER_DEGREE
        # Ends beyond the outermost pixel centres are refused.
        first, last = max(low - cell, -limit + 0.5 * cell), min(high + cell, limit - 0.5 * cell)
        ends.append(f"%5B({first:.6f}):1:({last:.6f})%5D")
    return f"{GEBCO_GRID}.nc?elevation{''.join(ends)}"


def _check_box(lon: Span, lat: Span) -> None:
    if not (-180.0 <= lon[0] < lon[1] <= 180.0 and -90.0 <= lat[0] < lat[1] <= 90.0):
        raise ForcingError(
            f"{lon[0]:g}..{lon[1]:g} east, {lat[0]:g}..{lat[1]:g} north is no box of the grid",
            where="fetch gebco",
            remedy="Give west before east within -180..180 (two boxes where the date line is crossed), south before north",
        )


def _fault_of_floor(path: Path, lon: Span, lat: Span) -> str:
    """Return what is wrong with a file of elevations over a box; empty = nothing."""
    try:
        with open_netcdf(path) as ds:
            if "elevation" not in ds.variables:
                return "the answer holds no elevations"
            for name, ends in (("longitude", lon), ("latitude", lat)):
                axis = np.asarray(ds[name][:], dtype=float)
                slack = (
                    1.0 / _PER_DEGREE
                )  # a box that ends at the pole or the date line ends half a cell beyond the grid
                if axis.min() > ends[0] + slack or axis.max() < ends[1] - slack:
                    return f"its {name}s run from {axis.min():g} to {axis.max():g}, not over the box"
            # The library reads zeros behind the end of a classic file that was cut.
            least = sum(ds[name].size * ds[name].dtype.itemsize for name in ("elevation", "longitude", "latitude"))
            if ds.data_model.startswith("NETCDF3") and path.stat().st_size < least:
                return f"the answer was cut: {path.stat().st_size:,} of at least {least:,} bytes"
            ds["elevation"][-1, -1]
    except (OSError, RuntimeError, IndexError, ValueError) as error:
        return f"the answer cannot be read ({error})"
    return ""
