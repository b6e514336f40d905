"""Covering tables: rows of options in which every possible pair of values stands at least once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

Row = dict[str, Any]


def covering_table(
    factors: Mapping[str, Sequence[Any]],
    possible: Callable[[str, Any, str, Any], bool],
    *,
    rows: Sequence[Row] = (),
    seed: int = 1,
    tries: int = 4,
) -> list[Row]:
    """Return rows with one value of each factor that cover all possible pairs of values.

    Greedy: each row is the best of some drafts; a draft takes the factors in random order and gives each the value that
    brings the most pairs not covered yet, of those that are possible with all that is chosen.

    Parameters
    ----------
    factors : mapping of str to sequence
        Values of each factor; at least one of them must go with everything.
    possible : callable
        Whether two values of two factors may stand in one row.
    rows : sequence of dict
        Rows that are there already; they come first in the result.
    seed, tries : int
        Of the random order; drafts for each row.
    """
    names = list(factors)
    items = [(k, value) for k, name in enumerate(names) for value in factors[name]]
    owner = np.array([k for k, _ in items])
    allowed = np.array(
        [[a != b and possible(names[a], v, names[b], w) and possible(names[b], w, names[a], v) for b, w in items]
         for a, v in items]
    )  # fmt: skip
    left = allowed.copy()
    rng = np.random.default_rng(seed)
    rows = list(rows)
    for row in rows:
        there = [k for k, (owned, value) in enumerate(items) if row[names[owned]] == value]
        left[np.ix_(there, there)] = False
    while left.any():
        drafts = [_draft(owner, allowed, left, rng) for _ in range(tries)]
        best = max(drafts, key=lambda chosen: left[np.ix_(chosen, chosen)].sum())
        if not left[np.ix_(best, best)].any():  # what is left stands with nothing that is chosen first: begin with it
            best = _draft(owner, allowed, left, rng, start=np.argwhere(left)[0].tolist())
        left[np.ix_(best, best)] = False
        rows.append({names[items[k][0]]: items[k][1] for k in best})
    return [{name: row[name] for name in names} for row in rows]


def _draft(owner: Any, allowed: Any, left: Any, rng: np.random.Generator, start: Sequence[int] = ()) -> list[int]:
    chosen = list(start)
    done = {int(owner[k]) for k in chosen}
    for factor in rng.permutation(owner.max() + 1):
        if int(factor) in done:
            continue
        candidates = [k for k in np.flatnonzero(owner == factor) if allowed[k, chosen].all()]
        assert candidates, "no value of a factor goes with the others"
        rng.shuffle(candidates)
        chosen.append(max(candidates, key=lambda k: left[k, chosen].sum()))
    return [int(k) for k in chosen]


def uncovered(
    rows: Sequence[Row], factors: Mapping[str, Sequence[Any]], possible: Callable[[str, Any, str, Any], bool]
) -> list[tuple[str, Any, str, Any]]:
    """Return the possible pairs that stand in no row."""
    seen = {(a, repr(row[a]), b, repr(row[b])) for row in rows for a in row for b in row}
    return [
        (a, v, b, w)
        for a in factors for b in factors if a < b for v in factors[a] for w in factors[b]
        if possible(a, v, b, w) and possible(b, w, a, v) and (a, repr(v), b, repr(w)) not in seen
    ]  # fmt: skip
