"""The table that ``pytest tests/parity`` prints at its end."""

from __future__ import annotations

import numpy as np

from .comparison import Comparison

HEADER = (
    "case", "records", "position, m", "position, m", "velocity", "rotation", "stress", "bonds broken", "later: bonds",
    "centroid", "wall",
)  # fmt: skip
SECOND = (
    "",
    "compared",
    "before break",
    "same breaks",
    "m/s",
    "rad",
    "Pa",
    "at the same record",
    "ours / ref",
    "m",
    "s",
)
NOTES = (
    "Largest differences from the reference. 'before break': all records before its first break (all of the case, if",
    "nothing breaks). 'same breaks' and velocity, rotation, stress: as long as the breaks are asked to be the same (to",
    "stamp 4.25 d in a68_oras5, through the first 10 breaks in a68_synthetic, else to the end). 'later': largest",
    "difference within two more days. n_bonds of the collisions on 4 processes is wrong in the reference (Q32) and not",
    "compared, in collision_KID_wide not written; the first uvel_prev of runs that skip their first outer step is",
    "undefined there.",
)


def row(c: Comparison) -> tuple[str, ...]:
    """Return the cells of one case."""
    same = c.while_same
    return (
        c.case.name, str(c.distance.size), _number(c.position(c.before_break)), _number(c.position(same)),
        _number(c.velocity(same)), _number(c.rotation(same)), _number(c.stress()), _breaks(c), *_later(c),
        f"{c.wall:.1f}",
    )  # fmt: skip


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.1e}"


def _breaks(c: Comparison) -> str:
    if not c.case.counts_bonds:
        return "not compared"
    if not c.broken:
        return "none, as there" if c.really_same_until() == c.stamps[-1] else "NO"
    left = c.bonds_left(c.theirs)
    until = c.really_same_until()
    if until is None:
        return "NO"
    count = int(left[0] - left[np.flatnonzero(c.stamps == until)[0]])
    total = int(left[0] - left[-1])
    if until == c.stamps[-1]:
        return f"yes, {total} to the end"
    return f"yes, {count} through {until / 86400.0:g} d (of {total})"


def _later(c: Comparison) -> tuple[str, str]:
    rows = c.later() if c.case.counts_bonds else []
    if not rows:
        return "-", "-"
    _, ours, theirs, _ = max(rows, key=lambda r: abs(r[1] - r[2]))
    return f"{ours} / {theirs}", f"{max(r[3] for r in rows):.3g}"


def lines(comparisons: list[Comparison]) -> list[str]:
    """Return the table as lines of text."""
    table = [HEADER, SECOND, *(row(c) for c in comparisons)]
    widths = [max(len(cells[k]) for cells in table) for k in range(len(HEADER))]
    text = ["  ".join(cell.ljust(w) for cell, w in zip(cells, widths, strict=True)).rstrip() for cells in table]
    return [*text[:2], "-" * max(map(len, text)), *text[2:], "", *NOTES]
