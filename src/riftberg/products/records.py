"""Records of a dataset in time: their interval, gaps between them, and records that hold no value at all.

One rule for runs and the doctor: a gap longer than `GAP_FACTOR` times the product's own interval is not
interpolated across. The interval is found from all records of all files, before a window is cut. A record without any
value is a missing record.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.products.quantities import QUANTITIES, doubtful_below, small_unit
from riftberg.system.input_files import reading

Dates = NDArray[np.datetime64]

GAP_FACTOR: Final = 2.5
"""Longest gap that is interpolated across, in intervals of the product: one record may be missing, not two."""

LONGEST_STEP: Final = 31 * SECONDS_PER_DAY
"""Longest interval (s) that records by themselves can show: months."""

REMARKS: Final = ("told", "unread", "doubt")
"""Attributes of a canonical dataset that a run and the doctor repeat: what was chosen, what nothing reads, doubts."""

MEAN_OF: Final = "averaging_period"
"""Coordinate of records that are means: the time (s) that each of them stands for."""

PLACE: Final = "place_among_files"
"""Attribute of a field of a run: the place of its last file among those that were named."""

FEW_RECORDS: Final = 3
"""Fewer records than these show little of their interval."""

LONGEST_OF_FEW: Final = 7 * SECONDS_PER_DAY
"""Fewer records than `FEW_RECORDS` show no interval longer than this."""

VECTORS: Final = (("uo", "vo"), ("ua", "va"), ("taux", "tauy"), ("ui", "vi"))

WAVES: Final = ("wave_height", "wave_period", "wave_direction")

MAY_BE_EMPTY: Final = frozenset({"ice_fraction", "ice_thickness", "ui", "vi", *WAVES, "wave_x", "wave_y"})
"""Sea ice is missing where there is none, and waves where it is: a record without any of it is open water, not a gap."""


class Gap(NamedTuple):
    """Two records that follow one another after a longer time than is allowed."""

    before: np.datetime64
    after: np.datetime64

    @property
    def seconds(self) -> float:
        """Length, s."""
        # In microseconds: three centuries are more nanoseconds than a difference holds.
        return float(
            (self.after.astype("datetime64[us]") - self.before.astype("datetime64[us]")) / np.timedelta64(1, "s")
        )


def usual_interval(records: Dates) -> float:
    """Return the median interval between records (s), of two in the middle the shorter; 0 for one record."""
    if records.size < 2:
        return 0.0
    # In microseconds: three centuries are more nanoseconds than a difference holds.
    steps = np.diff(records.astype("datetime64[us]")) / np.timedelta64(1, "s")
    return float(np.quantile(steps, 0.5, method="lower"))


def own_interval(ds: xr.Dataset) -> float:
    """Return the interval (s) of the product: the shortest that files state, means stand for or records show; 0 if unknown.

    What records show counts up to ``longest_step`` of the product, and up to a week where there are only two. Records
    farther apart are snapshots of something faster, whose interval is taken as a day.
    """
    if "interval_seconds" in ds.attrs:
        return float(ds.attrs["interval_seconds"])
    stated = (ds.attrs.get("stated_seconds", 0.0), ds.attrs.get("averaging_seconds", 0.0))
    known = [float(value) for value in stated if float(value) > 0.0]
    records = ds["time"].values
    few = not known and records.size < FEW_RECORDS
    longest = float(ds.attrs.get("longest_step", LONGEST_OF_FEW if few else LONGEST_STEP))
    longest = max(longest, 1.2 * float(ds.attrs.get("averaging_seconds", 0.0)))  # means are no snapshots
    shown = usual_interval(records)
    shown = shown if shown <= longest else SECONDS_PER_DAY
    return min([*known, *([shown] if shown > 0.0 else [])], default=0.0)


LONGEST_PERIOD: Final = 1e10
"""Three hundred years (s): longer ones are beyond what dates can hold."""


def gap_limit(ds: xr.Dataset) -> float:
    """Return the longest gap (s) that is interpolated across: as noted on the dataset, or by the rule."""
    return min(float(ds.attrs.get("max_gap_seconds", GAP_FACTOR * own_interval(ds))), LONGEST_PERIOD)


def cover_of(ds: xr.Dataset) -> tuple[np.datetime64, np.datetime64]:
    """Return the dates between which records serve: the ends are held as noted, or half the time of a mean."""
    ends = [0, -1]
    halves = 0.5 * (
        ds[MEAN_OF].values[ends] if MEAN_OF in ds.coords else np.full(2, ds.attrs.get("averaging_seconds", 0.0))
    )
    before, after = (min(float(ds.attrs.get("hold_seconds", half)), LONGEST_PERIOD) for half in halves)
    first, last = ds["time"].values[ends].astype("datetime64[us]")
    return first - np.timedelta64(round(before), "s"), last + np.timedelta64(round(after), "s")


def in_python(ds: xr.Dataset) -> bool:
    """Tell whether a dataset was given in Python, where the keys of experiment files are of no use."""
    return bool(ds.attrs.get("in_python", False))


def outside_remedy(ds: xr.Dataset) -> str:
    """Return what to do about dates outside of the records."""
    hold = "hold of from_xarray" if in_python(ds) else "forcing.hold of an experiment file (hours)"
    return f"Give data of these dates, shorten the run, or hold the ends longer: {hold}"


def long_gaps(records: Dates, limit: float, first: np.datetime64, last: np.datetime64) -> list[Gap]:
    """Return the gaps longer than ``limit`` (s) that hold a part of ``first..last``."""
    pairs = (Gap(*pair) for pair in pairwise(records))
    return [gap for gap in pairs if gap.seconds > limit and gap.before < last and gap.after > first]


def check_ends(ds: xr.Dataset, dates: Dates) -> None:
    """Raise `ForcingError` where dates lie before the first or after the last record by more than these are held."""
    records = ds["time"].values
    if not records.size:
        raise ForcingError(
            "the file has no records: its time is empty", where=named(ds), remedy="Make or fetch it again"
        )
    first, last = cover_of(ds)
    moments = dates.astype(first.dtype)
    outside = (moments < first) | (moments > last)
    if outside.any():
        wrong = dates[outside]
        raise ForcingError(
            f"{wrong.size} of {dates.size} dates, the first {minute(wrong[0])}, lie outside the records "
            f"{minute(records[0])}..{minute(records[-1])}",
            where=named(ds),
            remedy=outside_remedy(ds),
        )


def gap_error(ds: xr.Dataset, gap: Gap, limit: float, at: np.datetime64) -> ForcingError:
    """Return the error of a date in too long a gap."""
    fields = ", ".join(map(str, ds.data_vars))
    return ForcingError(
        f"{minute(at)} lies in a gap of {gap.seconds / 86400:.3g} days between {minute(gap.before)} and "
        f"{minute(gap.after)} without values of {fields}; the limit is {limit / 86400:.3g} days",
        where=named(ds),
        remedy="Give the missing records, or allow a longer gap: "
        + ("max_gap of from_xarray" if in_python(ds) else "forcing.max_gap of an experiment file (hours)"),
    )


def check_records(ds: xr.Dataset, first: np.datetime64, last: np.datetime64) -> None:
    """Raise `ForcingError` unless the records serve every moment of ``first..last``."""
    check_ends(ds, np.array([first, last]))
    limit = gap_limit(ds)
    for gap in long_gaps(ds["time"].values, limit, first, last):
        raise gap_error(ds, gap, limit, max(gap.before, first))


def check_pairs(datasets: Sequence[xr.Dataset]) -> None:
    """Raise `ForcingError` where one component of a vector is given without the other: it would count as 0."""
    for ds in datasets:
        for pair in VECTORS:
            components = [name for name in pair if name in ds.data_vars]
            if len(components) == 1:
                other = pair[1 - pair.index(components[0])]
                nothing, the = ("nothing", "the") if in_python(ds) else ("no file", "the file with")
                raise ForcingError(
                    f"gives {components[0]} and {nothing} gives {other} with the same records on the same grid",
                    where=named(ds),
                    remedy=f"Add {the} {QUANTITIES[other].long_name}",
                )


def have_waves(ds: xr.Dataset) -> bool:
    """Tell whether a dataset says how high the waves are and where they go: less is of no use."""
    return {"wave_height", "wave_direction"} <= set(ds.data_vars)


def doubtful_units(datasets: Sequence[xr.Dataset]) -> list[str]:
    """Return in words which fields have such small numbers that these seem to be of another unit than their file says.

    Looked at are a few records of fields in cm, per cent and the like.
    """
    said = []
    for ds in datasets:
        for name in map(str, ds.data_vars):
            units = str(ds[name].attrs.get("original_units", ""))
            if not units or not doubtful_below(name, units):
                continue
            parts = [_a_few(ds[part], named(ds)) for part in (name, dict(VECTORS).get(name)) if part in ds]
            low, high = (float(f([f(values, initial=0.0) for values in parts])) for f in (np.min, np.max))
            if doubt := small_unit(name, low, high, units):
                said.append(f"{named(ds)}: {doubt}")
    return said


def _a_few(field: xr.DataArray, where: str) -> NDArray[Any]:
    """Return the known values of a field in three of its records, at its uppermost level."""
    field = field.isel(depth=0) if "depth" in field.dims else field
    if "time" in field.dims:
        field = field.isel(time=np.unique(np.linspace(0, field.sizes["time"] - 1, 3).astype(int)))
    values = field_values(field, where)
    return np.asarray(values[np.isfinite(values)])


def minute(moment: np.datetime64) -> str:
    """Return a moment as text, to the minute."""
    return str(moment.astype("datetime64[m]"))


def named(ds: xr.Dataset) -> str:
    """Return product and files of a dataset, for messages."""
    files = str(ds.attrs.get("source", "")).split(", ")
    more = f" and {len(files) - 1} more" if len(files) > 1 else ""
    text = f"{Path(files[0]).name}{more}"
    product = str(ds.attrs.get("product", ""))
    return f"{product} ({text})" if product and text else product or text


def remarks(ds: xr.Dataset) -> list[str]:
    """Return what should be known of a dataset before a run: what was chosen, what nothing reads, and doubts."""
    return [str(ds.attrs[key]) for key in REMARKS if key in ds.attrs]


def named_remarks(datasets: Sequence[xr.Dataset]) -> list[str]:
    """Return the remarks on datasets, each behind the name of its own."""
    return [f"{named(ds)}: {said}" for ds in datasets for said in remarks(ds)]


def field_values(field: xr.DataArray, where: str) -> NDArray[Any]:
    """Return the values of a field; `ForcingError` where a damaged file (``where``) does not give them up."""
    what = f"values of {field.attrs.get('original_name', field.name)} cannot be read"
    with reading(where or "forcing", what, "The file is damaged: fetch it again", ForcingError):
        return np.asarray(field.values)


def empty_records(field: xr.DataArray, where: str = "") -> NDArray[np.bool_]:
    """Tell which records of a field hold no value at all; of levels the uppermost is looked at.

    One row of points is read of every record; only where that row is missing is the whole record read.
    """
    surface = field.isel(depth=0) if "depth" in field.dims else field
    surface = surface.transpose("time", ...)
    empty = np.zeros(surface.sizes["time"], dtype=bool)
    known: NDArray[np.bool_] | None = None
    for k in range(empty.size):
        if known is not None and known[k]:
            continue
        finite = np.isfinite(field_values(surface.isel(time=k), where))
        empty[k] = not finite.any()
        if known is None and not empty[k] and surface.ndim > 2:  # scattered points have no rows
            row = int(finite.sum(axis=-1).argmax())
            known = np.isfinite(field_values(surface.isel({surface.dims[1]: row}), where)).any(axis=-1)
    return empty


def empty_by_field(ds: xr.Dataset) -> dict[str, NDArray[np.bool_]]:
    """Return the records without values of each field with time, sea ice excepted; of a vector with either component."""
    empty = {
        str(name): empty_records(field, named(ds))
        for name, field in ds.data_vars.items()
        if "time" in field.dims and str(name) not in MAY_BE_EMPTY
    }
    for east, north in VECTORS:
        if east in empty and north in empty:
            empty[east] = empty[north] = empty[east] | empty[north]
    return empty


def without_empty(ds: xr.Dataset) -> list[xr.Dataset]:
    """Return the dataset without records that hold no value, in parts where its fields lack different ones.

    Fields without any value are left out.
    """
    empty = empty_by_field(ds)
    if not any(records.any() for records in empty.values()):
        return [ds]
    groups: dict[bytes, list[str]] = {}
    for name in map(str, ds.data_vars):
        groups.setdefault(empty[name].tobytes() if name in empty else b"", []).append(name)
    parts = []
    attributes = {"interval_seconds": own_interval(ds), **ds.attrs}
    for names in groups.values():
        part = ds[names].assign_attrs(attributes)
        if names[0] in empty:
            part = part.isel(time=np.flatnonzero(~empty[names[0]]))
        if "time" not in part.dims or part.sizes["time"]:
            parts.append(part)
    return parts
