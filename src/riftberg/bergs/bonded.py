"""A placed berg: elements and bonds, changes to them, several bergs as one start, and descriptions."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Self, TypeVar

import numpy as np

from riftberg.bergs.bonding import (
    Metric,
    find_crossed,
    given_strengths,
    inscribed_radius,
    mark_cracks,
    refuse_overlap,
    sample_bonds,
    scatter,
    separations,
    share_outside,
    weaken,
)
from riftberg.bergs.lattice import Booleans
from riftberg.bergs.raster import is_map
from riftberg.config.units import count_text, place_text
from riftberg.config.values import flag, native, number
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.errors import BergError
from riftberg.parameters import Packing
from riftberg.physics.crevasses import prestress, rift_factor, stable_depth
from riftberg.physics.elementary import atan2, cos, sin
from riftberg.physics.floating import draft_of
from riftberg.plane import EqualAreaPlane, near
from riftberg.state import Bonds, Elements, Floats, build_elements, copy_state
from riftberg.system.input_files import value_shown


def check_seed(seed: Any) -> int:
    """Return a seed as a whole number, 0 or more; one is drawn for None."""
    plain = native(seed)
    if plain is None:
        return int(np.random.SeedSequence().generate_state(1)[0])
    if isinstance(plain, int) and not isinstance(plain, bool) and plain >= 0:
        return plain
    raise BergError(f"{value_shown(seed)} is no seed", where="seed", remedy="Give a whole number, 0 or more")


def outside_text(share: float) -> str:
    """Return that a part of a rift lies outside of the ice."""
    return (
        f"{max(share, 0.01):.0%} of it lies outside of the ice, where it does nothing: a rift is taken where the berg lies at "
        "the start, in longitude and latitude"
    )


def check_name(name: Any) -> None:
    """Refuse a text that is no name of a berg.

    Raises
    ------
    BergError
    """
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > 60:
        raise BergError(f"{name!r} is no name"[:120], where="name", remedy="Give a short text, such as A68a")


@dataclass(frozen=True, repr=False, eq=False)
class BondedBerg:
    """A lattice of ice columns joined by bonds, with methods that describe or change it.

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
    dates: tuple[datetime, ...] = ()

    def __repr__(self) -> str:
        e = self.elements
        lon, lat = self.centroid
        position = place_text(lon, lat, latlon=self.latlon)
        bonds, pieces = int((self.bonds.status == 0).sum()), int(e.berg.max())
        return (
            f"<{type(self).__name__}: {len(e.id)} {_kinds(self)} elements of radius {_radii(self)} m, {self.area / 1e6:.6g} km2, "
            f"{self.mass / 1e12:.4g} Gt, {bonds} bonds, {count_text(pieces, 'piece')}, at {position}>"
        )

    def _repr_html_(self) -> str:
        picture = portrait(self.elements, latlon=self.latlon, hexagonal=self.packing == "hexagonal")
        return card(picture, self.describe())

    def describe(self) -> str:
        """Return one line per property of a berg: size, place, bonds, initial strain."""
        e, b = self.elements, self.bonds
        lon, lat = self.centroid
        lines = [f"Iceberg from {self.report.get('source', 'unknown source')}"]
        if self.report.get("feature"):
            lines.append(f"  feature: {self.report['feature']}")
        lines += _each(self)
        lines.append(f"  elements: {len(e.id)} {_kinds(self)}, radius {_radii(self)} m")
        area = f"  area: {self.area / 1e6:.6g} km2"
        if "outline_area" in self.report:
            outline, error = self.report["outline_area"], self.report["area_error"]
            area += f" (outline {outline / 1e6:.6g} km2, error {100 * error:+.2f} %)"
        lines.append(area)
        lines.append(f"  mass: {self.mass / 1e12:.6g} Gt")
        draft = draft_of(e.thickness, self.density)
        lines.append(
            f"  thickness: {_range(e.thickness)} m, draft {_range(draft)} m, freeboard {_range(e.thickness - draft)} m"
        )
        position = place_text(lon, lat, latlon=self.latlon, digits=4)
        lines.append(f"  centroid: {position}")
        long_axis, short_axis, azimuth = principal_axes(self)
        lines.append(
            f"  extents: {long_axis / 1e3:.4g} km x {short_axis / 1e3:.4g} km, long axis {azimuth:.0f} degrees from north"
        )
        gone, weak = int((b.status != 0).sum()), int(((b.strength < 1) & (b.status == 0)).sum())
        lines.append(f"  bonds: {len(b.first) - gone} ({gone} removed, {weak} weaker than nominal)")
        lines += [
            f"  rift {k}: {count_text(rift['crossed'], 'bond')} crossed; {outside_text(rift['outside'])}"
            for k, rift in enumerate(self.report.get("rifts", ()), 1)
            if rift["outside"] > 0.0
        ]
        count = int(e.berg.max())
        drawn = self.report.get("outline_pieces", count)
        drawn_text = f" (the outline has {drawn})" if drawn != count else ""
        lines.append(f"  pieces: {count}{', not bonded to each other' if count > 1 else ''}{drawn_text}")
        lines.append(
            f"  largest initial strain: {self.initial_strain:.2g} (1e-5 is 50 Pa at a Young's modulus of 5 MPa)"
        )
        return "\n".join(lines)

    def named(self, name: str) -> Self:
        """Return the berg with a name, which its fragments, counts, maps and files bear."""
        check_name(name)
        return replace(self, bergs=((name, self.elements.size),))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bergs."""
        return tuple(name for name, _ in self.bergs)

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
        e, share = self.elements, self.elements.mass / self.elements.mass.sum()
        lon = near(e.lon, e.lon[0]) if self.latlon else e.lon  # pieces may lie on both sides of the date line
        return float((share * lon).sum()), float((share * e.lat).sum())

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
        self,
        rift: Any,
        *,
        strength: float | None = None,
        broken: bool = False,
        depth: float | None = None,
        crevasse_strength: float | None = None,
        crs: str | None = None,
        threshold: float = 0.5,
    ) -> Self:
        """Return the berg with weakened or removed bonds along rifts, by one of ``strength``, ``broken`` and ``depth``.

        Parameters
        ----------
        rift : array_like, list of array_like, path, geometry, DataArray or Raster
            Lines as arrays (n, 2) of longitude and latitude, a file or geometry of lines, or a gridded mask, also as NetCDF
            or GeoTIFF; where the berg lies now, after shift, placement and rotation. A table (CSV) holds open lines, one
            for each date, id, name, ring, part or line that it gives.
        strength : float, optional
            Factor from 0 to 1 on the strength of the crossed bonds; 0 if nothing else is given.
        broken : bool
            Remove the crossed bonds instead; their ``break_time`` stays NaN, for they never existed in the run.
        depth : float, optional
            Part of the thickness, between 0 and 1, that the rift cuts instead: the crossed bonds bear the rest
            (`riftberg.physics.crevasses`). It changes nothing where the ice is crevassed as deep without it.
        crevasse_strength : float, optional
            With ``depth``: `fracture.crevasse_strength` of the run, Pa.
        crs : str, optional
            Coordinate system of projected lines.
        threshold : float
            Value of a mask above which there is a rift.

        Raises
        ------
        BergError
            If no bond is crossed, or none or several of the changes are given. ``report`` and `describe` hold the part outside
            of the ice.
        """
        broken = flag(broken, where="broken", kind=BergError)
        if (strength is not None) + broken + (depth is not None) > 1:
            raise BergError("a rift has one of strength, broken and depth", where="rift", remedy="Give one of them")
        threshold = number(threshold, "1", where="threshold", kind=BergError)
        share = number(0.0 if strength is None else strength, "1", where="strength", kind=BergError)
        depth = None if depth is None else number(depth, "1", where="depth", kind=BergError)
        elements, bonds = copy_state(self.elements, self.bonds)
        lines = None
        if not is_map(rift):
            from riftberg.bergs.outline import line_strings  # which needs shapely

            lines = line_strings(rift, crs)
        crossed = find_crossed(elements, bonds, rift, lines, latlon=self.latlon, threshold=threshold)
        outside = share_outside(elements, rift, lines, latlon=self.latlon, threshold=threshold)
        record: dict[str, Any] = {"crossed": int(crossed.sum()), "broken": broken, "outside": outside}
        if depth is not None:
            factor, crevassed = self._cut_strength(crossed, depth, crevasse_strength)
            record |= {"depth": depth, "crevassed": crevassed, "unchanged": int((factor == 1.0).sum())}
        else:
            factor = np.array(share)
            record["strength"] = share
        weaken(elements, bonds, crossed, strength=factor, broken=broken)
        if broken and lines is not None:
            mark_cracks(elements, bonds, lines, self.latlon, crossed)
        report = {**self.report, "rifts": [*self.report.get("rifts", []), record]}
        return replace(self, elements=elements, bonds=bonds, report=report)

    def _cut_strength(self, crossed: Booleans, depth: float, crevasse_strength: Any) -> tuple[Floats, float]:
        """Return the reserve that a rift leaves to the bonds crossed, and how deep crevasses reach without it."""
        if crevasse_strength is None:
            raise BergError(
                f"a rift of the depth {depth:g} in ice whose crevasses have no strength", where="depth",
                remedy="Give fracture.crevasse_strength, from which its strength follows, or a strength in place of the depth",
            )  # fmt: skip
        if not 0.0 < depth < 1.0:
            raise BergError(f"depth {depth:g}", where="depth", remedy="Give a part of the thickness, between 0 and 1")
        tip = number(crevasse_strength, "Pa", where="crevasse_strength", kind=BergError)
        if not tip > 0.0:
            raise BergError(f"crevasse_strength {tip:g} Pa", where="crevasse_strength", remedy="Give one above 0")
        thickness = self.elements.thickness
        mean = 0.5 * (thickness[self.bonds.first[crossed]] + thickness[self.bonds.second[crossed]])
        stress = [prestress(h, self.density) for h in mean]
        return np.array([rift_factor(depth, tip, sigma) for sigma in stress]), stable_depth(tip, max(stress))

    def with_strength(
        self,
        distribution: Any = "weibull",
        *,
        shape: float | None = None,
        spread: float | None = None,
        seed: int | None = None,
    ) -> Self:
        """Return the berg with scattered bond strengths.

        Strengths are factors on the fracture thresholds; they multiply earlier factors.

        Parameters
        ----------
        distribution : {"weibull", "normal", "uniform"}, array_like, path, DataArray or Raster
            Distribution of mean 1 (`riftberg.bergs.bonding.scatter`); or one value per bond, in the order of ``bonds``;
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
        record: dict[str, Any]
        if drawn:
            shape, spread = (
                None if value is None else number(value, "1", where=name, kind=BergError)
                for name, value in (("shape", shape), ("spread", spread))
            )
            seed = check_seed(seed)
            factors = scatter(len(bonds.first), distribution, shape=shape, spread=spread, seed=seed)
            record = {"distribution": distribution, "shape": shape, "spread": spread, "seed": seed}
        else:
            if is_map(distribution) or isinstance(distribution, Path):
                factors = sample_bonds(distribution, elements, bonds)
            else:
                factors = given_strengths(distribution, len(bonds.first))
            record = {"distribution": "given", "least": float(factors.min()), "largest": float(factors.max())}
        bonds.strength[:] *= factors
        return replace(self, elements=elements, bonds=bonds, report={**self.report, "scatter": record})


