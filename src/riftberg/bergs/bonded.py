"""A berg as it lies there: elements, the bonds between them, what can be asked of it and done to its bonds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from riftberg.bergs import rifts, strength
from riftberg.bergs.assembly import inscribed_radius
from riftberg.bergs.raster import is_map
from riftberg.config.values import native, number
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.state import Bonds, Elements, copy_state
from riftberg.system.input_files import value_shown


def check_seed(seed: Any) -> int | None:
    """Return a seed as a whole number, 0 or more; None stays."""
    plain = native(seed)
    if plain is None or (isinstance(plain, int) and not isinstance(plain, bool) and plain >= 0):
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
            for each date, id, name, ring, part or line that it tells.
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
        crossed = rifts.crossed_by(elements, bonds, rift, latlon=self.latlon, crs=crs, threshold=threshold)
        rifts.weaken(elements, bonds, crossed, strength=strength, broken=broken)
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
            seed = check_seed(seed)
            seed = int(np.random.SeedSequence().generate_state(1)[0]) if seed is None else seed
            factors = strength.scatter(len(bonds.first), distribution, shape=shape, spread=spread, seed=seed)
            made = {"distribution": distribution, "shape": shape, "spread": spread, "seed": seed}
        else:
            if is_map(distribution) or isinstance(distribution, Path):
                factors = strength.mapped(distribution, elements, bonds)
            else:
                factors = strength.listed(distribution, len(bonds.first))
            made = {"distribution": "given", "least": float(factors.min()), "largest": float(factors.max())}
        bonds.strength[:] *= factors
        return replace(self, elements=elements, bonds=bonds, report={**self.report, "scatter": made})
