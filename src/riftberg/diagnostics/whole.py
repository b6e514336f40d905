"""A berg that stayed whole: how near it came to breaking, where and when, and which forces drove and braked it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from riftberg.config.units import minute_text, place_text
from riftberg.diagnostics.cut import body_forces, iso, read_mass
from riftberg.engines.common.fragments.grounding_log import STANDSTILL
from riftberg.runs.scene import Scene

MOMENTS: Final = 41
"""Records at which the forces are taken."""

TOLD: Final = 0.05
"""Part of the power from which on a force is named, of at most three."""


@dataclass(frozen=True)
class NearestBond:
    """The bond that came nearest to its strength in tension."""

    time: str
    lon: float  # Of its middle; m in a run in metres
    lat: float
    elements: list[int]  # Ids of its ends
    stress: float  # Pa
    strength: float  # Pa


@dataclass(frozen=True)
class WholeBerg:
    """The largest berg of a run, from record to record."""

    name: str
    times: list[str]
    # Largest tensile stress since the last record of any bond that it has at the end, over its strength; empty without bonds
    used: list[float]
    nearest: NearestBond | None
    fracture: bool  # Whether bonds may break at all
    moments: list[str]  # Dates of the series below
    speed: list[float]  # Of its centre, m s-1
    aground: list[int]  # Elements
    forces: dict[str, list[float]]  # Size of each force on it, N
    power: dict[str, float]  # Power of each along its way, W, mean over these dates


def whole_berg(scene: Scene) -> WholeBerg:
    """Return the history of the largest berg of a run."""
    run, p, number = scene.run, scene.parameters.kernel_values(), scene.numbers[0]
    last = max(0, len(scene.times) - 2)  # The force of the floor is its mean until the next record
    # Those at which it touched, too: the sea floor may stop it from one record to the next.
    touched = np.searchsorted(scene.times, [np.datetime64(stay.began) for stay in scene.stays])
    even = np.linspace(0, last, MOMENTS).astype(int)
    chosen = np.unique(np.clip([*even, *touched, *(touched + 1)], 0, last)).tolist()
    spans = np.gradient(scene.seconds[chosen]) / max(float(np.ptp(scene.seconds)), 1.0) if len(chosen) > 1 else [1.0]
    forces: dict[str, list[float]] = {}
    power: dict[str, float] = {}
    speed, aground = [], []
    for record, span in zip(chosen, spans, strict=True):
        body = scene.berg[record] == scene.ancestor(number, record)
        if not body.any():  # it has melted away
            chosen = chosen[: chosen.index(record)]
            break
        weight = read_mass(run, record)[body]
        pair = [run[name].isel(time=record).values[body] for name in ("u", "v")]
        motion = np.array([np.average(component, weights=weight) for component in pair])
        acting, floor = body_forces(scene, p, record, body)
        speed.append(float(np.hypot(*motion)))
        aground.append(floor)
        for name, values in acting.items():
            force = values[body].sum(axis=0)
            forces.setdefault(name, []).append(float(np.hypot(*force)))
            power[name] = power.get(name, 0.0) + float(force @ motion) * float(span)
    used, nearest = _most_stressed(scene, number)
    return WholeBerg(
        scene.name(number), [iso(time) for time in scene.times], used, nearest, scene.parameters.fracture.enabled,
        [iso(scene.times[k]) for k in chosen], speed, aground, forces, power,
    )  # fmt: skip


def _most_stressed(scene: Scene, number: int) -> tuple[list[float], NearestBond | None]:
    """Return at each record which part of its strength the most stressed bond of a berg bears, and that bond."""
    run = scene.run
    ends = np.stack([run[name].values for name in ("bond_first", "bond_second")])
    inside = np.isin(scene.berg[-1][ends], number).all(axis=0) if run.sizes["bond"] else np.zeros(0, bool)
    # Bonds of the berg may break and leave it whole: of those that hold at the end, how near was the next to break?
    rows = np.flatnonzero(inside & scene.bonds.unbroken[-1])
    if not rows.size:
        return [], None
    stress, strength = scene.bonds.tension()[:, rows], scene.bonds.strengths[:, rows] * run["strength"].values[rows]
    if (damage := scene.bonds.damage()) is not None:
        strength = strength * (1.0 - damage[:, rows])
    ratio = np.divide(stress, strength, out=np.zeros_like(stress), where=strength > 0.0)
    record, bond = np.unravel_index(int(ratio.argmax()), ratio.shape)
    pair = ends[:, rows[bond]]
    x, y = (float(axis[record][pair].mean()) for axis in (scene.x, scene.y))
    ids = run["trajectory"].values[pair].tolist()
    nearest = NearestBond(
        iso(scene.times[record]), x, y, ids, float(stress[record, bond]), float(strength[record, bond])
    )
    return ratio.max(axis=1).tolist(), nearest


def whole_lines(berg: WholeBerg, *, latlon: bool) -> list[str]:
    """Return in sentences how near a berg came to breaking, and the forces that drove and braked it."""
    lines, bond = [], berg.nearest
    if bond is not None and bond.strength > 0.0:
        percent = 100.0 * bond.stress / bond.strength
        off = "" if berg.fracture else " Bonds cannot break in this run (fracture.enabled is false)."
        lines.append(
            f"{berg.name.capitalize()} came nearest to breaking at {minute_text(bond.time)}: {bond.stress / 1e3:.3g} of "
            f"{bond.strength / 1e3:.3g} kPa ({percent:.0f} %) in the bond of elements {bond.elements[0]} "
            f"and {bond.elements[1]} at "
            f"{place_text(bond.lon, bond.lat, latlon=latlon, digits=2)}.{off}"
        )
    moved = [
        f"{verb} by {' and '.join(shares)}"
        for verb, sign in (("driven", 1.0), ("braked", -1.0))
        if (shares := _shares(berg.power, sign))
    ]
    end = "stands still" if berg.speed[-1] < STANDSTILL else f"moves at {berg.speed[-1]:.2g} m/s"
    motion_text = f"; on its way it was {', '.join(moved)}" if moved else ""
    lines.append(f"It {end} at the end{motion_text}.")
    return lines


def _shares(power: dict[str, float], sign: float) -> list[str]:
    """Return the two or three forces that give most of the power of a sign, with their parts of it."""
    ranked = sorted(((sign * value, name) for name, value in power.items() if sign * value > 0.0), reverse=True)
    total = sum(value for value, _ in ranked)
    return [f"{name} ({100.0 * value / total:.0f} %)" for value, name in ranked[:3] if value >= TOLD * total]