B = TypeVar("B", bound=BondedBerg)


def with_report(berg: B, report: dict[str, Any]) -> B:
    """Return a berg with this report, completed by the error of its area."""
    full = dict(report)
    if "outline_area" in report:
        full["area_error"] = berg.area / report["outline_area"] - 1.0
    return replace(berg, report=full)


def join(bergs: Sequence[B] | Mapping[str, B], names: Sequence[str] | None = None) -> B:
    """Return several bergs as one start of a run; see `riftberg.bergs.iceberg.Iceberg.join`."""
    if isinstance(bergs, Mapping):
        return join(list(bergs.values()), list(bergs) if names is None else names)
    members = list(bergs) if isinstance(bergs, Iterable) and not isinstance(bergs, str) else []
    if not members or not all(isinstance(berg, BondedBerg) for berg in members):
        raise BergError(
            "no list of bergs",
            where="Iceberg.join",
            remedy="Give a list of one Iceberg or more, or a dict of names and bergs",
        )
    for attribute, unit in (("latlon", ""), ("earth_radius", " m"), ("density", " kg m-3")):
        values = {getattr(berg, attribute) for berg in members}
        if len(values) > 1:
            smaller, larger = sorted(values)[:2]
            raise BergError(
                f"bergs with {attribute} {smaller}{unit} and {larger}{unit}", where="Iceberg.join",
                remedy="All bergs of a run have the same",
            )  # fmt: skip
    if any(berg.dates for berg in members):
        raise BergError(
            "a cloud whose bergs have dates stands alone", where="Iceberg.join",
            remedy="Leave its dates out, or run it by itself",
        )  # fmt: skip
    counts = _count_elements(members, names)
    all_names = [name for name, _ in counts]
    name_text = (
        ", ".join(all_names) if len(all_names) <= 6 else f"{', '.join(all_names[:5])} and {len(all_names) - 5} more"
    )
    first = members[0]
    joined = replace(
        first,
        elements=_joined_elements(members),
        bonds=_joined_bonds(members),
        # Elements know their sides; the packing of the whole says how many bonds one may have.
        packing="hexagonal" if any(berg.packing == "hexagonal" for berg in members) else "square",
        radius=float(np.average([berg.radius for berg in members], weights=[berg.elements.size for berg in members])),
        report={"source": f"{len(counts)} bergs: {name_text}"},
        bergs=tuple(counts),
        outlines=tuple(outline for berg in members for outline in berg.outlines),
    )
    refuse_overlap(
        joined.elements, joined.packing, Metric(first.latlon, first.earth_radius, 360.0 if first.latlon else 0.0)
    )
    outline_areas = [berg.report.get("outline_area") for berg in members]
    # Losses by the lattices are reported of all together, where each was made from a shape.
    return (
        joined if None in outline_areas else with_report(joined, {**joined.report, "outline_area": sum(outline_areas)})
    )


