"""Check forcing files: their product, their fields, and what a run still lacks, in words that a first-day user can act on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.config.units import duration_text
from riftberg.errors import ForcingError
from riftberg.ocean.dataset_preparation import describe_idle_fields
from riftberg.ocean.needs import CURRENT, SEA_LEVEL, WIND
from riftberg.ocean.product_records import NO_RINGS, REACH, RINGS, Blend, as_block, values_at
from riftberg.products.mesh import Located, Mesh, NodeMesh, build_mesh, extent_text, utc, window, window_in_time
from riftberg.products.product import Product
from riftberg.products.quantities import QUANTITIES, small_unit, unlikely
from riftberg.products.records import (
    MAY_BE_EMPTY,
    WAVES,
    Dates,
    cover_of,
    empty_by_field,
    gap_limit,
    long_gaps,
    minute,
    own_interval,
    remarks,
    usual_interval,
)
from riftberg.products.registry import Choice, expand, joined_files, product_named, read_named
from riftberg.products.repair import VALID
from riftberg.products.vectors import pair_vectors
from riftberg.system.input_files import because
from riftberg.system.netcdf_lock import closing_files, open_netcdf

Flags = NDArray[np.bool_]
Span = tuple[float, float]

NEEDED = CURRENT.fields
"""Fields without which no run starts; sea ice is optional (none = open water), depth only for grounding."""

ASSUMED = {field: need.without for need in (SEA_LEVEL, WIND) for field in need.fields}
"""Values that a run assumes where no file gives a field that it should have."""

_SAMPLE_RECORDS = 3
_LARGE = 2000
_EDGE_POINTS = 25  # along each edge of a box, to see how much of it lies on a grid

HARMLESS = "which stops no run"
"""End of findings that need no action."""


@closing_files()
def doctor(
    files: Sequence[str | Path] | str | Path,
    *,
    lon: Span | None = None,
    lat: Span | None = None,
    time: tuple[Any, Any] | None = None,
    needed: Sequence[str] = NEEDED,
    path: Sequence[Span] | None = None,
    product: str | Mapping[str, Choice] | None = None,
    max_gap: float | None = None,
    hold: float | None = None,
    wished: Sequence[str] | None = None,
) -> Report:
    """Identify files and check that they suffice for an experiment; never raises for bad files, it reports them.

    ``lon``, ``lat``: box of the experiment (degrees); ``path``: positions of the berg, where missing values matter
    ((lon, lat)); ``max_gap``, ``hold``: limits of the run, s: the longest gap that is interpolated across, and how
    long the ends are held.
    """
    unknown = [name for name in needed if name not in QUANTITIES]
    if unknown:
        raise ForcingError(f"no such fields: {unknown}", where="needed", remedy=f"Choose from: {', '.join(QUANTITIES)}")
    rules = {"max_gap_seconds": max_gap, "hold_seconds": hold}
    attributes = {name: seconds for name, seconds in rules.items() if seconds is not None}
    report = Report()
    opened = _opened_entries(_entries(files, product, report), report)
    for ds in opened:
        try:
            report.data.append(_examined(ds.assign_attrs(attributes), lon, lat, time, path))
        except ForcingError as error:
            report.unreadable[str(ds.attrs["source"])] = _without_place(error)
        except Exception as error:  # values that a damaged file does not give up
            report.unreadable[str(ds.attrs["source"])] = (
                f"its values cannot be read{because(error)}. Fetch the file again"
            )
    report.notes += describe_idle_fields(opened)
    wishes = (ASSUMED if needed is NEEDED else ()) if wished is None else wished
    _conclude(report, list(dict.fromkeys(needed)), [name for name in wishes if name not in needed])
    return report


def _entries(
    files: Sequence[str | Path] | str | Path, product: str | Mapping[str, Choice] | None, report: Report
) -> list[tuple[str, Choice]]:
    """Return all files with the product or names given for them; note patterns that match nothing."""
    entries: list[tuple[str, Choice]] = []
    for stated in [files] if isinstance(files, str | Path) else files:
        try:
            names = expand(stated)
        except ForcingError as error:
            report.unreadable[error.where] = _without_place(error)
            continue
        choice = product if product is None or isinstance(product, str) else product.get(str(stated))
        entries += [(name, choice) for name in names]
    return entries


def _opened_entries(entries: Sequence[tuple[str, Choice]], report: Report) -> list[xr.Dataset]:
    """Open the readable files; note the rest in the report."""
    usable: list[list[tuple[xr.Dataset, Product]]] = []
    for number, (name, product) in enumerate(entries):
        try:
            opened = read_named(name, product, number)
            joined_files(opened)  # joining its records may fail too
            usable.append(opened)
        except ForcingError as error:
            report.unreadable[name] = _other_kind(name) or _without_place(error)
    try:
        return pair_vectors(joined_files([pair for opened in usable for pair in opened]))
    except ForcingError as error:  # each is good by itself, together they do not go
        report.clashes.append(f"{error.where}: {_without_place(error)}")
        return [ds for opened in usable for ds in joined_files(opened)]


def _other_kind(name: str) -> str:
    """Name the kind of a file that belongs to a run but is no forcing; empty if unknown."""
    try:
        with open_netcdf(name) as file:
            variables = set(file.variables)
    except OSError:
        return ""
    if {"trajectory", "break_time"} <= variables:
        return "a run of Riftberg, no forcing: 'riftberg plot', 'score' and 'why' read it"
    if {"lon", "lat", "mass", "thickness", "start_mass"} <= variables:
        return "an initial state of icebergs (restart of KID), no forcing: 'riftberg kid' and a68a-paper read it"
    if "b_id" in variables:
        return "a mask of icebergs, no forcing: Iceberg.from_mask makes a berg of it"
    return ""


def _without_place(error: ForcingError) -> str:
    return f"{error.what}. {error.remedy}" if error.remedy else error.what


def _examined(
    ds: xr.Dataset, lon: Span | None, lat: Span | None, time: tuple[Any, Any] | None, path: Sequence[Span] | None
) -> DataFinding:
    product = product_named(ds.attrs["product"])
    finding = DataFinding(
        files=str(ds.attrs["source"]).split(", "),
        product=product.name,
        title=product.title,
        checked_against=product.checked(ds.data_vars),
        notes=[*product.cautions, *product.notes, *remarks(ds)],
        space=extent_text(ds),
        time=_time_cover(ds),
    )
    excerpt = _cut_to_experiment(ds, lon, lat, time, finding)
    if excerpt is None:
        _time_problems(ds, {}, time, finding)
        return finding
    mesh = build_mesh(excerpt)
    _space_problems(excerpt, mesh, lon, lat, finding)
    empty = empty_by_field(excerpt)
    _time_problems(
        ds, {name: excerpt["time"].values[flags] for name, flags in empty.items() if flags.any()}, time, finding
    )
    berg = Located(mesh, *np.reshape(path or (), (-1, 2)).T)
    if berg.outside.any():
        finding.problems.append(
            f"{berg.outside.sum()} of {berg.lon.size} positions of the berg lie outside. Fetch a larger area"
        )
    sample = _sampled(excerpt, empty, finding)
    finding.fields = [_field_report(sample[name], berg) for name in sample.data_vars]
    return finding


def _cut_to_experiment(
    ds: xr.Dataset, lon: Span | None, lat: Span | None, time: tuple[Any, Any] | None, finding: DataFinding
) -> xr.Dataset | None:
    """Return the part of the data in the experiment, or None with the reason noted."""
    try:
        if time is not None and "time" in ds.dims:
            window_in_time(ds, time)  # an error if none of its dates is there
            # So much more that a missing record at the edge can be bridged by those beyond it, as runs do.
            ds = window_in_time(ds, time, gap_limit(ds))
        if lon is not None and lat is not None:
            ds = window(ds, lon, lat)
    except ForcingError as error:
        finding.problems.append(_without_place(error))
        return None
    return _middle(ds, finding) if lon is None or lat is None else ds


def _sampled(ds: xr.Dataset, empty: Mapping[str, Flags], finding: DataFinding) -> xr.Dataset:
    """Return a few records of many, if possible such with values of all fields, and say so."""
    if "time" not in ds.dims:
        return ds
    complete = np.flatnonzero(~np.any([np.zeros(ds.sizes["time"], bool), *empty.values()], axis=0))
    if not complete.size or ds.sizes["time"] <= _SAMPLE_RECORDS:
        return ds
    picked = complete[np.unique(np.linspace(0, complete.size - 1, _SAMPLE_RECORDS).astype(int))]
    finding.sampled = (
        f"ranges, missing shares and land on the path: {picked.size} of {ds.sizes['time']} records "
        f"({', '.join(minute(moment) for moment in ds['time'].values[picked])}); records without values: all"
    )
    return ds.isel(time=picked)


def _middle(ds: xr.Dataset, finding: DataFinding) -> xr.Dataset:
    """Cut very large fields to their middle, so that nobody waits for a whole globe to be read."""
    large = {name: size for name, size in ds.sizes.items() if name in ("lat", "lon", "y", "x") and size > _LARGE}
    if large:
        finding.notes.append("ranges are those of the middle of the data: give the box of the experiment for its own")
    return ds.isel({name: slice(size // 2 - _LARGE // 2, size // 2 + _LARGE // 2) for name, size in large.items()})


def _time_cover(ds: xr.Dataset) -> str:
    if "time" not in ds.dims:
        return "constant in time (no dates in the file)"
    records = ds["time"].values
    first, last = records[0].astype("M8[m]"), records[-1].astype("M8[m]")
    if records.size == 1:
        return f"one record, {first} UTC"
    return f"{first} to {last} UTC, {records.size} records every {_duration(usual_interval(records))}"


def _duration(seconds: float) -> str:
    return duration_text(float(f"{seconds / 86400:.3g}")) if seconds >= 86400 else f"{seconds / 3600:.3g} h"


def _space_problems(ds: xr.Dataset, mesh: Mesh, lon: Span | None, lat: Span | None, finding: DataFinding) -> None:
    """Note where the experiment's box reaches beyond the data, and axes with a single point."""
    for axis in ("lat", "lon", "y", "x"):
        if ds.sizes.get(axis, 2) < 2 and not finding.problems:
            finding.problems.append(f"only one point along {axis}: a run needs two or more. Fetch a larger area")
    if lon is None or lat is None or finding.problems or "node" in ds.dims:
        return
    east = lon[1] if lon[1] >= lon[0] else lon[1] + 360.0
    box = np.meshgrid(np.linspace(lon[0], east, _EDGE_POINTS), np.linspace(*lat, _EDGE_POINTS))
    outside = Located(mesh, *box).outside.mean()
    if outside > 0.0:
        finding.problems.append(
            f"covers only part of the experiment: {outside:.0%} of its box lies outside. Fetch a larger area"
        )


