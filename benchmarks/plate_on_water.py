"""An elastic plate on water that lands on a bed, by finite elements: what the law of the ground is held against.

python benchmarks/plate_on_water.py             print the tables
python benchmarks/plate_on_water.py --write     also put them into docs/evidence/plate-on-water.md

Plate theory and `scipy.sparse` alone, nothing of the package: a Kirchhoff plate with free edges on a Winkler foundation, by
bicubic Hermite elements (Bogner, Fox and Schmit 1965) on the rectangles of a graded mesh. The bed presses back with
``min(k_v <d>, q_u)`` at Gauss points, and Newton's method finds the balance of least energy.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid, quad
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_array, diags_array, kron
from scipy.sparse.linalg import splu

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "plate-on-water.md"
WATER = 1025.0 * 9.81
"""Weight of the water that one metre of heave displaces, Pa m-1."""

POISSON = 0.3
THICKNESS = 250.0
DRAG = 1.49e9
"""Of still water on the berg of 18 x 9 km, over speed squared (``ground_and_contact.md``), N s2 m-2."""

MASS = 18e3 * 9e3 * THICKNESS * 850.0
GAUSS = 4
"""Points of Gauss in each direction of an element: exact for the stiffness of cubics."""

Floats = NDArray[np.float64]


class Bed(NamedTuple):
    """A bed of sediment."""

    stiffness: float  # k_v, Pa m-1
    strength: float  # q_u, Pa
    shear_strength: float = math.inf  # alpha s_u, Pa
    friction: float = 0.5


FARTHEST = {
    (0.0, 9e9): 420.0,
    (0.0, 1e9): 510.0,
    (5.0, 9e9): 690.0,
    (5.0, 1e9): 820.0,
    (30.0, 9e9): 620.0,
    (30.0, 1e9): 930.0,
}
"""Way (m) beyond which a berg of this direction and modulus (Pa) is at rest."""

ROCK, SAND, CLAY = Bed(1e9, 1e7), Bed(1e7, 1e6), Bed(1e6, 1.2e5, 2e4)
BEDS = {"rock": ROCK, "sand": SAND, "clay": CLAY}


WIDTHS = (0.5, 1.0, 2.0, 4.0, 6.0, 10.0)
"""Of ramps under the end of a berg, over lambda."""


class Plate(NamedTuple):
    """A floating rectangle; unknowns at each node are the rise, its slopes and its mixed derivative."""

    x: Floats  # Lines of the mesh, m
    y: Floats
    stiffness: Any  # Of ice and water; sparse


class Contact(NamedTuple):
    """A plate on a bed."""

    load: float  # N
    friction: float  # That it holds at most, N


class Landing(NamedTuple):
    """Where a berg that runs up a slope comes to rest."""

    way: float  # By the floor alone, m
    way_in_water: float  # With the drag of still water, m
    load: float  # At the end of that, N


def graded(length: float, fine: float, width: float, growth: float = 1.3, coarse: float = 1000.0) -> Floats:
    """Lines of a mesh along a side: steps ``fine`` over ``width`` from its beginning, then growing up to ``coarse`` (m)."""
    steps = [fine] * round(width / fine)
    while sum(steps) < length:
        steps.append(min(steps[-1] * growth, coarse))
    lines = np.concatenate([[0.0], np.cumsum(steps)])
    inner = lines > width
    lines[inner] = width + (lines[inner] - width) * (length - width) / (lines[-1] - width)
    return lines


def hermite(lines: Floats, points: Floats, derivative: int) -> Any:
    """Sparse matrix from values and slopes at ``lines`` to a derivative of the cubic between them at ``points``."""
    cell = np.clip(np.searchsorted(lines, points, side="right") - 1, 0, lines.size - 2)
    h = lines[cell + 1] - lines[cell]
    t = (points - lines[cell]) / h
    # Polynomials in t, highest power first; slopes are per metre.
    cubics = ([2, -3, 0, 1], [1, -2, 1, 0], [-2, 3, 0, 0], [1, -1, 0, 0])
    values = (
        np.stack([np.polyval(np.polyder(cubic, derivative), t) for cubic in cubics], axis=1) / h[:, None] ** derivative
    )
    values[:, 1::2] *= h[:, None]
    column = 2 * cell[:, None] + np.arange(4)
    row = np.repeat(np.arange(points.size), 4)
    return csr_array((values.ravel(), (row, column.ravel())), shape=(points.size, 2 * lines.size))


def mirrored(lines: Floats) -> Floats:
    """Lines of a mesh with their mirror image, from zero on."""
    both: Floats = np.concatenate([-lines[:0:-1], lines]) + lines[-1]
    return both


def gauss(lines: Floats, between: tuple[float, float] = (-math.inf, math.inf)) -> tuple[Floats, Floats]:
    """Points and weights of Gauss in the elements that lie, in part or whole, between two bounds."""
    at, weight = np.polynomial.legendre.leggauss(GAUSS)
    inside = (lines[:-1] < between[1]) & (lines[1:] > between[0])
    begin, half = lines[:-1][inside], 0.5 * np.diff(lines)[inside]
    return (begin[:, None] + half[:, None] * (1.0 + at)).ravel(), (half[:, None] * weight).ravel()


def bending_length(modulus: float, poisson: float = POISSON, thickness: float = THICKNESS) -> float:
    """Length l = (D / k_w)^(1/4), m."""
    return float((modulus * thickness**3 / (12.0 * (1.0 - poisson**2)) / WATER) ** 0.25)


def floating_plate(
    x: Floats, y: Floats, modulus: float, poisson: float = POISSON, thickness: float = THICKNESS
) -> Plate:
    """Assemble ice and water; products of beams along both sides give the integrals over the rectangles."""
    rigidity = WATER * bending_length(modulus, poisson, thickness) ** 4

    def beams(lines: Floats) -> dict[tuple[int, int], Any]:
        points, weight = gauss(lines)
        shape = [hermite(lines, points, derivative) for derivative in range(3)]
        return {(i, j): shape[i].T @ diags_array(weight) @ shape[j] for i in range(3) for j in range(3)}

    along, across = beams(x), beams(y)
    bending = kron(along[2, 2], across[0, 0]) + kron(along[0, 0], across[2, 2])
    bending += poisson * (kron(along[2, 0], across[0, 2]) + kron(along[0, 2], across[2, 0]))
    bending += 2.0 * (1.0 - poisson) * kron(along[1, 1], across[1, 1])
    return Plate(x, y, (rigidity * bending + WATER * kron(along[0, 0], across[0, 0])).tocsc())


def factors(matrix: Any) -> Any:
    """Factors of a sparse, symmetric, positive definite matrix."""
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def point_stiffness(plate: Plate, x: float, y: float) -> float:
    """Load at a point over the deflection there, N m-1."""
    row = kron(hermite(plate.x, np.array([x]), 0), hermite(plate.y, np.array([y]), 0)).toarray()[0]
    return float(1.0 / (row @ factors(plate.stiffness).solve(row)))


def line_stiffness(plate: Plate, x: float) -> float:
    """Load per metre along a line across the plate over the deflection in its middle, Pa."""
    points, weight = gauss(plate.y)
    at = hermite(plate.x, np.array([x]), 0)
    line = kron(at, csr_array(weight[None] @ hermite(plate.y, points, 0))).toarray()[0]
    middle = kron(at, hermite(plate.y, np.array([0.5 * plate.y[-1]]), 0)).toarray()[0]
    return float(1.0 / (middle @ factors(plate.stiffness).solve(line)))


class Zone:
    """The part of a plate that the bed may touch; finds the balance for one overlap after another."""

    def __init__(self, plate: Plate, along: tuple[float, float], across: tuple[float, float]) -> None:
        self.plate = plate
        (x, along_weight), (y, across_weight) = gauss(plate.x, along), gauss(plate.y, across)
        self.shape = kron(hermite(plate.x, x, 0), hermite(plate.y, y, 0)).tocsr()
        self.x, self.y = np.repeat(x, y.size), np.tile(y, x.size)
        self.weight = np.outer(along_weight, across_weight).ravel()
        self.rise = np.zeros(plate.stiffness.shape[0])

    def press(self, overlap: Floats, bed: Bed, most: int = 100) -> Contact:
        """Find the balance from the last rise on; ``overlap``: of keel and floor at the points without rise, m."""
        top, ice, rise = bed.strength / bed.stiffness, self.plate.stiffness, self.rise

        def weigh(rise: Floats) -> tuple[float, Floats]:
            depth = np.maximum(overlap - self.shape @ rise, 0.0)
            stored = bed.stiffness * (depth**2 - np.maximum(depth - top, 0.0) ** 2)
            return 0.5 * float(rise @ (ice @ rise) + self.weight @ stored), depth

        energy, depth = weigh(rise)
        for _ in range(most):
            gradient = ice @ rise - self.shape.T @ (self.weight * bed.stiffness * np.minimum(depth, top))
            elastic = self.weight * bed.stiffness * ((depth > 0.0) & (depth < top))
            change = -factors(ice + self.shape.T @ diags_array(elastic) @ self.shape).solve(gradient)
            decrement, scale = -float(gradient @ change), 1.0
            if decrement <= 1e-8 * energy:
                break
            new, depth = weigh(rise + change)
            while new > energy - 1e-4 * scale * decrement and scale > 1e-6:
                scale *= 0.5
                new, depth = weigh(rise + scale * change)
            rise, energy = rise + scale * change, new
        else:
            raise RuntimeError(f"no balance of plate and bed after {most} iterations")
        self.rise, pressure = rise, bed.stiffness * np.minimum(depth, top)
        held = np.minimum(bed.friction * pressure, bed.shear_strength)
        return Contact(float(self.weight @ pressure), float(self.weight @ held))


def come_to_rest(ways: Floats, contacts: list[Contact], speed: float, gradient: float) -> Landing:
    """Follow the energy of motion of the berg of 18 x 9 km up a slope, with friction and push of the floor along its slope."""
    load = PchipInterpolator(ways, [contact.load for contact in contacts])
    resistance = PchipInterpolator(ways, [contact.friction + gradient * contact.load for contact in contacts])
    way = np.linspace(0.0, ways[-1], 4001)

    def stop(drag: float) -> float:
        # With d/ds E = -F - 2 (c / M) E for a drag c v^2, E exp(2 c s / M) falls by F exp(2 c s / M).
        growth = np.exp(2.0 * drag / MASS * way)
        energy = 0.5 * MASS * speed**2 - cumulative_trapezoid(resistance(way) * growth, way, initial=0.0)
        if energy[-1] > 0.0:
            raise RuntimeError(f"the berg still moves after {ways[-1]:g} m")
        return float(np.interp(0.0, -energy, way))

    still = stop(DRAG)
    return Landing(stop(0.0), still, float(load(still)))


def landing(bed: Bed, modulus: float, towards: float, speed: float, fine: float, gradient: float = 1e-3) -> Landing:
    """Let the berg of 18 x 9 km run up a slope, ``towards`` degrees from its long axis; ``fine``: steps of the mesh, m."""
    direction = np.array([math.cos(math.radians(towards)), math.sin(math.radians(towards))])
    farthest = FARTHEST[towards, modulus]
    along, across = (9e3 if part < 1e-9 else min(farthest / part, 9e3) for part in direction)
    wide = across > 4.5e3  # along the whole front the load varies slowly
    x = graded(18e3, fine, along)
    y = mirrored(graded(4.5e3, 200.0, 2e3)) if wide else graded(9e3, fine, across)
    zone = Zone(floating_plate(x, y, modulus), (0.0, along), (0.0, across))
    ways, contacts = farthest * np.linspace(0.0, 1.0, 13), [Contact(0.0, 0.0)]
    for before, way in pairwise(ways):
        zone.rise *= way / before if before > 0.0 else 0.0
        contacts.append(zone.press(gradient * (way - direction[0] * zone.x - direction[1] * zone.y), bed))
    return come_to_rest(ways, contacts, speed, gradient)


def ramp(bed: Bed, modulus: float, width: float, fine: float) -> float:
    """Load (N) of a berg 10 km wide, its end on a floor that rises by 1e-3 over ``width`` lambda; ``fine``: steps over lambda."""
    reach = math.sqrt(2.0) * bending_length(modulus)
    wide = width * reach
    length = 2e3 * math.ceil(max(20e3, wide + 8.0 * reach) / 2e3)
    x = graded(length, min(fine * reach, 2.0 * fine * wide), 1.2 * wide)
    y = mirrored(graded(5e3, 400.0, 2e3))
    zone = Zone(floating_plate(x, y, modulus), (0.0, 1.1 * wide), (0.0, 10e3))
    return zone.press(1e-3 * (wide - zone.x), bed).load


def bank(bed: Bed, modulus: float, fine: float) -> float:
    """Load (N) of a berg of 40 x 30 km with its end quarter on a floor that rises by 1e-3 to 10 m above the keel."""
    y = mirrored(graded(15e3, 2.0 * fine, 3e3, coarse=2e3))
    zone = Zone(floating_plate(graded(40e3, fine, 10e3, coarse=2e3), y, modulus), (0.0, 10e3), (0.0, 30e3))
    return zone.press(1e-3 * (10e3 - zone.x), bed).load


def flat(bed: Bed, modulus: float, fine: float) -> float:
    """Load (N) of the same berg wholly on a flat floor 1 m above its keel."""
    x, y = (np.linspace(0.0, side, round(side / (8.0 * fine)) + 1) for side in (40e3, 30e3))
    zone = Zone(floating_plate(x, y, modulus), (0.0, 40e3), (0.0, 30e3))
    return zone.press(np.ones(zone.x.size), bed).load


def knoll(bed: Bed, modulus: float, height: float, fine: float) -> float:
    """Load (N) of ice of 280 m on a bell of 120 m and 4 km below its inner part, ``height`` (m) above the keel."""
    radius = 4e3 * math.sqrt(-2.0 * math.log(1.0 - height / 120.0))
    lines = mirrored(graded(15e3, fine, radius, coarse=2e3))
    between = (15e3 - radius, 15e3 + radius)
    zone = Zone(floating_plate(lines, lines, modulus, thickness=280.0), between, between)
    square = (zone.x - 15e3) ** 2 + (zone.y - 15e3) ** 2
    return zone.press(height - 120.0 * (1.0 - np.exp(-square / (2.0 * 4e3**2))), bed).load


def theory() -> Iterator[tuple[str, ...]]:
    """Stiffness of a floating plate against what plate theory gives, over k_w l^2 (points) or k_w lambda (lines)."""
    length = bending_length(9e9)
    half, unit = graded(12.0 * length, 0.125 * length, length, coarse=length), WATER * length**2
    whole, end = mirrored(half), half[-1]
    for name, x, y, at, known in (
        ("point inside", whole, whole, end, 8.0),
        ("point at an edge", half, whole, 0.0, edge_point_stiffness()),
        ("point at a corner", half, half, 0.0, None),
    ):
        stiffness = point_stiffness(floating_plate(x, y, 9e9), at, 0.0 if y is half else end) / unit
        yield name, f"{stiffness:.4f}", "none" if known is None else f"{known:.4f}"
    strip = floating_plate(
        graded(20.0 * length, 0.125 * length, 8.0 * length), np.array([0.0, length]), 9e9, poisson=0.0
    )
    reach = math.sqrt(2.0) * bending_length(9e9, poisson=0.0)
    for distance in (0.0, 0.3, 1.0):
        stiffness = line_stiffness(strip, distance * reach) / (WATER * reach)
        yield f"line, {distance:g} λ from an edge", f"{stiffness:.4f}", f"{hetenyi(distance):.4f}"


def hetenyi(distance: float) -> float:
    """Stiffness of a half-infinite beam under a load at a distance (over lambda) from its end, over k_w lambda."""
    return 2.0 / (1.0 + math.exp(-2.0 * distance) * (2.0 + math.cos(2.0 * distance) - math.sin(2.0 * distance)))


def edge_point_stiffness() -> float:
    """Stiffness of a half-infinite plate under a point of its free edge, over k_w l^2: by Fourier integral along the edge.

    For a wave number k the deflection is ``A exp(-m x) + conj.`` with ``m^2 = k^2 + i``; at the edge the moment vanishes, and the
    shear of Kirchhoff is the load.
    """

    def deflection(k: float) -> float:
        m = np.sqrt(k * k + np.array([1j, -1j]))
        moment, shear = m**2 - POISSON * k * k, m**3 - (2.0 - POISSON) * k * k * m
        a = np.linalg.solve(np.stack([moment, shear]), np.array([0.0, -1.0]))
        return float(a.sum().real)

    return float(math.pi / quad(deflection, 0.0, math.inf)[0])


def cases() -> Iterator[tuple[str, Callable[[float], Any], float, float]]:
    """All cases: in words, with the step of the mesh as argument, and two steps (m)."""
    for modulus in (9e9, 1e9):
        for name, bed in BEDS.items():
            yield f"front, {_gpa(modulus)}, {name}", partial(landing, bed, modulus, 0.0, 0.3), 50.0, 25.0
    yield "front askew by 5°, 9 GPa, rock", partial(landing, ROCK, 9e9, 5.0, 0.3), 100.0, 50.0
    for modulus in (9e9, 1e9):
        yield f"corner, {_gpa(modulus)}, rock", partial(landing, ROCK, modulus, 30.0, 0.2), 100.0, 70.0
    for modulus in (9e9, 1e9):
        for width in WIDTHS:
            yield f"ramp {width:g} λ wide, {_gpa(modulus)}, rock", partial(ramp, ROCK, modulus, width), 0.12, 0.08
    for height in (0.9, 5.0):
        for name, bed in BEDS.items():
            yield f"knoll {height:g} m above the keel, {name}", partial(knoll, bed, 9e9, height), 120.0, 80.0
    for modulus in (9e9, 1e9):
        for name, bed in BEDS.items():
            yield f"bank, {_gpa(modulus)}, {name}", partial(bank, bed, modulus), 500.0, 250.0
    for name, bed in BEDS.items():
        yield f"flat floor, {name}", partial(flat, bed, 9e9), 500.0, 250.0


def _gpa(modulus: float) -> str:
    return f"{modulus / 1e9:g} GPa"


def row(name: str, case: Callable[[float], Any], coarse: float, fine: float) -> tuple[str, ...]:
    """Work a case on two meshes; the row of the finer one, with what the other gives more or less."""
    first, second = case(coarse), case(fine)
    if isinstance(second, Landing):
        change = max(abs(one / other - 1.0) for one, other in zip(first[1:], second[1:]))
        return name, f"{second.way:.0f} m", f"{second.way_in_water:.0f} m", f"{second.load:.3g} N", f"{change:.1%}"
    return name, "", "", f"{second:.4g} N", f"{abs(first / second - 1.0):.2%}"


def main() -> None:
    """Work all cases, print the tables, write them where that is asked for."""
    from story import print_tables, table  # here, for the plate itself takes nothing of the package

    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    write, rows = parser.parse_args().write, []
    for case in cases():
        rows.append(row(*case))
        print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    tables = {
        "plate theory": table(("load", "plate", "theory"), list(theory())),
        "plate on a bed": table(("case", "way", "way in still water", "load", "coarser mesh"), rows),
    }
    print_tables(PAGE, tables, write=write)


if __name__ == "__main__":
    main()