def _count_elements(bergs: Sequence[BondedBerg], names: Sequence[str] | None) -> list[tuple[str, int]]:
    """Return name and number of elements of each berg; those without a name are called ``berg 1`` and so on."""
    if names is not None and len(names) != len(bergs):
        raise BergError(f"{len(names)} names for {len(bergs)} bergs", where="Iceberg.join", remedy="Give one name each")
    counts: list[tuple[str, int]] = []
    for k, berg in enumerate(bergs, start=1):
        berg_names = berg.bergs if names is None else ((names[k - 1], berg.elements.size),)
        counts += berg_names or ((f"berg {k}", berg.elements.size),)
    for name, _ in counts:
        check_name(name)
    all_names = [name for name, _ in counts]
    twice = (
        next((name for name in all_names if all_names.count(name) > 1), None)
        if len(set(all_names)) < len(all_names)
        else None
    )
    if twice is not None:
        raise BergError(f"two bergs are called {twice!r}", where="Iceberg.join", remedy="Give each its own name")
    return counts


def _joined_elements(bergs: Sequence[BondedBerg]) -> Any:
    """Return all elements, with identifiers and pieces numbered on."""
    arrays = [berg.elements.arrays() for berg in bergs]
    columns = {name: np.concatenate([berg_arrays[name] for berg_arrays in arrays]) for name in arrays[0]}
    # Numbers of pieces go on from the bergs before.
    offsets = np.cumsum([0, *(int(berg.elements.berg.max(initial=0)) for berg in bergs)])
    columns["berg"] = np.concatenate([berg.elements.berg + n for berg, n in zip(bergs, offsets, strict=False)])
    columns["id"] = np.arange(1, columns["id"].size + 1)
    return build_elements(columns)