def _time_problems(
    ds: xr.Dataset, empty: Mapping[str, Dates], time: tuple[Any, Any] | None, finding: DataFinding
) -> None:
    """Note gaps between records, records without values and dates of the experiment without records."""
    if "time" not in ds.dims or (finding.problems and "no record lies" in finding.problems[0]):
        return
    records = ds["time"].values
    first, last = (utc(moment) for moment in time) if time is not None else (records[0], records[-1])
    lacking: dict[tuple[np.datetime64, ...], list[str]] = {}
    for name, dates in empty.items():
        lacking.setdefault(tuple(dates), []).append(name)
    _gap_problems(ds, records, first, last, finding, "")
    for dates_lost, names in lacking.items():
        who = ", ".join(names)
        remaining = records[~np.isin(records, dates_lost)]
        dates_text = ", ".join(map(minute, dates_lost[:6])) + (" ..." if len(dates_lost) > 6 else "")
        finding.notes.append(f"{len(dates_lost)} record(s) without any value of {who} count as missing: {dates_text}")
        if remaining.size:
            _gap_problems(ds, remaining, first, last, finding, f" of {who}", all_records=records)
            _end_problems(ds, remaining, first, last, finding, f" with values of {who}")
    if time is not None:
        _end_problems(ds, records, first, last, finding, "")


