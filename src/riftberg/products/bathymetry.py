"""What all bathymetries share: elevation (m, positive up) becomes depth (m, positive down, NaN over land)."""

from __future__ import annotations

import xarray as xr

from riftberg.products.quantities import QUANTITIES, labelled

NOTES = ("elevations are turned into depths, positive down; land is missing (NaN)",)


def depth_from_elevation(ds: xr.Dataset) -> xr.Dataset:
    """Return the dataset with ``depth_below_surface`` made from the elevation that it holds under that name so far.

    ``ds``: canonical dataset in which ``depth_below_surface`` still holds the elevation (m, positive up).
    """
    if "depth_below_surface" not in ds.data_vars:
        return ds
    elevation = ds["depth_below_surface"]
    depth = labelled((-elevation).where(elevation < 0.0), QUANTITIES["depth_below_surface"])
    depth.attrs |= {key: elevation.attrs[key] for key in ("original_name", "original_units") if key in elevation.attrs}
    return ds.assign(depth_below_surface=depth)