def _joined_bonds(bergs: Sequence[BondedBerg]) -> Bonds:
    """Return all bonds, between the rows of all elements."""
    arrays = [berg.bonds.arrays() for berg in bergs]
    columns = {name: np.concatenate([bond_arrays[name] for bond_arrays in arrays]) for name in arrays[0]}
    # Ends of bonds are rows, which move by the elements of the bergs before.
    offsets = np.cumsum([0, *(berg.elements.size for berg in bergs)])
    for end in ("first", "second"):
        columns[end] = np.concatenate([bond_arrays[end] + n for bond_arrays, n in zip(arrays, offsets, strict=False)])
    columns["id"] = np.arange(1, columns["id"].size + 1)
    return Bonds(**columns)


MOST_LISTED = 10
"""Bergs that are reported one by one."""


def _each(berg: BondedBerg) -> list[str]:
    """Return a line for each of several bergs."""
    if len(berg.bergs) < 2:
        return []
    area, row, lines = berg.elements.length * berg.elements.width / 1e6, 0, []
    for name, count in berg.bergs[:MOST_LISTED]:
        lines.append(f"  {name}: {count_text(count, 'element')}, {area[row : row + count].sum():.4g} km2")
        row += count
    more = len(berg.bergs) - MOST_LISTED
    return [*lines, f"  and {more} more"] if more > 0 else lines