def _gap_problems(
    ds: xr.Dataset, records: Dates, first: np.datetime64, last: np.datetime64, finding: DataFinding, subject: str,
    all_records: Dates | None = None,
) -> None:  # fmt: skip
    """Tell the gaps at the dates of the experiment: those that a run refuses, and those that it interpolates across."""
    interval, limit = own_interval(ds), gap_limit(ds)
    reported = set(long_gaps(all_records, 1.5 * interval, first, last)) if all_records is not None else set()
    for gap in long_gaps(records, min(1.5 * interval, limit), first, last):
        if gap in reported:
            continue
        lost = round(gap.seconds / interval) - 1
        text = f"gap: about {lost} record(s){subject} missing between {minute(gap.before)} and {minute(gap.after)}"
        if gap.seconds > limit:
            allowed = f"longer than the {_duration(limit)} that a run interpolates across"
            finding.problems.append(f"{text}, {allowed}. Add these files, or set forcing.max_gap")
        else:
            finding.notes.append(f"{text}; runs interpolate across it")


def _end_problems(
    ds: xr.Dataset, records: Dates, first: np.datetime64, last: np.datetime64, finding: DataFinding, subject: str
) -> None:
    """Note dates of the experiment before the first and after the last record."""
    begins, ends = cover_of(ds.sel(time=records))
    if first.astype(begins.dtype) < begins:
        finding.problems.append(
            f"begins{subject} at {minute(records[0])}, after the experiment ({minute(first)}). Add earlier files"
        )
    if last.astype(ends.dtype) > ends:
        finding.problems.append(
            f"ends{subject} at {minute(records[-1])}, before the experiment ({minute(last)}). Add later files"
        )


