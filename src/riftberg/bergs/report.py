"""What a berg is: in plain words, and as a small picture (SVG, text alone) for notebooks."""

from __future__ import annotations

import html
from typing import Final

import numpy as np

from riftberg.bergs.bonded import BondedBerg
from riftberg.bergs.bonding import Metric, separations
from riftberg.config.units import place_text
from riftberg.constants import DEGREE
from riftberg.physics.floating import draft_of
from riftberg.state import Elements, Floats


def describe(berg: BondedBerg) -> str:
    """Return one line per property of a berg: size, place, bonds, initial strain."""
    e, b = berg.elements, berg.bonds
    lon, lat = berg.centroid
    lines = [f"Iceberg from {berg.report.get('source', 'unknown source')}"]
    if berg.report.get("feature"):
        lines.append(f"  feature: {berg.report['feature']}")
    lines += _each(berg)
    lines.append(f"  elements: {len(e.id)} {_kinds(berg)}, radius {_radii(berg)} m")
    lines.append(_plan_area(berg))
    lines.append(f"  mass: {berg.mass / 1e12:.6g} Gt")
    draft = draft_of(e.thickness, berg.density)
    lines.append(
        f"  thickness: {_range(e.thickness)} m, draft {_range(draft)} m, freeboard {_range(e.thickness - draft)} m"
    )
    place = place_text(lon, lat, latlon=berg.latlon, digits=4)
    lines.append(f"  centroid: {place}")
    long_axis, short_axis, azimuth = principal_axes(berg)
    lines.append(
        f"  extents: {long_axis / 1e3:.4g} km x {short_axis / 1e3:.4g} km, long axis {azimuth:.0f} degrees from north"
    )
    gone, weak = int((b.status != 0).sum()), int(((b.strength < 1) & (b.status == 0)).sum())
    lines.append(f"  bonds: {len(b.first) - gone} ({gone} removed, {weak} weaker than nominal)")
    count = int(e.berg.max())
    drawn = berg.report.get("outline_pieces", count)
    drawn_text = f" (the outline has {drawn})" if drawn != count else ""
    lines.append(f"  pieces: {count}{', not bonded to each other' if count > 1 else ''}{drawn_text}")
    lines.append(f"  largest initial strain: {berg.initial_strain:.2g} (1e-5 is 50 Pa at a Young's modulus of 5 MPa)")
    return "\n".join(lines)


MOST_LISTED = 10
"""Bergs that are reported one by one."""


def _each(berg: BondedBerg) -> list[str]:
    """Return a line for each of several bergs."""
    if len(berg.bergs) < 2:
        return []
    area, row, lines = berg.elements.length * berg.elements.width / 1e6, 0, []
    for name, count in berg.bergs[:MOST_LISTED]:
        lines.append(f"  {name}: {count} element{'s' if count > 1 else ''}, {area[row : row + count].sum():.4g} km2")
        row += count
    more = len(berg.bergs) - MOST_LISTED
    return [*lines, f"  and {more} more"] if more > 0 else lines


def one_line(berg: BondedBerg) -> str:
    """Return elements, size, bonds, pieces and place of a berg in one line."""
    e = berg.elements
    lon, lat = berg.centroid
    place = place_text(lon, lat, latlon=berg.latlon)
    bonds, pieces = int((berg.bonds.status == 0).sum()), int(e.berg.max())
    return (
        f"{len(e.id)} {_kinds(berg)} elements of radius {_radii(berg)} m, {berg.area / 1e6:.6g} km2, "
        f"{berg.mass / 1e12:.4g} Gt, {bonds} bonds, {pieces} piece{'s' if pieces != 1 else ''}, at {place}"
    )


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


def _plan_area(berg: BondedBerg) -> str:
    text = f"  area: {berg.area / 1e6:.6g} km2"
    if "outline_area" in berg.report:
        outline, error = berg.report["outline_area"], berg.report["area_error"]
        text += f" (outline {outline / 1e6:.6g} km2, error {100 * error:+.2f} %)"
    return text


def lost_in_lattice(berg: BondedBerg) -> tuple[str, bool]:
    """Return in a line what a lattice makes of the shape that was asked for, and whether a finer one would come closer.

    The line is empty where no shape was asked for, and where area and pieces are those of the shape. Half a per cent of the
    area is what a reader would notice.
    """
    asked = berg.report.get("outline_area")
    if not asked:
        return "", False
    error, pieces, drawn = berg.area / asked - 1.0, int(berg.elements.berg.max()), berg.report.get("outline_pieces")
    shape = f", in {pieces} of {drawn} pieces" if drawn not in (None, pieces) else ""
    if abs(error) < 1e-6 and not shape:
        return "", False
    loses = abs(error) > 0.005 or bool(shape)
    line = (
        f"Asked for {asked / 1e6:.6g} km2 and {berg.mass / (1.0 + error) / 1e12:.4g} Gt; the lattice has "
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
    x, y = separations(Metric(berg.latlon, berg.earth_radius), e.lon, e.lat, *centre)
    # The angle that makes the mixed second moment 0.
    angle = 0.5 * np.arctan2(2.0 * np.mean(x * y), np.mean(x * x) - np.mean(y * y))
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    # From rim to rim: the extremes are those of centres.
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
    x, y = _metres(elements, latlon)
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


def _metres(elements: Elements, latlon: bool) -> tuple[Floats, Floats]:
    """Return positions in metres about the first element; a berg across longitude 180 stays in one piece."""
    if not latlon:
        return elements.lon, elements.lat
    east = (elements.lon - elements.lon[0] + 180.0) % 360.0 - 180.0
    per_degree = 6.371e6 * DEGREE
    return east * per_degree * np.cos(elements.lat.mean() * DEGREE), (elements.lat - elements.lat[0]) * per_degree


def _mark(x: float, y: float, half: float, turn: float, hexagonal: bool, colour: str) -> str:
    corners = 6 if hexagonal else 4
    # The half side of a square of equal area; a hexagon of that area reaches 1.24 times as far.
    reach = half * (1.241 if hexagonal else np.sqrt(2.0))
    first = np.pi / 2.0 if hexagonal else np.pi / 4.0
    angles = first + turn + 2.0 * np.pi * np.arange(corners) / corners
    points = " ".join(f"{x + reach * np.cos(a):.1f},{y - reach * np.sin(a):.1f}" for a in angles)
    return f'<polygon points="{points}" fill="{colour}" stroke="white" stroke-width="0.4"/>'


def card(picture: str, text: str) -> str:
    """Return a picture beside lines of text, as a notebook shows it."""
    shown = html.escape(text)
    pre = f'<pre style="margin:0;white-space:pre-wrap">{shown}</pre>'
    return f'<div style="display:flex;gap:1em;align-items:center"><div>{picture}</div>{pre}</div>'