def _kinds(berg: BondedBerg) -> str:
    """Return the shapes of the elements in words."""
    shapes = ((4, "square"), (6, "hexagonal"))
    return " and ".join(word for sides, word in shapes if (berg.elements.sides == sides).any()) or berg.packing


def _radii(berg: BondedBerg) -> str:
    """Return the radius (m) of the elements; of several bergs, from the smallest to the largest by area."""
    e = berg.elements
    if len(berg.bergs) < 2:
        return f"{berg.radius:g}"
    radius = np.sqrt(e.length * e.width / np.where(e.sides == 6, 2.0 * np.sqrt(3.0), 4.0))
    low, high = f"{radius.min():.4g}", f"{radius.max():.4g}"
    return low if low == high else f"{low} to {high}"


def lost_in_lattice(berg: BondedBerg) -> tuple[str, bool]:
    """Return a line on the fit of a lattice to the requested shape, and whether a finer one would come closer.

    The line is empty where no shape was asked for, and where area and pieces equal the shape. A reader would notice half a
    per cent of the area.
    """
    outline_area = berg.report.get("outline_area")
    if not outline_area:
        return "", False
    error, pieces, drawn = (
        berg.area / outline_area - 1.0,
        int(berg.elements.berg.max()),
        berg.report.get("outline_pieces"),
    )
    shape = f", in {pieces} of {drawn} pieces" if drawn not in (None, pieces) else ""
    if abs(error) < 1e-6 and not shape:
        return "", False
    loses = abs(error) > 0.005 or bool(shape)
    line = (
        f"Asked for {outline_area / 1e6:.6g} km2 and {berg.mass / (1.0 + error) / 1e12:.4g} Gt; the lattice has "
        f"{berg.area / 1e6:.6g} km2 and {berg.mass / 1e12:.4g} Gt ({100.0 * error:+.2f} %){shape}"
    )
    return (f"{line}. A smaller berg.radius comes closer" if loses else line), loses