def _lacking(data: xr.DataArray, berg: Located) -> tuple[int, int]:
    """Count positions of the berg at which any record of a field has no water around, and those without near water either.

    Of levels the uppermost is looked at; scattered points have no cells, and are not counted.
    """
    if isinstance(berg.mesh, NodeMesh):
        return 0, 0
    dry, unfilled = np.zeros((2, berg.lon.size), bool)
    surface = data.isel(depth=slice(0, 1)) if "depth" in data.dims else data
    for record in as_block(surface, "forcing"):
        for is_unknown, rings in ((dry, NO_RINGS), (unfilled, RINGS)):
            is_unknown |= np.isnan(
                values_at(Blend.of(record, record), berg.places, berg.mesh.points.columns, rings=rings)[0]
            )
    return int((dry & ~berg.outside).sum()), int((unfilled & ~berg.outside).sum())


def _field_report(data: xr.DataArray, berg: Located) -> FieldFinding:
    """Return range, missing share and problems of one field in the experiment."""
    quantity = QUANTITIES[str(data.name)]
    values = data.values
    is_finite = np.isfinite(values)
    low, high = (
        (float(values[is_finite].min()), float(values[is_finite].max())) if is_finite.any() else (np.nan, np.nan)
    )
    missing, unfilled = _lacking(data, berg)
    report = FieldFinding(
        name=quantity.name,
        original_name=str(data.attrs.get("original_name", "")),
        original_units=str(data.attrs.get("original_units", "")),
        units=quantity.units,
        positive=quantity.sign,
        low=low,
        high=high,
        missing_share=float(1.0 - is_finite.mean()) if is_finite.size else 1.0,
        missing_on_path=missing,
        unfilled_on_path=unfilled,
    )
    _judge(report, berg.lon.size)
    if report.missing_share == 1.0 and (valid := data.attrs.get(VALID)):
        report.problems.append(f"the file calls only {valid} valid: check its valid_range and its units")
    return report


