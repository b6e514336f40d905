"""Several bergs as one start of a run, each with its name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from riftberg.bergs.assembly import refuse_overlap
from riftberg.bergs.bonded import BondedBerg, check_name
from riftberg.bergs.bonding import Metric
from riftberg.errors import BergError
from riftberg.state import Bonds, elements_of

B = TypeVar("B", bound=BondedBerg)


def join(bergs: Sequence[B] | Mapping[str, B], names: Sequence[str] | None = None) -> B:
    """Return several bergs as one start of a run; see `riftberg.bergs.iceberg.Iceberg.join`."""
    if isinstance(bergs, Mapping):
        return join(list(bergs.values()), list(bergs) if names is None else names)
    parts = list(bergs) if isinstance(bergs, Iterable) and not isinstance(bergs, str) else []
    if not parts or not all(isinstance(berg, BondedBerg) for berg in parts):
        raise BergError(
            "no list of bergs",
            where="Iceberg.join",
            remedy="Give a list of one Iceberg or more, or a dict of names and bergs",
        )
    _check_alike(parts)
    named = _named(parts, names)
    first = parts[0]
    whole = replace(
        first,
        elements=_joined_elements(parts),
        bonds=_joined_bonds(parts),
        # Elements know their sides; the packing of the whole says how many bonds one may have.
        packing="hexagonal" if any(berg.packing == "hexagonal" for berg in parts) else "square",
        radius=float(np.average([berg.radius for berg in parts], weights=[berg.elements.size for berg in parts])),
        report={"source": f"{len(named)} bergs: {_listed([name for name, _ in named])}"},
        bergs=tuple(named),
        outlines=tuple(outline for berg in parts for outline in berg.outlines),
    )
    refuse_overlap(
        whole.elements, whole.packing, Metric(first.latlon, first.earth_radius, 360.0 if first.latlon else 0.0)
    )
    asked = [berg.report.get("outline_area") for berg in parts]
    # What the lattices lose is told of all together, where each was made from a shape.
    return whole if None in asked else whole._reported({**whole.report, "outline_area": sum(asked)})


def _check_alike(bergs: Sequence[BondedBerg]) -> None:
    """Refuse bergs that cannot be in one run."""
    for what, unit in (("latlon", ""), ("earth_radius", " m"), ("density", " kg m-3")):
        values = {getattr(berg, what) for berg in bergs}
        if len(values) > 1:
            one, other = sorted(values)[:2]
            raise BergError(
                f"bergs with {what} {one}{unit} and {other}{unit}", where="Iceberg.join",
                remedy="All bergs of a run have the same",
            )  # fmt: skip


def _named(bergs: Sequence[BondedBerg], names: Sequence[str] | None) -> list[tuple[str, int]]:
    """Return name and number of elements of each berg; those without a name are called ``berg 1`` and so on."""
    if names is not None and len(names) != len(bergs):
        raise BergError(f"{len(names)} names for {len(bergs)} bergs", where="Iceberg.join", remedy="Give one name each")
    counts: list[tuple[str, int]] = []
    for number, berg in enumerate(bergs):
        own = berg.bergs if names is None else ((names[number], berg.elements.size),)
        counts += own or ((f"berg {number + 1}", berg.elements.size),)
    for name, _ in counts:
        check_name(name)
    taken = [name for name, _ in counts]
    twice = next((name for name in taken if taken.count(name) > 1), None) if len(set(taken)) < len(taken) else None
    if twice is not None:
        raise BergError(f"two bergs are called {twice!r}", where="Iceberg.join", remedy="Give each its own name")
    return counts


def _joined_elements(bergs: Sequence[BondedBerg]) -> Any:
    """Return all elements, with identifiers and pieces numbered on."""
    arrays = [berg.elements.arrays() for berg in bergs]
    whole = {name: np.concatenate([part[name] for part in arrays]) for name in arrays[0]}
    before = np.cumsum([0, *(int(berg.elements.berg.max(initial=0)) for berg in bergs)])
    whole["berg"] = np.concatenate([berg.elements.berg + n for berg, n in zip(bergs, before, strict=False)])
    whole["id"] = np.arange(1, whole["id"].size + 1)
    return elements_of(whole)


def _joined_bonds(bergs: Sequence[BondedBerg]) -> Bonds:
    """Return all bonds, between the rows of all elements."""
    arrays = [berg.bonds.arrays() for berg in bergs]
    whole = {name: np.concatenate([part[name] for part in arrays]) for name in arrays[0]}
    before = np.cumsum([0, *(berg.elements.size for berg in bergs)])
    for end in ("first", "second"):
        whole[end] = np.concatenate([part[end] + n for part, n in zip(arrays, before, strict=False)])
    whole["id"] = np.arange(1, whole["id"].size + 1)
    return Bonds(**whole)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:5])} and {len(names) - 5} more"
