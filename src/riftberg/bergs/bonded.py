"""A berg as it lies there: elements and bonds, what can be asked of it and done to its bonds, and several as one start."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from riftberg.bergs import strength as strengths
from riftberg.bergs.bonding import Metric, inscribed_radius, refuse_overlap
from riftberg.bergs.raster import is_map
from riftberg.config.values import native, number
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.state import Bonds, Elements, copy_state, elements_of
from riftberg.system.input_files import value_shown


def seed_of(seed: Any) -> int:
    """Return a seed as a whole number, 0 or more; one is drawn for None."""
    plain = native(seed)
    if plain is None:
        return int(np.random.SeedSequence().generate_state(1)[0])
    if isinstance(plain, int) and not isinstance(plain, bool) and plain >= 0:
        return plain
    raise BergError(f"{value_shown(seed)} is no seed", where="seed", remedy="Give a whole number, 0 or more")


def check_name(name: Any) -> None:
    """Refuse what is no name of a berg.

    Raises
    ------
    BergError
    """
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > 60:
        raise BergError(f"{name!r} is no name"[:120], where="name", remedy="Give a short text, such as A68a")


@dataclass(frozen=True, repr=False, eq=False)
class BondedBerg:
    """A lattice of ice columns joined by bonds, and what can be asked of and done to it.

    `riftberg.bergs.iceberg.Iceberg` adds the ways to make one, and lists the attributes.
    """

    elements: Elements
    bonds: Bonds
    packing: Packing
    radius: float
    report: dict[str, Any] = field(default_factory=dict)
    latlon: bool = True
    earth_radius: float = EARTH_RADIUS_A68
    density: float = 850.0
    bergs: tuple[tuple[str, int], ...] = ()
    outlines: tuple[Any, ...] = ()

    def named(self, name: str) -> Self:
        """Return the berg with a name, which its fragments, counts, maps and files bear."""
        check_name(name)
        return replace(self, bergs=((name, self.elements.size),))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bergs."""
        return tuple(name for name, _ in self.bergs)

    def _reported(self, report: dict[str, Any]) -> Self:
        """Return the berg with this report, completed by the error of its area."""
        full = dict(report)
        if "outline_area" in report:
            full["area_error"] = self.area / report["outline_area"] - 1.0
        return replace(self, report=full)

    @property
    def area(self) -> float:
        """Area of all elements, m2."""
        return float(np.sum(self.elements.length * self.elements.width))

    @property
    def mass(self) -> float:
        """Mass of all elements, kg."""
        return float(self.elements.mass.sum())

    @property
    def centroid(self) -> tuple[float, float]:
        """Mass-weighted mean longitude and latitude (degrees; m if not ``latlon``)."""
        share = self.elements.mass / self.elements.mass.sum()
        return float(share @ self.elements.lon), float(share @ self.elements.lat)

    @property
    def initial_strain(self) -> float:
        """Largest elongation or shortening of a bond relative to R1 + R2 (negative if shortening is larger)."""
        intact = self.bonds.status == 0
        if not intact.any():
            return 0.0
        radius = inscribed_radius(self.elements, self.packing)
        rest = (radius[self.bonds.first] + radius[self.bonds.second])[intact]
        strain = self.bonds.bond_length[intact] / rest - 1.0
        return float(strain[np.argmax(np.abs(strain))])

    def with_rifts(
        self, rift: Any, *, strength: float = 0.0, broken: bool = False, crs: str | None = None, threshold: float = 0.5
    ) -> Self:
        """Return the berg with weakened or removed bonds along rifts.

        Parameters
        ----------
        rift : array_like, list of array_like, path, geometry, DataArray or Raster
            Lines as arrays (n, 2) of longitude and latitude, a file or geometry of lines, or a gridded mask, also as NetCDF
            or GeoTIFF; where the berg lies now, after shift, placement and rotation. A table (CSV) holds open lines, one
            for each date, id, name, ring, part or line that it gives.
        strength : float
            Factor from 0 to 1 on the strength of the crossed bonds.
        broken : bool
            Remove the crossed bonds instead; their ``break_time`` stays NaN, for they never existed in the run.
        crs : str, optional
            Coordinate system of projected lines.
        threshold : float
            Value of a mask above which there is a rift.

        Raises
        ------
        BergError
            If no bond is crossed.
        """
        strength = number(strength, "1", where="strength", kind=BergError)
        threshold = number(threshold, "1", where="threshold", kind=BergError)
        elements, bonds = copy_state(self.elements, self.bonds)
        lines = None
        if not is_map(rift):
            from riftberg.bergs.outline import line_strings  # which needs shapely

            lines = line_strings(rift, crs)
        crossed = strengths.crossed_by(elements, bonds, rift, lines, latlon=self.latlon, threshold=threshold)
        strengths.weaken(elements, bonds, crossed, strength=strength, broken=broken)
        if broken and lines is not None:
            strengths.mark_cracks(elements, bonds, lines, self.latlon, crossed)
        made = {"crossed": int(crossed.sum()), "broken": broken, "strength": 0.0 if broken else strength}
        report = {**self.report, "rifts": [*self.report.get("rifts", []), made]}
        return replace(self, elements=elements, bonds=bonds, report=report)

    def with_strength(
        self,
        distribution: Any = "weibull",
        *,
        shape: float | None = None,
        spread: float | None = None,
        seed: int | None = None,
    ) -> Self:
        """Return the berg with scattered bond strengths.

        Strengths are factors on the fracture thresholds; they multiply what is there.

        Parameters
        ----------
        distribution : {"weibull", "normal", "uniform"}, array_like, path, DataArray or Raster
            Distribution of mean 1 (`riftberg.bergs.strength.scatter`); or one value per bond, in the order of ``bonds``;
            or a map, read at the middles of the bonds where the berg lies. Given values must be positive.
        shape, spread : float, optional
            Weibull modulus; standard deviation or half width.
        seed : int, optional
            Seed. One is drawn if none is given; the report names it, so that every berg can be made again.

        Raises
        ------
        BergError
            If values are missing or not positive.
        """
        elements, bonds = copy_state(self.elements, self.bonds)
        drawn = isinstance(distribution, str) and not is_map(distribution)
        if not drawn and (shape, spread, seed) != (None, None, None):
            raise BergError(
                "shape, spread and seed belong to a distribution",
                where="strength",
                remedy="Leave them out where strengths are given",
            )
        made: dict[str, Any]
        if drawn:
            shape, spread = (
                None if value is None else number(value, "1", where=name, kind=BergError)
                for name, value in (("shape", shape), ("spread", spread))
            )
            seed = seed_of(seed)
            factors = strengths.scatter(len(bonds.first), distribution, shape=shape, spread=spread, seed=seed)
            made = {"distribution": distribution, "shape": shape, "spread": spread, "seed": seed}
        else:
            if is_map(distribution) or isinstance(distribution, Path):
                factors = strengths.mapped(distribution, elements, bonds)
            else:
                factors = strengths.listed(distribution, len(bonds.first))
            made = {"distribution": "given", "least": float(factors.min()), "largest": float(factors.max())}
        bonds.strength[:] *= factors
        return replace(self, elements=elements, bonds=bonds, report={**self.report, "scatter": made})


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
    # What the lattices lose is reported of all together, where each was made from a shape.
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
    for k, berg in enumerate(bergs, start=1):
        own = berg.bergs if names is None else ((names[k - 1], berg.elements.size),)
        counts += own or ((f"berg {k}", berg.elements.size),)
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
    # Pieces are numbered on from those of the bergs before.
    before = np.cumsum([0, *(int(berg.elements.berg.max(initial=0)) for berg in bergs)])
    whole["berg"] = np.concatenate([berg.elements.berg + n for berg, n in zip(bergs, before, strict=False)])
    whole["id"] = np.arange(1, whole["id"].size + 1)
    return elements_of(whole)


def _joined_bonds(bergs: Sequence[BondedBerg]) -> Bonds:
    """Return all bonds, between the rows of all elements."""
    arrays = [berg.bonds.arrays() for berg in bergs]
    whole = {name: np.concatenate([part[name] for part in arrays]) for name in arrays[0]}
    # Ends of bonds are rows, which move by the elements of the bergs before.
    before = np.cumsum([0, *(berg.elements.size for berg in bergs)])
    for end in ("first", "second"):
        whole[end] = np.concatenate([part[end] + n for part, n in zip(arrays, before, strict=False)])
    whole["id"] = np.arange(1, whole["id"].size + 1)
    return Bonds(**whole)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:5])} and {len(names) - 5} more"
