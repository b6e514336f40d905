"""What a run lost by melting, by process and by fragment, as its file tells and in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from riftberg.config.places import area_text
from riftberg.diagnostics.summary import called

if TYPE_CHECKING:
    import xarray as xr

NAMED: Final = 6
"""Fragments that are told of one by one; the others together."""

LEAST: Final = 1e-3
"""Parts of a loss below this are not told."""


def melt_by_fragment(run: xr.Dataset) -> dict[int, dict[str, float]]:
    """Return the melt water (kg) by process of each fragment that lost any, the one that lost most first."""
    if "fragment_melt_water" not in run:
        return {}
    water = run["fragment_melt_water"].transpose("fragment", "process").values
    numbers = run["fragment_number"].values
    processes = [str(name) for name in run["process"].values]
    order = np.argsort(-water.sum(axis=1), kind="stable")
    return {
        int(numbers[k]): dict(zip(processes, water[k].tolist(), strict=True))
        for k in order.tolist()
        if water[k].sum() > 0.0
    }


def melted_words(run: xr.Dataset) -> dict[int, str]:
    """Return what each fragment lost, in words."""
    return {number: _amounts(water) for number, water in melt_by_fragment(run).items()}


def melt_lines(run: xr.Dataset) -> list[str]:
    """Return in words what all and what each of the largest losers lost; nothing where nothing melts.

    The first line tells of bits that have not melted yet too, and of bergs born on the way: children of footloose calving
    and of land.
    """
    lost = melt_by_fragment(run)
    if not lost:
        return []
    every = {name: sum(water[name] for water in lost.values()) for name in next(iter(lost.values()))}
    lines = ["; ".join([f"Melted: {_amounts(every)}", *_bits(run, sum(every.values())), *_births(run)]) + "."]
    if len(lost) > 1:
        shown = list(lost.items())[:NAMED]
        rest = sum(sum(water.values()) for water in list(lost.values())[NAMED:])
        more = f"; {len(lost) - NAMED} others {rest / 1e12:.3g} Gt" if len(lost) > NAMED else ""
        names = _names(run)
        lines.append(
            "Of this " + "; ".join(f"{names[number]} {_amounts(water)}" for number, water in shown) + more + "."
        )
    return lines


def _bits(run: xr.Dataset, melted: float) -> list[str]:
    """Return what is afloat as bits at the last record; files of earlier versions do not say."""
    ice = float(run["ice_in_bits"].isel(time=-1).sum()) if "ice_in_bits" in run and run.sizes["time"] else 0.0
    return [f"{ice / 1e12:.3g} Gt more are afloat as bits"] if ice > LEAST * melted else []


def _births(run: xr.Dataset) -> list[str]:
    """Return how many bergs were born after the first record without breaking off from one."""
    if not run.sizes["time"]:
        return []
    added = (run["fragment_parent"].values <= 0) & (run["fragment_birth_time"].values > run["time"].values[0])
    count, area = int(added.sum()), area_text(float(run["fragment_area"].values[added].sum()))
    return [f"{count} berg{'s' if count > 1 else ''} of {area} born on the way"] if count else []


def _names(run: xr.Dataset) -> dict[int, str]:
    numbers, parents = run["fragment_number"].values.tolist(), run["fragment_parent"].values.tolist()
    own = run["fragment_name"].values if "fragment_name" in run else np.full(len(numbers), "")
    return {
        n: called({"number": n, "parent": parent, "name": name})
        for n, parent, name in zip(numbers, parents, own, strict=True)
    }


def _amounts(water: dict[str, float]) -> str:
    whole = sum(water.values())
    parts = [f"{name.replace('_', ' ')} {w / 1e12:.3g}" for name, w in water.items() if w > LEAST * whole]
    return f"{whole / 1e12:.3g} Gt ({', '.join(parts)})"
