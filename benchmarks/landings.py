"""Bergs that the sea floor stops or holds, beside a prototype, a plate by finite elements and sums of this script.

python benchmarks/landings.py             print the tables
python benchmarks/landings.py --write     also put them into docs/evidence/ground.md

The sums hold nothing of the package: a rigid berg on water and a bed that yields (`Balance`), bodies on a line, weights and
drags. Values of the prototype and of the plate come with their sources on the page.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import affinity
from story import print_tables, table

from riftberg import Forcing, Iceberg, Model, Parameters

PAGE = Path(__file__).resolve().parents[1] / "docs" / "evidence" / "ground.md"
HEAD = "berg, bed", "asked", "by", "reached", "deviation"
THICKNESS, ICE, SEA = 250.0, 850.0, 1025.0
DRAFT = THICKNESS * ICE / SEA
WATER = SEA * 9.8
"""Weight of the water that a metre of heave displaces, Pa m-1."""

LENGTH, WIDTH = 18e3, 9e3
AREA = LENGTH * WIDTH
DRAG = SEA * (0.5 * 0.9 * WIDTH * DRAFT + 0.0025 * AREA)
"""Of the water on front, back and base of that berg, over the square of the speed (kg m-1)."""

ROCK, SAND, CLAY = (1e9, 1e7, math.inf), (1e7, 1e6, math.inf), (1e6, 1.2e5, 2e4)
"""Stiffness (Pa m-1), bearing strength and shear strength (Pa) of beds; friction is a half."""

BEDS = {"rock": ROCK, "sand": SAND, "clay": CLAY}
ELASTIC = {"sediment": "other", "stiffness": 1e7, "bearing_strength": 1e9, "friction": 0.5}
TIDES = (0.5, 12.4206012 * 3600.0), (-0.3, 12.0 * 3600.0)
"""M2 and S2, which oppose each other at the start: height (m) and period (s)."""

METRE = 180.0 / (math.pi * 6_363_827.0)
"""In degrees, on the sphere of the package."""

PLANE: dict[str, Any] = {"latlon": False, "latitude": 0.0}
PROTOTYPE, PLATE, INTEGRAL = "prototype", "plate", "integral"


# ---- tables ----


def number(value: float) -> str:
    """Return a value with up to four digits, or three and a power of ten."""
    if 1e-2 <= abs(value) < 1e4:
        return f"{value:.4g}"
    return f"{value:.2e}".replace("e+", "e").replace("e0", "e").replace("e-0", "e-")


def row(case: str, asked: Sequence[float], source: str, reached: Sequence[float], unit: str) -> tuple[str, ...]:
    """Return a row in which each value is held against what is asked for it, or all against the one that is."""
    several = list(asked) * (len(reached) // len(asked))
    deviations = ", ".join(f"{100.0 * (b / a - 1.0):+.1f}" for a, b in zip(several, reached, strict=True))
    deviations = deviations.replace("+0.0", "0.0").replace("-0.0", "0.0")
    texts = [", ".join(map(number, values)) + f" {unit}".rstrip() for values in (asked, reached)]
    return case, texts[0], source, texts[1], f"{deviations} %"


# ---- a berg of 18 x 9 km ----


def parameters(grounding: dict[str, Any], **groups: Any) -> Parameters:
    """Return parameters of unbroken ice on a plane that does not turn, or on a sphere."""
    earth = {"latlon": False, "f_plane": True, "reference_latitude": 0.0}
    usual = {"ice": {"density": ICE}, "earth": earth, "fracture": {"enabled": False}, "stepping": {"time_step": 600.0}}
    return Parameters(grounding={"law": "seabed", **grounding}, **{**usual, **groups})


def oblong(
    floor: Any, *, towards: float = 0.0, speed: float = 0.3, current: float = 0.0, radius: float = 1500.0, dt: float = 600.0,
    **grounding: Any,
) -> Model:  # fmt: skip
    """Return the berg at the origin, under way ``towards`` (degrees from its long axis)."""
    a = math.radians(towards)
    berg = Iceberg.rectangle(
        LENGTH, WIDTH, thickness=THICKNESS, radius=radius, placement=(0.0, 0.0), density=ICE, latlon=False,
        velocity=(speed * math.cos(a), speed * math.sin(a)),
    )  # fmt: skip
    sea = Forcing.uniform((current, 0.0), **PLANE) + floor
    return Model(berg, sea, parameters(grounding, stepping={"time_step": dt}))


def rising(reach: float, towards: float = 0.0, *, gradient: float = 1e-3, draft: float = DRAFT) -> Any:
    """Return a floor that rises in a direction (degrees) and is as deep as the keel at ``reach`` m from the origin."""
    a = math.radians(towards)
    foot = reach * math.cos(a), reach * math.sin(a)
    return Forcing.slope(foot, 90.0 - towards, -gradient, draft, (1.0, 5000.0), latlon=False)


def flat(aground: float) -> Any:
    """Return a floor that lies so many metres above the keel."""
    return Forcing.uniform((0.0, 0.0), depth=DRAFT - aground, **PLANE)


def way_to_rest(model: Model, ahead: float, towards: float = 0.0, metre: float = 1.0) -> float:
    """Way of a berg (m) until it turns round or stands, less what lies ahead of the touch."""
    a, previous = math.radians(towards), -math.inf
    mass = model.elements.mass / model.elements.mass.sum()
    start = (model.elements.lon @ mass, model.elements.lat @ mass)
    for _ in range(600):
        model.step()
        x, y = model.elements.lon @ mass - start[0], model.elements.lat @ mass - start[1]
        way = float(x * math.cos(a) + y * math.sin(a)) / metre - ahead
        if way > 0.0 and way - previous < 1.0:
            return way
        previous = way
    raise RuntimeError("the berg does not come to rest")


def landed(gradient: float = 1e-3, **how: Any) -> float:
    """Way (m) of the berg that runs ashore with its short side."""
    return way_to_rest(oblong(rising(0.5 * LENGTH + 20.0, gradient=gradient), **how), 20.0)


def askew(radius: float) -> tuple[float, float]:
    """Way (m) and turn (degrees) of the berg whose front meets the slope at 5 degrees."""
    a = math.radians(5.0)
    reach = 0.5 * LENGTH * math.cos(a) + 0.5 * WIDTH * math.sin(a) + 20.0
    model = oblong(rising(reach, 5.0), radius=radius, sediment="rock")
    return way_to_rest(model, 20.0), math.degrees(model.elements.rotation[0])


def cornered(**how: Any) -> tuple[float, float]:
    """Way (m) and load at rest (N) of the berg that runs ashore with a corner, at 30 degrees and 0.2 m/s."""
    a = math.radians(30.0)
    floor = rising(0.5 * LENGTH * math.cos(a) + 0.5 * WIDTH * math.sin(a) + 5.0, 30.0)
    model = oblong(floor, towards=30.0, speed=0.2, sediment="rock", **how)
    return way_to_rest(model, 5.0, 30.0), float(model.elements.floor_load.sum())


def load_on_corner(rise: float, thickness: float) -> float:
    """Load (N) of a corner at 30 degrees on rock that rises by 1e-3, to ``rise`` m above the keel: both give way."""
    rigidity = 9e9 * thickness**3 / (12.0 * (1.0 - 0.3**2))
    ice = 0.786 * math.sqrt(WATER * rigidity)  # of a right-angled corner on water, by the prototype's finite elements
    widening, x = math.tan(math.radians(30.0)) + math.tan(math.radians(60.0)), np.arange(0.005, 1e3 * rise, 0.01)
    low, high = 0.0, rise
    while high - low > 1e-9:
        depth = 0.5 * (low + high)
        load = float((widening * x * np.clip(ROCK[0] * (depth - 1e-3 * x), 0.0, ROCK[1])).sum()) * 0.01
        low, high = (low, depth) if load > ice * (rise - depth) else (depth, high)
    return load


def long_corner() -> list[float]:
    """Load (N) of a berg of 150 x 50 km and 200 m, 1, 5 and 10 minutes after a corner has touched rock."""
    a, thickness = math.radians(30.0), 200.0
    berg = Iceberg.rectangle(
        150e3, 50e3, thickness=thickness, radius=2500.0, placement=(0.0, 0.0), density=ICE, latlon=False,
        velocity=(0.2 * math.cos(a), 0.2 * math.sin(a)),
    )  # fmt: skip
    floor = rising(75e3 * math.cos(a) + 25e3 * math.sin(a), 30.0, draft=thickness * ICE / SEA)
    model = Model(
        berg, Forcing.uniform((0.0, 0.0), **PLANE) + floor,
        parameters({"sediment": "rock"}, stepping={"time_step": 60.0}),
    )  # fmt: skip
    loads = []
    for _ in range(10):
        model.step()
        loads.append(float(model.elements.floor_load.sum()))
    return [loads[0], loads[4], loads[9]]


def held_current(asked: float) -> float:
    """Largest current (m/s) that does not move the berg 1 mm aground, sought within 3 % of what is asked."""
    low, high = 0.97 * asked, 1.03 * asked
    for _ in range(7):
        current = 0.5 * (low + high)
        model = oblong(flat(1e-3), speed=0.0, current=current, dt=3600.0, sediment="rock")
        model.advance(steps=6)
        low, high = (low, current) if model.elements.lon.mean() > 0.1 else (current, high)
    return 0.5 * (low + high)


def carried(aground: float, current: float, dt: float, *, tide: bool) -> tuple[float, int, float]:
    """Way (m), spells afloat and their length (h) in 30 days on a flat bed of rock."""
    floor = flat(aground)
    for height, period in TIDES if tide else ():
        phase = 0.0 if height > 0.0 else 180.0
        floor = floor + Forcing.tide(0.0, level=abs(height), period=period, level_phase=phase, **PLANE)
    model, afloat = oblong(floor, speed=0.0, current=current, dt=dt, sediment="rock"), [False]
    while model.time < 30.0 * 86400.0:
        model.step()
        afloat.append(not model.elements.floor_load.any())
    return float(model.elements.lon.mean()), int((np.diff(np.array(afloat, int)) == 1).sum()), sum(afloat) * dt / 3600.0


def floated(current: float, aground: float) -> tuple[float, int, float]:
    """Way (m), spells and hours afloat in 30 days by the level alone: a body on a line, with drag and friction."""
    h = 5.0
    seconds = np.arange(0.0, 30.0 * 86400.0, h)
    clear = sum(height * np.cos(2.0 * math.pi * seconds / period) for height, period in TIDES) - aground
    mass, speed, way = ICE * THICKNESS * AREA, 0.0, 0.0
    for friction in (0.5 * WATER * AREA * np.maximum(-clear, 0.0)).tolist():
        speed = max(speed + h * (DRAG * (current - speed) ** 2 - friction) / mass, 0.0)
        way += h * speed
    return way, int((np.diff((clear > 0.0).astype(int)) == 1).sum()), float((clear > 0.0).sum()) * h / 3600.0


def mirrored() -> list[tuple[float, float]]:
    """Load (N) and way (m) of a berg like an L of 21 elements that lands askew on sand, and of its mirror image."""
    steps = [(i, j) for i in range(6) for j in range(3)] + [(4, 3), (5, 3), (5, 4)]
    outcomes = []
    for side in (1.0, -1.0):
        x, y = 3e3 * np.array(steps, float).T
        x, y, a = x - x.mean(), side * (y - y.mean()), math.radians(25.0)
        berg = Iceberg.from_points(
            x, y, radius=1500.0, thickness=THICKNESS, density=ICE, latlon=False, velocity=(0.3, 0.1 * side)
        )
        reach = float(((x + 1500.0) * math.cos(a) + (side * y + 1500.0) * math.sin(a)).max()) + 20.0
        sea = Forcing.uniform((0.05, 0.02 * side), **PLANE) + rising(reach, 25.0 * side)
        model = Model(berg, sea, parameters({"sediment": "sand"}))
        model.advance(steps=24)
        el = model.elements
        outcomes.append((float(el.floor_load.sum()), math.hypot(el.lon[0] - x[0], el.lat[0] - y[0])))
    return outcomes


def way_rows() -> Iterator[tuple[str, ...]]:
    """Work the berg of 18 x 9 km."""
    ices = {"bending": False}, {}, {"ice_modulus": 1e9}
    for bed, asked in {"rock": (125.8, 303, 398), "sand": (145, 316, 410), "clay": (212, 358, 443)}.items():
        yield row(f"{bed}; rigid, 9, 1 GPa", asked, PROTOTYPE, [landed(sediment=bed, **ice) for ice in ices], "m")
    steep = [landed(1e-2, sediment=bed) for bed in BEDS]
    yield row("slope 1e-2; rock, sand, clay", (96.6, 103.7, 212), PROTOTYPE, steep, "m")
    soft = landed(sediment="clay", shear_strength=5e3, stiffness=2.5e5)
    yield row("clay of 5 kPa", (487,), PROTOTYPE, [soft], "m")
    sizes = [landed(sediment="rock", radius=radius) for radius in (1500.0, 750.0, 375.0)]
    yield row("rock, elements of 3, 1.5, 0.75 km", (303,), PROTOTYPE, sizes, "m")
    steps = [landed(sediment="rock", dt=dt) for dt in (60.0, 600.0, 3600.0)]
    yield row("rock, steps of 60, 600, 3600 s", (303,), PROTOTYPE, steps, "m")
    turns = [askew(radius) for radius in (1500.0, 750.0, 375.0)]
    yield (
        "front askew by 5 degrees, rock, free to turn; elements of 3, 1.5, 0.75 km", "578 m without turning", PROTOTYPE,
        ", ".join(f"{way:.1f}" for way, _ in turns) + " m, turned by " + ", ".join(f"{turn:.2f}" for _, turn in turns) + "°", "",
    )  # fmt: skip
    for modulus, source, way, load in ((9e9, PROTOTYPE, 554, 5.0e9), (1e9, PLATE, 873, 3.78e9)):
        reached = cornered(ice_modulus=modulus)
        case = f"corner at 30 degrees, 0.2 m/s, rock, {modulus / 1e9:g} GPa"
        yield row(f"{case}: way", (way,), source, reached[:1], "m")
        yield row(f"{case}: load", (load,), source, reached[1:], "N")
    asked = [load_on_corner(2e-4 * seconds, 200.0) for seconds in (60.0, 300.0, 600.0)]
    yield row(
        "150 x 50 km, 200 m, the same, 9 GPa: load after 1, 5, 10 min",
        asked,
        "corner and rock give",
        long_corner(),
        "N",
    )
    hold = 0.5 * WATER * AREA * 1e-3
    holds = math.sqrt(hold / DRAG)
    yield row("1 mm aground: largest current held", (holds,), "friction and drag", [held_current(holds)], "m/s")
    stretch = 0.1 * DRAG * 0.3**2 / hold
    yield row(
        "the same in 0.3 m/s: way in 30 days, steps of 3 h", (stretch,), "stretch of the anchors",
        [carried(1e-3, 0.3, 10800.0, tide=False)[0]], "m",
    )  # fmt: skip
    way, spells, hours = carried(0.6, 0.1, 600.0, tide=True)
    asked_way, asked_spells, asked_hours = floated(0.1, 0.6)
    yield row("M2 and S2, 0.6 m aground, 0.1 m/s, 30 days: way", (asked_way,), INTEGRAL, [way], "m")
    yield row("the same: times afloat", (asked_spells,), "level", [spells], "")
    yield row("the same: hours afloat", (asked_hours,), "level", [hours], "h")
    yield row(
        "M2 and S2, 1 mm aground at spring high water, 0.3 m/s, 30 days: way", (stretch / 601.0,),
        "stretch of the anchors", [carried(0.801, 0.3, 3600.0, tide=True)[0]], "m",
    )  # fmt: skip
    (load, way), (other_load, other_way) = mirrored()
    yield row("an L of 21 elements that lands askew on sand: load", (load,), "mirror image", [other_load], "N")
    yield row("the same: way", (way,), "mirror image", [other_way], "m")


# ---- other outlines ----


class Balance:
    """A rigid berg on water over a bed: thin strips across its way, each cut into points."""

    def __init__(
        self, outline: Any, bed: tuple[float, float, float], thickness: float = THICKNESS, points: int = 1
    ) -> None:
        outline = affinity.translate(outline, -outline.centroid.x, -outline.centroid.y)
        left, _, self.front, _ = outline.bounds
        edges = np.linspace(left, self.front, 8001)
        strips = shapely.intersection(outline, shapely.box(edges[:-1], -1e6, edges[1:], 1e6))
        strips, index = shapely.get_parts(strips, return_index=True)
        area, centre = shapely.area(strips), shapely.centroid(strips)
        across = area[:, None] / (edges[1] - edges[0]) * ((np.arange(points) + 0.5) / points - 0.5)
        self.x = np.repeat(0.5 * (edges[:-1] + edges[1:])[index], points)
        self.y = (shapely.get_y(centre)[:, None] + across).ravel()
        self.area = np.repeat(area / points, points)
        self.stiffness, self.strength, self.shear = bed
        draft = thickness * ICE / SEA
        self.mass = SEA * draft * area.sum()
        arms = self.arms(self.x, self.y)
        lever = (
            np.diag([0.0, 1.0, 1.0]) * area.sum() * draft * 0.5 * (thickness - draft)
        )  # centre of mass over that of buoyancy
        self.water = WATER * ((self.area * arms) @ arms.T - lever)
        self.rise = np.zeros(3)

    @staticmethod
    def arms(x: Any, y: Any) -> Any:
        """Return what heave and the two tilts lift."""
        return np.stack([np.ones(x.size), x, y])

    def press(self, floor: Any) -> tuple[float, float]:
        """Load, and friction that holds (N), where the floor stands above the floating keel by ``floor`` m at each point."""
        near = floor > min(floor.max() - 5.0, 0.0)
        floor, area, arms = floor[near], self.area[near], self.arms(self.x[near], self.y[near])
        yielding = self.strength / self.stiffness

        def energy(rise: Any) -> float:
            deep = np.maximum(floor - rise @ arms, 0.0)
            pressed = deep**2 - np.maximum(deep - yielding, 0.0) ** 2
            return float(0.5 * rise @ self.water @ rise + 0.5 * self.stiffness * (area @ pressed))

        for _ in range(100):
            deep = floor - self.rise @ arms
            force = self.stiffness * area * np.clip(deep, 0.0, yielding)
            tangent = self.stiffness * area * ((deep > 0.0) & (deep < yielding))
            step = np.linalg.solve(self.water + (tangent * arms) @ arms.T, arms @ force - self.water @ self.rise)
            share, least = 1.0, energy(self.rise)
            while energy(self.rise + share * step) > least * (1.0 + 1e-14) and share > 1e-6:
                share *= 0.5
            self.rise = self.rise + share * step
            if np.abs(step).max() < 1e-13 or share <= 1e-6:
                break
        deep = np.maximum(floor - self.rise @ arms, 0.0)
        pressure = self.stiffness * np.minimum(deep, yielding)
        return float(area @ pressure), float(area @ np.minimum(0.5 * pressure, self.shear))

    def way_to_rest(self, gradient: float, speed: float) -> float:
        """Way (m) until friction and the slope have taken the energy of the berg."""
        way, step, energy, previous = 0.0, 0.25, 0.5 * self.mass * speed**2, 0.0
        while True:
            load, friction = self.press(gradient * (way + step + self.x - self.front))
            force = friction + gradient * load
            taken = 0.5 * (force + previous) * step
            if taken > energy:
                return way + step * energy / taken
            way, energy, previous = way + step, energy - taken, force


def united(*boxes: tuple[float, float, float, float]) -> Any:
    """Return an outline of rectangles, in km."""
    return affinity.scale(shapely.union_all([shapely.box(*corners) for corners in boxes]), 1e3, 1e3, origin=(0.0, 0.0))


CROSS = affinity.rotate(united((-6.0, -2.0, 6.0, 2.0), (-2.0, -6.0, 2.0, 6.0)), 45.0)
STAIRS = united((-9.0, -6.0, -3.0, 6.0), (-3.0, -4.0, 3.0, 4.0), (3.0, -2.0, 9.0, 2.0))
TEE = united((-6.0, -1.5, 3.0, 1.5), (3.0, -6.0, 6.0, 6.0))
SQUARE = affinity.rotate(united((-4.0, -4.0, 4.0, 4.0)), 45.0)
CORNER = affinity.rotate(united((-9.0, -4.5, 9.0, 4.5)), -30.0)


def ashore(
    outline: Any, grounding: dict[str, Any], gradient: float, speed: float, *, dt: float = 600.0, **lattice: Any
) -> float:
    """Way (m) of a rigid berg of an outline up a slope to its east, in water without drag, near the equator of a sphere."""
    outline = affinity.translate(outline, -outline.centroid.x, -outline.centroid.y)
    berg = Iceberg.from_outline(
        affinity.scale(outline, METRE, METRE, origin=(0.0, 0.0)), thickness=THICKNESS, radius=500.0, density=ICE,
        velocity=(speed, 0.0), **lattice,
    )  # fmt: skip
    floor = Forcing.slope(((outline.bounds[2] + 5.0) * METRE, 0.0), 90.0, -gradient, DRAFT, (1.0, 5000.0))
    model = Model(
        berg, Forcing.uniform((0.0, 0.0)) + floor,
        parameters({"bending": False, **grounding}, earth={"period": 0.0}, drag={"ocean_scale": 0.0},
                   stepping={"time_step": dt}),
    )  # fmt: skip
    return way_to_rest(model, 5.0, metre=METRE)


def on_a_knoll(height: float, bed: str) -> tuple[float, float]:
    """Load (N) of a rigid berg of 30 x 30 km, a knoll of 120 m and 4 km under its middle: by rings of the knoll; reached."""
    side, knoll = 30e3, 120.0
    stiffness, strength, _ = BEDS[bed]
    r = 0.25 + 0.5 * np.arange(4000)
    top = height - knoll * (1.0 - np.exp(-(r**2) / (2.0 * 4e3**2)))
    low, high = 0.0, height
    while high - low > 1e-14:
        rise = 0.5 * (low + high)
        pressure = np.clip(stiffness * (top - rise), 0.0, strength)
        load = float((2.0 * math.pi * r * 0.5 * pressure).sum())
        low, high = (rise, high) if load > WATER * side**2 * rise else (low, rise)
    berg = Iceberg.rectangle(
        side, side, thickness=THICKNESS, radius=1500.0, placement=(0.0, 0.0), density=ICE, latlon=False
    )
    floor = Forcing.seamount((0.0, 0.0), knoll, 4e3, DRAFT + knoll - height, latlon=False)
    model = Model(
        berg, Forcing.uniform((0.0, 0.0), **PLANE) + floor,
        parameters({"bending": False, "sediment": bed}, stepping={"time_step": 1e-3}),
    )  # fmt: skip
    model.step()
    return load, float(model.elements.floor_load.sum())


def lone(along: float, across: float, thickness: float) -> tuple[float, float]:
    """Load (N) of a single berg on sand that rises along it by 1e-3, its middle 0.2 m aground: by the balance; reached."""
    balance = Balance(shapely.box(0.0, 0.0, along, across), SAND, thickness)
    asked, _ = balance.press(0.2 + 1e-3 * balance.x)
    berg = Iceberg.from_points([0.0], [0.0], length=along, width=across, thickness=thickness, density=ICE, latlon=False)
    floor = rising(0.0, draft=thickness * ICE / SEA - 0.2)
    model = Model(
        berg, Forcing.uniform((0.0, 0.0), **PLANE) + floor,
        parameters({"sediment": "sand", "bending": False}, stepping={"time_step": 1e-3}),
    )  # fmt: skip
    model.step()
    return asked, float(model.elements.floor_load.sum())


def leaning(dt: float) -> tuple[float, float]:
    """Friction (N) that holds a berg of 8 x 6 km, on which its like leans in 0.15 m/s: drag on both; reached after a day."""
    shape: dict[str, Any] = {"radius": 1000.0, "density": ICE, "latlon": False}
    both = [Iceberg.rectangle(8e3, 6e3, thickness=248.0 + 2.0 * n, placement=(8e3 * n, 0.0), **shape) for n in range(2)]
    model = Model(
        Iceberg.join(both), Forcing.uniform((0.15, 0.0), **PLANE) + flat(0.3),
        parameters({"sediment": "rock", "bending": False}, stepping={"time_step": dt}),
    )  # fmt: skip
    model.advance(days=1.0)
    drafts = np.array([248.0, 250.0]) * ICE / SEA
    asked = SEA * 0.15**2 * float((0.5 * 0.9 * 6e3 * drafts + 0.0025 * 48e6).sum())
    return asked, -float(model.elements.anchor_x.sum())


def pushed_on_a_line(first: float, second: float, aground: float, length: float = 5e3) -> float:
    """How far (m) a body of mass ``first`` (kg) pushes one that the bed holds: ice is crushed, anchors stretch.

    ``aground``: m; ``length``: of the faces that meet, m.
    """
    friction, face, h = 0.5 * WATER * 48e6 * aground, 1.5e6 * 200.0 * length / 20.0, 2e-3
    u, v, x, y, anchor, crushed = 0.2, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(round(600.0 / h)):
        depth = x - y
        force = max(min(face * depth, 100.0 * face * (depth - crushed)), 0.0)
        if force > 0.0:
            crushed = max(crushed, depth - force / (100.0 * face))
        u, v = u - h * force / first, v + h * (force + anchor) / second
        anchor = min(max(anchor - friction / 0.1 * h * v, -friction), friction)
        x, y = x + h * u, y + h * v
    return y


def pushed(dt: float) -> tuple[float, float]:
    """Way (m) of a berg of 8 x 6 km, 5 cm aground on sand, that one of 10 x 5 km and 200 m strikes: on a line; reached."""
    shape: dict[str, Any] = {"density": ICE, "latlon": False, "radius": 500.0}
    both = [
        Iceberg.rectangle(10e3, 5e3, thickness=200.0, velocity=(0.2, 0.0), **shape),
        Iceberg.rectangle(8e3, 6e3, thickness=250.0, placement=(9005.0, 0.0), **shape),
    ]
    model = Model(
        Iceberg.join(both), Forcing.uniform((0.0, 0.0), **PLANE) + flat(0.05),
        parameters({"bending": False}, drag={"ocean_scale": 0.0}, stepping={"time_step": dt}),
    )  # fmt: skip
    struck = model.elements.thickness > 225.0
    start, mass = model.elements.lon[struck].mean(), model.elements.mass
    model.advance(steps=round(1800.0 / dt))
    asked = pushed_on_a_line(float(mass[~struck].sum()), float(mass[struck].sum()), 0.05)
    return asked, float(model.elements.lon[struck].mean() - start)


def outline_rows() -> Iterator[tuple[str, ...]]:
    """Work bergs of other outlines, knolls, and bergs that meet on the bed."""
    clay, sand, rock = ({"sediment": bed} for bed in ("clay", "sand", "rock"))
    hexagons: dict[str, Any] = {"packing": "hexagonal", "lattice_angle": 31.0}
    cases: list[tuple[str, Any, Any, dict[str, Any], float, float, list[dict[str, Any]]]] = [
        ("cross of 12 km, arms of 4 km, turned by 45 degrees, clay, 2e-3, 0.25 m/s; lattice at 0, 11, 23 degrees, "
         "steps of 1 h", CROSS, CLAY, clay, 2e-3, 0.25,
         [{"lattice_angle": 0.0}, {"lattice_angle": 11.0}, {"lattice_angle": 23.0}, {"dt": 3600.0}]),
        ("stairs of 18 km, 4, 8, 12 km wide, the narrow end first, sand, 1.5e-3, 0.4 m/s; steps of 1, 10, 60 min",
         STAIRS, SAND, sand, 1.5e-3, 0.4, [{"dt": 60.0}, {}, {"dt": 3600.0}]),
        ("the wide end first, 1e-3, 0.2 m/s; squares, hexagons at 31 degrees",
         affinity.rotate(STAIRS, 180.0), SAND, sand, 1e-3, 0.2, [{}, hexagons]),
        ("T of 12 km with bars of 3 km, rock, 1e-3, 0.2 m/s; squares, hexagons", TEE, ROCK, rock, 1e-3, 0.2, [{}, hexagons]),
        ("square of 8 km over its corner, 1e7 Pa/m without yield, 3e-3, 0.15 m/s; lattice at 0, 45 degrees",
         SQUARE, (1e7, 1e9, math.inf), ELASTIC, 3e-3, 0.15, [{}, {"lattice_angle": 45.0}]),
        ("18 x 9 km over its corner at 30 degrees, rock, 1e-3, 0.2 m/s", CORNER, ROCK, rock, 1e-3, 0.2,
         [{}]),
    ]  # fmt: skip
    for words, outline, bed, grounding, gradient, speed, ways in cases:
        asked = Balance(outline, bed, points=16 if outline is CORNER else 1).way_to_rest(gradient, speed)
        yield row(words, (asked,), INTEGRAL, [ashore(outline, grounding, gradient, speed, **how) for how in ways], "m")
    for bed, height in (("rock", 0.9), ("sand", 0.9), ("sand", 0.3)):
        asked, load = on_a_knoll(height, bed)
        yield row(f"30 x 30 km on a knoll of {bed} {height:g} m above the keel: load", (asked,), INTEGRAL, [load], "N")
    for words, sizes in (
        ("single bergs of 600, 1000, 2000 m", ((600.0, 600.0, 150.0), (1e3, 1e3, 250.0), (2e3, 2e3, 200.0))),
        ("single berg of 2000 x 500 m, along the slope", ((2e3, 500.0, 200.0),)),
    ):
        asked, loads = zip(*(lone(*size) for size in sizes), strict=True)
        yield row(f"{words}, sand, 1e-3, 0.2 m aground: load", asked, INTEGRAL, loads, "N")
    for words, source, unit, case, steps in (
        ("a berg leans in 0.15 m/s on one that the bed holds: friction; steps of 5, 30, 60 min", "drag on both", "N",
         leaning, (300.0, 1800.0, 3600.0)),
        ("one of 10 x 5 km at 0.2 m/s strikes one of 8 x 6 km, 5 cm aground: its way; steps of 1 s, 1, 30 min",
         "bodies on a line", "m", pushed, (1.0, 60.0, 1800.0)),
    ):  # fmt: skip
        outcomes = [case(dt) for dt in steps]
        yield row(words, (outcomes[0][0],), source, [reached for _, reached in outcomes], unit)


# ---- a held berg that is struck ----


def strike(stands: str, speed: float, friction: float, dt: float) -> tuple[float, float]:
    """Largest force of steps (N) and tension (Pa) of a berg of 4 x 2 km and 200 m that strikes one of 300 m."""
    shape: dict[str, Any] = {"radius": 500.0, "latlon": False, "density": ICE}
    both = [
        Iceberg.rectangle(4e3, 2e3, thickness=200.0, placement=(0.0, 0.0), velocity=(speed, 0.0), **shape),
        Iceberg.rectangle(4e3, 2e3, thickness=300.0, placement=(4000.5, 0.0), **shape),
    ]
    depth = 300.0 * ICE / SEA - 5.0 if stands == "aground" else 1000.0
    model = Model(
        Iceberg.join(both), Forcing.uniform((0.0, 0.0), depth=depth, **PLANE),
        parameters({}, contact={"friction": friction}, stepping={"time_step": dt, "only_interactions": True}),
    )  # fmt: skip
    strikes = model.elements.thickness < 250.0
    model.elements.static[~strikes] = float(stands == "fixed")
    force = tension = 0.0
    for _ in range(math.ceil(30.0 / dt)):
        momentum = float((model.elements.mass * model.elements.u)[strikes].sum())
        model.step()
        force = max(force, (momentum - float((model.elements.mass * model.elements.u)[strikes].sum())) / dt)
        tension = max(tension, float(model.bonds.peak_stress[strikes[model.bonds.first]].max()))
    return force, tension


def struck_rows() -> Iterator[tuple[str, ...]]:
    """Work a berg that strikes one on the bed or one that is fixed."""
    stiffness, mass = 1.5e6 * 200.0 * 2e3 / 20.0, ICE * 200.0 * 8e6
    for speed in (0.05, 0.3):
        asked = speed * math.sqrt(stiffness * mass)
        forces = [strike(stands, speed, 0.0, 0.5)[0] for stands in ("aground", "fixed")]
        yield row(f"{speed:g} m/s: force; aground, fixed", (asked,), "v (k m)^(1/2)", forces, "N")
        asked = strike("fixed", speed, 0.2, 1.0)[1]
        tensions = [strike("aground", speed, 0.2, dt)[1] for dt in (1.0, 60.0)]
        yield row("the same: tension; steps of 1, 60 s", (asked,), "a fixed berg", tensions, "Pa")


TABLES: dict[str, Callable[[], Iterator[tuple[str, ...]]]] = {
    "way to rest": way_rows, "other outlines": outline_rows, "struck": struck_rows,
}  # fmt: skip
"""Marks on the page, and what makes the tables between them."""


def main() -> None:
    """Work all cases, print the tables, write them where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    write, tables = parser.parse_args().write, {}
    for mark, rows in TABLES.items():
        made = []
        for cells in rows():
            print(" | ".join(cells), file=sys.stderr, flush=True)
            made.append(cells)
        tables[mark] = table(HEAD, made)
    print_tables(PAGE, tables, write=write)


if __name__ == "__main__":
    main()