def _range(values: Floats) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.1f}" if high - low < 0.05 else f"{low:.1f} to {high:.1f}"


def principal_axes(berg: BondedBerg) -> tuple[float, float, float]:
    """Return the extents (m) along and across the principal axis, and the axis' azimuth (degrees, 0 to 180)."""
    e = berg.elements
    lon, lat = berg.centroid
    centre = np.full_like(e.lon, lon), np.full_like(e.lat, lat)
    metric = Metric(berg.latlon, berg.earth_radius, 360.0 if berg.latlon else 0.0)
    x, y = separations(metric, e.lon, e.lat, *centre)
    # The angle that makes the mixed second moment 0.
    angle = 0.5 * atan2(2.0 * float(np.mean(x * y)), float(np.mean(x * x) - np.mean(y * y)))
    c, s = cos(angle), sin(angle)
    along, across = x * c + y * s, y * c - x * s
    # From rim to rim: the extremes hold for centres.
    size = 2.0 * berg.radius
    return float(np.ptp(along)) + size, float(np.ptp(across)) + size, float((90.0 - np.degrees(angle)) % 180.0)


WIDTH: Final = 220.0
"""Longest side of the picture, pixels."""

MOST_DRAWN: Final = 1500
"""Elements that are drawn; of more, every n-th, larger."""

COLOURS: Final = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#777777")
"""Colours of the pieces, safe for colour-blind readers (Tol's bright scheme), in the order of their numbers."""


def portrait(elements: Elements, *, latlon: bool, hexagonal: bool) -> str:
    """Return a picture of the elements in true proportions, north up, coloured by piece."""
    if elements.size == 0:
        return ""
    stride = -(-elements.size // MOST_DRAWN)
    lon = near(elements.lon, elements.lon[0]) if latlon else elements.lon
    plane = EqualAreaPlane(float(lon.mean()), float(elements.lat.mean()), EARTH_RADIUS_A68, latlon)
    x, y = plane.forward(lon, elements.lat)
    # Where only every n-th is drawn, each stands for the area of n.
    half = 0.5 * np.sqrt(elements.length * elements.width) * np.sqrt(stride)
    low_x, high_x = float((x - half).min()), float((x + half).max())
    low_y, high_y = float((y - half).min()), float((y + half).max())
    scale = WIDTH / max(high_x - low_x, high_y - low_y)
    marks = [
        _mark((x[k] - low_x) * scale, (high_y - y[k]) * scale, half[k] * scale, float(elements.rotation[k]), hexagonal,
              COLOURS[(int(elements.berg[k]) - 1) % len(COLOURS)])
        for k in range(0, elements.size, stride)
    ]  # fmt: skip
    size = f'width="{(high_x - low_x) * scale:.0f}" height="{(high_y - low_y) * scale:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="the berg, north up">{"".join(marks)}</svg>'


def _mark(x: float, y: float, half: float, turn: float, hexagonal: bool, colour: str) -> str:
    corners = 6 if hexagonal else 4
    # The half side of a square of equal area; a hexagon of that area reaches 1.24 times as far.
    reach = half * (1.241 if hexagonal else np.sqrt(2.0))
    first = np.pi / 2.0 if hexagonal else np.pi / 4.0
    angles = first + turn + 2.0 * np.pi * np.arange(corners) / corners
    points = " ".join(f"{x + reach * cos(a):.1f},{y - reach * sin(a):.1f}" for a in angles)
    return f'<polygon points="{points}" fill="{colour}" stroke="white" stroke-width="0.4"/>'


def card(picture: str, text: str) -> str:
    """Return a picture beside lines of text, as a notebook shows it."""
    escaped = html.escape(text)
    pre = f'<pre style="margin:0;white-space:pre-wrap">{escaped}</pre>'
    return f'<div style="display:flex;gap:1em;align-items:center"><div>{picture}</div>{pre}</div>'
