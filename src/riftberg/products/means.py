"""Means whose file states no bounds: where in time they hold, and for how long; what cannot be known is told."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.products.records import DAY_SECONDS, MEAN_OF, named, usual_interval

MONTH = (28 * DAY_SECONDS, 31 * DAY_SECONDS)
"""Lengths (s) of months."""


def in_mid_month(ds: xr.Dataset) -> xr.Dataset:
    """Return monthly means with their stamps in the middle of the month, whatever day the file wrote."""
    months = ds["time"].values.astype("datetime64[M]")
    start, end = months.astype("datetime64[ns]"), (months + 1).astype("datetime64[ns]")
    return _standing_for(ds, (end - start) / np.timedelta64(1, "s"), start + (end - start) / 2)


def _standing_for(ds: xr.Dataset, seconds: NDArray[np.float64], dates: Any) -> xr.Dataset:
    """Return means of so many seconds each, in the middle of them."""
    ds = ds.assign_coords({"time": ("time", dates, ds["time"].attrs), MEAN_OF: ("time", seconds, {"units": "s"})})
    return ds.assign_attrs(averaging_seconds=float(np.median(seconds)))


def settled(ds: xr.Dataset, *, known: bool = False) -> xr.Dataset:
    """Put means without bounds where they hold, and say so, once all records of all files are known.

    Months stamped on their first or last day are put in mid-month, days stamped 00:00 at noon of the day that begins there:
    thus the common services and tools write them. As values of the stamp they would be half an interval off in any case.
    """
    said = str(ds.attrs.get("means", ""))
    if MEAN_OF in ds.coords or float(ds.attrs.get("averaging_seconds", 0.0)) > 0.0:
        return ds
    records = ds["time"].values
    shown = usual_interval(records)
    step = min((s for s in (shown, float(ds.attrs.get("stated_seconds", 0.0))) if s > 0.0), default=0.0)
    of_months = bool(re.fullmatch(r"GRIB_stepType avg\w+", said))  # the hourly kind is plain "avg"
    days = records.astype("datetime64[D]")
    months = records.astype("datetime64[M]")
    first = bool((days == months.astype(days.dtype)).all())
    last = bool((days + 1 == (months + 1).astype(days.dtype)).all())
    stamp = f"on the {'first' if first else 'last'} of the month"
    by_month = MONTH[0] <= step <= MONTH[1] or (of_months and not step)
    if not said:
        if first and by_month and records.size > 1 and not known and "longest_step" not in ds.attrs:
            return _doubted(
                ds, f"records {stamp}, taken as values of these dates: are they means? Then write bounds of time"
            )
        return ds
    if of_months and 0.0 < shown <= DAY_SECONDS:
        raise ForcingError(
            f"monthly means by hour of the day ({said}), which are no course in time", where=named(ds),
            remedy="Give the monthly means of all hours, or hourly data",
        )  # fmt: skip
    if by_month and (first or last):
        return _told(in_mid_month(ds), f"monthly means ({said}) without bounds, stamped {stamp}, are put in mid-month")
    into = np.asarray((records - days.astype(records.dtype)) / np.timedelta64(1, "s"))
    middle = np.full(records.size, 0.5 * step)
    if by_month and step:  # a stamp within two days of the middle is meant as such
        into = np.asarray((records - months.astype(records.dtype)) / np.timedelta64(1, "s"))
        if bool((np.clip(into, 13.0 * DAY_SECONDS, 17.0 * DAY_SECONDS) == into).all()):
            return in_mid_month(ds)
        middle[:] = np.nan
    elif step == DAY_SECONDS and not into.any():
        ds = _standing_for(ds, np.full(records.size, step), records + np.timedelta64(12, "h"))
        return _told(
            ds, f"daily means ({said}) without bounds, stamped 00:00, are put at noon of the day that begins there"
        )
    elif 0.0 < step < DAY_SECONDS:
        into = into % step
    if step and bool((into == middle).all()):
        return _standing_for(ds, np.full(records.size, step), records)
    over = f"over about {step / 3600.0:.3g} h" if step else "over a time that nothing says"
    return _doubted(ds, f"means ({said}) {over} without bounds are taken as values of their stamps")


def _told(ds: xr.Dataset, remark: str) -> xr.Dataset:
    return ds.assign_attrs(told="; ".join(filter(None, [str(ds.attrs.get("told", "")), remark])))


def _doubted(ds: xr.Dataset, doubt: str) -> xr.Dataset:
    return ds.assign_attrs(doubt="; ".join(filter(None, [str(ds.attrs.get("doubt", "")), doubt])))