def _judge(finding: FieldFinding, points: int) -> None:
    """Add the problems of a field."""
    if finding.missing_share == 1.0:
        finding.problems.append("holds no value at all in the experiment: all land or missing")
        return
    most, fault = QUANTITIES[finding.name].limit, unlikely(finding.name, finding.low, finding.high)
    if fault.startswith("beyond"):
        fault = f"values beyond {most:g} {finding.units} are not believable"
    if fault:
        finding.problems.append(f"{fault}: check the units in the file")
    if finding.original_units and (
        doubt := small_unit(finding.name, finding.low, finding.high, finding.original_units)
    ):
        finding.problems.append(f"{doubt} If so, correct the file; it is a doubt {HARMLESS}")
    if finding.low == finding.high == 0.0:
        finding.problems.append(
            f"is zero everywhere in the experiment: check that the right variable was written, {HARMLESS}"
        )
    if finding.missing_on_path:
        text = f"missing (land, ice or gap) at {finding.missing_on_path} of {points} positions of the berg: "
        finding.problems.append(text + _effect(finding))


def _effect(finding: FieldFinding) -> str:
    """Return how a run fills a field that is missing on the path of the berg."""
    if finding.name == "depth_below_surface":
        return f"these count as land, {HARMLESS}"
    if finding.name in WAVES:
        return f"waves beside them are taken, else none, {HARMLESS}"
    if finding.name in MAY_BE_EMPTY:
        return f"ice beside them is taken, else open water, {HARMLESS}"
    if finding.unfilled_on_path:
        return (
            f"at {finding.unfilled_on_path} of them water is farther away than {REACH} cells of the product, and the "
            "field is 0 there. Take a product with water on the path"
        )
    return f"values from the nearest water will be used there, {HARMLESS}"


def _conclude(report: Report, needed: Sequence[str], wished: Sequence[str]) -> None:
    """List missing fields and remedies, the most pressing first."""
    for name in QUANTITIES:
        holders = [finding for finding in report.data if any(item.name == name for item in finding.fields)]
        if len(holders) > 1:
            files = ", ".join(Path(finding.files[0]).name for finding in holders)
            report.notes.append(
                f"{name} is in {len(holders)} sets of files ({files}); of these a run takes the file named last"
            )
    good = {item.name for finding in report.data for item in finding.fields if item.missing_share < 1.0}
    report.missing = [name for name in needed if name not in good]
    for name in (*report.missing, *(name for name in wished if name not in good)):
        source = QUANTITIES[name].source or f"any CF file with standard name {QUANTITIES[name].standard_name}"
        text = f"o file gives {name} ({QUANTITIES[name].long_name}). Get {source}"
        if name in needed:
            report.advice.append(f"N{text}")
        else:
            report.assumed.append(f"{ASSUMED[name]}, for n{text}")
    # A stray file beside a complete set is mentioned, but does not stop the run.
    if report.missing:
        for name, reason in report.unreadable.items():
            # For a pattern show the folder too: it may be the one that is wrong.
            path_end = Path(name).parts[-3:] if any(sign in name for sign in "*?[") else (Path(name).name,)
            report.advice.append(f"{Path(*path_end)}: {reason}")
    report.advice += report.clashes
    for finding in report.data:
        relevant = [item for item in finding.fields if item.name in (*needed, *wished)]
        if relevant or not finding.fields:
            report.advice += [f"{Path(finding.files[0]).name}: {problem}" for problem in finding.problems]
        for item in relevant:
            serious = [text for text in item.problems if not text.endswith(HARMLESS)]
            report.advice += [f"{Path(finding.files[0]).name}, {item.name}: {problem}" for problem in serious]


