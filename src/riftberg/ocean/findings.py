"""What was found out about forcing files, and its words: the report of `riftberg.ocean.doctor`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from riftberg.products.quantities import QUANTITIES


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
    """What `doctor` found."""

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
        """Return the report as plain text."""
        lines: list[str] = []
        shown: set[str] = set()
        for finding in self.data:
            lines += _data_lines(finding, shown)
            shown.update(finding.notes)
        for name, reason in self.unreadable.items():
            lines += [f"{name}", f"  cannot be used: {reason}", ""]
        lines += [f"Note: {note}" for note in self.notes]
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


def _data_lines(finding: DataFinding, shown: set[str]) -> list[str]:
    """Return the lines of a dataset, without the notes that were given before."""
    head = finding.files[0] if len(finding.files) == 1 else f"{finding.files[0]} and {len(finding.files) - 1} more"
    lines = [head, f"  is      {finding.title} ({finding.product}; reader checked against {finding.checked_against})"]
    lines += [f"  space   {finding.space}", f"  time    {finding.time}"]
    for item in finding.fields:
        meaning = QUANTITIES[item.name].long_name
        lines.append(f"  gives   {item.name:<20}{meaning}, + is {item.positive}")
        lines.append(f"          from {item.original_name} ({item.original_units or 'no units'} in the file);")
        lines[-1] += f" here {item.low:.4g} to {item.high:.4g} {item.units}"
        lines[-1] += f", {item.missing_share:.2%} missing" if item.missing_share > 0.0 else ""
        lines += [f"          ! {problem}" for problem in item.problems]
    lines += [f"  sample  {finding.sampled}"] if finding.sampled else []
    lines += [f"  note    {note}" for note in finding.notes if note not in shown]
    lines += [f"  !       {problem}" for problem in finding.problems]
    return [*lines, ""]
