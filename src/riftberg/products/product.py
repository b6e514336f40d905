"""Definition of a product: how it is recognised, which fields it holds, and how it is mended on the way in."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Set
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError

Step = Callable[[xr.Dataset], xr.Dataset]
Evidence = Literal["sample", "layout", "documentation"]
EVIDENCE: dict[Evidence, str] = {
    "sample": "a real file",
    "layout": "a published header",
    "documentation": "documentation only",
}
"""Kinds of evidence in words, the strongest first."""

DAY = np.timedelta64(86400, "s")


def unchanged(ds: xr.Dataset) -> xr.Dataset:
    """Return the dataset unchanged."""
    return ds


@dataclass(frozen=True)
class Heading:
    """Metadata of a file, read before any of its values: by these alone its product is recognised."""

    variables: Mapping[str, Mapping[Hashable, Any]]  # Attributes of each variable
    sizes: Mapping[str, int]  # Lengths of the dimensions
    attributes: Mapping[Hashable, Any]  # Of the file
    source: str  # Name of the file

    @classmethod
    def of(cls, ds: xr.Dataset) -> Heading:
        """Return the heading of an undecoded dataset."""
        variables = {str(name): variable.attrs for name, variable in ds.variables.items()}
        sizes = {str(name): size for name, size in ds.sizes.items()}
        return cls(variables, sizes, ds.attrs, str(ds.encoding.get("source", "")))

    @property
    def names(self) -> Set[str]:
        """Names of the variables."""
        return self.variables.keys()

    def says(self, *names: str) -> str:
        """Return the named attributes of the file joined in lower case, empty where absent."""
        return " ".join(str(self.attributes.get(name, "")) for name in names).lower()


@dataclass(frozen=True)
class Source:
    """Where a product keeps one canonical quantity."""

    quantity: str  # Canonical name
    names: tuple[str, ...]  # Names of the variable in files, the preferred one first
    units: str = ""  # Units to assume where the file states none; empty = the file must state them
    # What the reader of this quantity was checked against, where it is not that of the product
    evidence: Evidence | None = None


@dataclass(frozen=True)
class Product:
    """One data product."""

    name: str  # Short name, used on the command line and in files
    title: str  # Full name
    citation: str  # How to cite it
    evidence: Evidence  # What the reader was checked against: a real file, a published header, or documentation only
    matches: Callable[[Heading], bool]  # Tells from the heading of a file whether it is this product
    sources: tuple[Source, ...]  # Fields that it may hold
    mend: Step = unchanged  # Repairs metadata before xarray decodes packing and time
    reshape: Step = unchanged  # Brings decoded data to the dimensions ``time, depth, lat, lon`` (or ``y, x``) by name
    finish: Step = unchanged  # Last change of the canonical dataset: masks, position of the stamp in time
    # What needs the records of all files together, after they were joined: the length of time that one stands for
    settle: Step = unchanged
    # Length of time that one record stands for; 0 for instants
    averaging: np.timedelta64 = field(default_factory=lambda: np.timedelta64(0, "s"))
    left_out: tuple[str, ...] = ()  # Variables that are not taken on purpose, whatever their metadata say
    cautions: tuple[str, ...] = ()  # What a run takes on trust from all of its files: the doctor tells it
    notes: tuple[str, ...] = ()  # Signs, stamps and quirks that a user should know, in plain words
    kind_matters: bool = True  # Whether a heading that speaks of a forecast or of near real time is worth a remark
    # Returns the variable of each quantity in a decoded file but some, and a remark (empty if none), instead of ``sources``
    select: Callable[[xr.Dataset, Collection[str]], dict[str, tuple[str, str]]] | None = None
    # Variable of a quantity or coordinate as the user names it, before all that a file says
    names: Mapping[str, str] = field(default_factory=dict)
    member: int | None = None  # Of a file with several members of an ensemble the one that is read, from 0
    # Longest interval (s) that records by themselves can show: those farther apart are snapshots of something faster.
    # Without it months, or a week where there are only two records
    longest_step: float | None = None
    variants: tuple[tuple[str, Evidence], ...] = ()  # Other layouts, and what their reading was checked against

    @property
    def gives(self) -> tuple[str, ...]:
        """Canonical names that this product may hold."""
        return tuple(source.quantity for source in self.sources)

    def checked(self, names: Iterable[Hashable] | None = None) -> str:
        """Describe the evidence for the reader, by quantity (of ``names`` only) and by layout where these differ."""
        chosen = set(self.gives if names is None else map(str, names))
        by_evidence: dict[Evidence, list[str]] = {}
        for source in self.sources:
            if source.quantity in chosen:
                by_evidence.setdefault(source.evidence or self.evidence, []).append(source.quantity)
        single = len(by_evidence) < 2
        kinds = [f"{EVIDENCE[kind]}" + ("" if single else f" ({', '.join(q)})") for kind, q in by_evidence.items()]
        others = [f"{name}: {EVIDENCE[kind]}" for name, kind in self.variants]
        return "; ".join([*(kinds or [EVIDENCE[self.evidence]]), *others])


def noted(ds: xr.Dataset, **remarks: str) -> xr.Dataset:
    """Return the dataset with remarks (``told``, ``doubt``, ``unread``) behind those that it has."""
    merged = {key: "; ".join(filter(None, (str(ds.attrs.get(key, "")), remark))) for key, remark in remarks.items()}
    return ds.assign_attrs({key: text for key, text in merged.items() if text})


def stamp_noon(ds: xr.Dataset) -> xr.Dataset:
    """Return daily means with their stamp at 12:00 UTC, the middle of the day, whatever hour the file wrote."""
    if "time" not in ds.dims:
        return ds
    noon = ds["time"].values.astype("datetime64[D]").astype("datetime64[ns]") + np.timedelta64(12, "h")
    return ds.assign_coords(time=("time", noon, ds["time"].attrs))


def without_single(ds: xr.Dataset, *names: str, remedy: str = "") -> xr.Dataset:
    """Drop dimensions of length one and their coordinates; longer ones are an error that says which file is wanted."""
    for name in names:
        if name in ds.dims:
            if ds.sizes[name] != 1:
                raise ForcingError(
                    f"dimension {name!r} has {ds.sizes[name]} entries",
                    where=str(ds.encoding.get("source", "")),
                    remedy=remedy,
                )
            ds = ds.isel({name: 0}, drop=True)
    return ds.drop_vars([name for name in names if name in ds.variables and name not in ds.dims])
