"""What belongs together in several runs, and in what they differ, from their summaries."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Any, Final

import numpy as np

from riftberg.diagnostics.assignment import best_pairs
from riftberg.diagnostics.overlap import distance

Event = dict[str, Any]

DAYS_APART: Final = 4.0
KILOMETRES_APART: Final = 150.0
TIMES_AS_LARGE: Final = 4.0
"""Break-ups further apart in time or place, or with areas that differ by more, are not the same event."""

WORST: Final = 3.0
"""Cost of a pair at all three limits, and of an event without a partner."""

MOST_NAMED: Final = 3
"""Parameters named; of more only the number is given."""


def aligned(runs: Sequence[Sequence[Event]], earth: dict[str, Any]) -> list[list[Event | None]]:
    """Return the break-ups of each run in rows: each row holds the same event of all runs, or None.

    ``earth``: parameters of the Earth, as in ``summary.json``: whether places are degrees, and its radius (m).
    """
    longest = max(range(len(runs)), key=lambda k: len(runs[k]), default=0)
    rows: list[Event] = list(runs[longest]) if runs else []
    placed: list[dict[int, Event]] = []
    for k, events in enumerate(runs):
        if k == longest:
            placed.append(dict(enumerate(rows)))
            continue
        costs = np.array([[_cost(event, row, earth) for row in rows] for event in events])
        pairs = dict(best_pairs(costs.reshape(len(events), len(rows)), alone=WORST)) if rows and events else {}
        mine: dict[int, Event] = {}
        for number, event in enumerate(events):
            if number not in pairs:
                rows.append(event)
                pairs[number] = len(rows) - 1
            mine[pairs[number]] = event
        placed.append(mine)
    return [[mine.get(row) for row in range(len(rows))] for mine in placed]


def _cost(one: Event, other: Event, earth: dict[str, Any]) -> float:
    """How unlike two break-ups are, 0 to 3; infinite beyond the limits. Grounded and afloat are never the same."""
    times = [datetime.fromisoformat(event["time"]) for event in (one, other)]
    days = abs((times[1] - times[0]).total_seconds()) / 86400.0
    places = [(event["lon"], event["lat"]) for event in (one, other)]
    metres = distance(*places[0], *places[1], earth["radius"]) if earth["latlon"] else math.dist(*places)
    larger = abs(math.log(one["area_km2"] / other["area_km2"])) / math.log(TIMES_AS_LARGE)
    parts = days / DAYS_APART, metres / 1e3 / KILOMETRES_APART, larger
    return sum(parts) if max(parts) <= 1.0 and one["grounded"] == other["grounded"] else math.inf


def differences(summaries: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Return rows of what the runs do not share: experiment, forcing, parameters; nothing for a single run."""
    rows: dict[str, list[str]] = {}
    for label in ("experiment", "forcing"):
        texts = [str(summary.get(label, "")) for summary in summaries]
        if len(set(texts)) > 1:
            rows[label] = texts
    flat = [
        {f"{group}.{name}": value for group, values in summary["numerics"].items() for name, value in values.items()}
        for summary in summaries
    ]
    names = sorted({name for one in flat for name in one if any(other.get(name) != one[name] for other in flat)})
    if names:
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        rows["parameters that differ"] = [
            ", ".join(f"{name} {_value_text(one.get(name))}" for name in names[:MOST_NAMED]) + more for one in flat
        ]
    return rows


def _value_text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
