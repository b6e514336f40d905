"""Datasets of a user made ready for a forcing: read as products, with one sea level, and what nothing acts on."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import xarray as xr

from riftberg.config.values import duration, moment, required
from riftberg.errors import ForcingError
from riftberg.ocean import needs
from riftberg.ocean.balance import decided
from riftberg.ocean.needs import SeaLevel
from riftberg.products.records import WAVES, check_pairs, have_waves, named
from riftberg.products.registry import in_memory

_LOG = logging.getLogger(__name__)


def as_dataset_list(datasets: Any) -> list[xr.Dataset]:
    """Return one dataset or several as a list, or refuse anything else."""
    listed = list(datasets) if isinstance(datasets, list | tuple) else [datasets]
    for dataset in listed or [None]:
        required(
            dataset, xr.Dataset, "a dataset of xarray, or a list of them, such as xarray.open_dataset(file)",
            where="Forcing.from_xarray", kind=ForcingError,
        )  # fmt: skip
    return listed


def prepare_datasets(
    datasets: Any, names: Mapping[str, str] | None, sea_level: SeaLevel, *, max_gap: Any, hold: Any
) -> tuple[list[xr.Dataset], str]:
    """Return datasets as products, without a sea level that is not taken, and where the slope of the sea surface comes from.

    Arguments as of `DatasetForcing.from_xarray`.
    """
    listed = as_dataset_list(datasets)
    limits = {"max_gap_seconds": (max_gap, "max_gap"), "hold_seconds": (hold, "hold")}
    rules = {
        key: duration(value, where=name, kind=ForcingError)
        for key, (value, name) in limits.items()
        if value is not None
    }
    prepared = [ds.assign_attrs(in_python=1, **rules) for ds in in_memory(listed, names)]
    slope = decided(
        sea_level, {str(name) for ds in prepared for name in ds.data_vars}, where="sea_level",
        level_wanted="Add a dataset of it, or leave sea_level away: then the slope balances the current",
        currents_wanted="Add a dataset of currents, or leave sea_level away",
    )  # fmt: skip
    if slope != "files":
        without = [ds.drop_vars("ssh", errors="ignore") for ds in prepared]
        prepared = [ds for ds in without if ds.data_vars]
    check_pairs(prepared)
    for ds in prepared:
        if "unread" in ds.attrs:
            _LOG.warning("%s: %s", named(ds), ds.attrs["unread"])
    return prepared, slope


def first_common_date(datasets: Sequence[xr.Dataset]) -> datetime:
    """Return the first date at which all datasets with dates have begun."""
    first = [ds["time"].values.min() for ds in datasets if "time" in ds and ds["time"].size]
    if not first:
        raise ForcingError(
            "no dataset has dates", where="Forcing.from_xarray", remedy="Give start, the date of the model's time 0"
        )
    return moment(max(first), where="start")


def describe_idle_fields(datasets: Sequence[xr.Dataset]) -> list[str]:
    """Return in words which fields act on nothing because another one is not given."""
    sentences = [
        f"{named(ds)}: {', '.join(waves)} not used, for waves need height and direction on one grid; they follow from the wind"
        for ds in datasets
        if (waves := [name for name in WAVES if name in ds.data_vars]) and not have_waves(ds)
    ]
    holders = {str(name): ds for ds in datasets for name in ds.data_vars}
    of_ice = (needs.ICE_CONCENTRATION, needs.ICE_THICKNESS, needs.ICE_VELOCITY)
    ice = [need.fields[0] for need in of_ice if need.fields[0] in holders]
    lacking = [
        f"{need.quantity.removesuffix(' of sea ice')} ({need.fields[0]})"
        for need in of_ice
        if need.fields[0] not in holders
    ]
    if ice and lacking:
        words = " and ".join(lacking)
        sentences.append(f"{named(holders[ice[0]])}: sea ice without its {words} exerts no force in the default scheme")
    return sentences