@dataclass
class FieldFinding:
    """One field of a dataset: range within the experiment, and how much of it is missing."""

    name: str
    original_name: str
    original_units: str
    units: str
    positive: str
    low: float
    high: float
    missing_share: float
    missing_on_path: int
    unfilled_on_path: int = 0
    problems: list[str] = field(default_factory=list)


@dataclass
class DataFinding:
    """One dataset: files of one product, one grid, one set of records."""

    files: list[str]
    product: str
    title: str
    checked_against: str
    notes: list[str]
    fields: list[FieldFinding] = field(default_factory=list)
    space: str = ""
    time: str = ""
    sampled: str = ""
    problems: list[str] = field(default_factory=list)


@dataclass
class Report:
    """Findings of `doctor`."""

    data: list[DataFinding] = field(default_factory=list)  # One entry per dataset
    unreadable: dict[str, str] = field(default_factory=dict)  # Files that could not be used, and why
    # Files that are good by themselves and cannot be used together, and why
    clashes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # What should be known of the files together
    missing: list[str] = field(default_factory=list)  # Needed fields that no dataset gives
    advice: list[str] = field(default_factory=list)  # What to do, the most pressing first
    assumed: list[str] = field(default_factory=list)  # What a run takes for that which no file gives
    # Why a run with these files does not start, empty if it does; None where none was tried, and the advice decides
    refusal: str | None = None

    @property
    def ready(self) -> bool:
        """Whether the files suffice for the experiment: where a run was tried, whether it starts."""
        return not self.advice if self.refusal is None else not (self.refusal or self.missing)

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain numbers, texts, lists and dicts."""
        return {**asdict(self), "ready": self.ready}

    def text(self) -> str:
        """Return the report as plain text, each finding once."""
        lines: list[str] = []
        notes_shown = [*self.assumed]
        for finding in self.data:
            lines += _data_lines(finding, notes_shown)
            notes_shown += finding.notes
        for name, reason in self.unreadable.items():
            lines += [f"{name}", f"  cannot be used: {reason}"]
        lines += [f"Note: {note}" for note in self.notes if note not in self.assumed]
        lines += [f"Assumed: {text}" for text in self.assumed]
        if self.ready:
            lines.append(
                "Ready: " + ("these files give all that was asked for." if self.refusal is None else "the run starts.")
            )
            lines += ["Worth a look:"] if self.advice else []
        else:
            lines.append("Not ready. What to do:")
        steps = [self.refusal, *self.advice] if self.refusal else self.advice
        lines += [f"  {number}. {text}" for number, text in enumerate(steps, 1)]
        return "\n".join(lines)


def _data_lines(finding: DataFinding, notes_shown: list[str]) -> list[str]:
    """Return the lines of a dataset, without notes that are given elsewhere."""
    head = finding.files[0] if len(finding.files) == 1 else f"{finding.files[0]} and {len(finding.files) - 1} more"
    read = f"; ranges of {finding.sampled.partition(': ')[2].partition(' (')[0]}" if finding.sampled else ""
    # Where no real file was at hand, trust is less.
    basis = "" if "real file" in finding.checked_against else f"; reader checked against {finding.checked_against}"
    lines = [f"{head}: {finding.title} ({finding.product}{basis})", f"  {finding.space}; {finding.time}{read}"]
    for item in finding.fields:
        missing = f", {item.missing_share:.2%} missing" if item.missing_share > 0.0 else ""
        unit, units = item.original_units or "no units", "" if item.units == "1" else f" {item.units}"
        lines.append(
            f"  {item.name:<12} {item.low:.4g} to {item.high:.4g}{units}, + is {item.positive} (from {item.original_name}, "
            f"{unit}){missing}"
        )
        lines += [f"    ! {problem}" for problem in item.problems]
    # What files of its product may have stands in the reference of products.
    usual = product_named(finding.product).notes
    here = [
        note for note in finding.notes if note not in usual and not any(text.endswith(note) for text in notes_shown)
    ]
    lines += [f"  note: {note}" for note in here]
    return [*lines, *(f"  ! {problem}" for problem in finding.problems)]
