"""Small models that the verification tests share, and sums over their elements."""

from __future__ import annotations

from typing import Any

import numpy as np

from riftberg import Forcing, Iceberg, Model, Parameters

DENSITY = 850.0
RADIUS = 1500.0
THICKNESS = 200.0


def parameters(**groups: dict[str, Any]) -> Parameters:
    """Return parameters on a plane without Coriolis force, fracture or contact distance, with some values changed.

    Of the explicit scheme, unless another one is asked for: theory is written for its bonds.
    """
    base: dict[str, dict[str, Any]] = {
        "fracture": {"enabled": False},
        "stepping": {"scheme": "mts", "time_step": 600.0},
        "earth": {"latlon": False, "period": 0.0},
    }
    for group, values in groups.items():
        base[group] = {**base.get(group, {}), **values}
    return Parameters(**base)


def single(forcing: Forcing | None = None, *, velocity: tuple[float, float] = (0.0, 0.0), spin: float = 0.0,
           **groups: Any) -> Model:  # fmt: skip
    """Return a model of one element."""
    berg = Iceberg.from_points(
        [0.0], [0.0], thickness=THICKNESS, radius=RADIUS, density=DENSITY, velocity=velocity, spin=spin, latlon=False
    )
    return Model(berg, forcing or Forcing.uniform(), parameters(**groups))


def lattice(p: Parameters, columns: int = 5, rows: int = 3, forcing: Forcing | None = None, **kwargs: Any) -> Model:
    """Return a model of a rectangular lattice about the origin."""
    side = 2.0 * RADIUS
    berg = Iceberg.rectangle(
        side * columns, side * rows, thickness=THICKNESS, radius=RADIUS, density=DENSITY,
        packing=p.bonds.packing, latlon=False, **kwargs,
    )  # fmt: skip
    return Model(berg, forcing or Forcing.uniform(), p)


def shake(model: Model, *, speed: float, spin: float, stretch: float = 0.0, seed: int = 1) -> None:
    """Add random velocities (m s-1), spins (rad s-1) and displacements (m)."""
    el, r = model.elements, np.random.default_rng(seed)
    n = el.mass.size
    for name in ("u", "v"):
        getattr(el, name)[:] += speed * r.standard_normal(n)
        getattr(el, f"{name}_sync")[:] = getattr(el, f"{name}_pair")[:] = getattr(el, name)
    el.spin[:] += spin * r.standard_normal(n)
    for name in ("lon", "lat"):
        getattr(el, name)[:] += stretch * r.standard_normal(n)
        getattr(el, f"{name}_pair")[:] = getattr(el, name)


def turn(model: Model, rate: float) -> None:
    """Set the velocities of rigid rotation about the centre of mass, rad s-1."""
    el = model.elements
    share = el.mass / el.mass.sum()
    el.u[:], el.v[:] = -rate * (el.lat - share @ el.lat), rate * (el.lon - share @ el.lon)
    for name in ("u", "v"):
        getattr(el, f"{name}_sync")[:] = getattr(el, f"{name}_pair")[:] = getattr(el, name)
    el.spin[:] = rate


def inertia(model: Model) -> Any:
    """Moment of inertia of the discs of the elements, kg m2."""
    el = model.elements  # whose lattice is stretched to the area of its outline
    squares = el.length * el.width / np.where(el.sides == 6, 2.0 * np.sqrt(3.0), 4.0)
    return 0.5 * el.mass * squares


def spin_now(model: Model) -> Any:
    """Spin at the time of the positions: that of the state is half a sub-step ahead (semi-implicit Euler)."""
    started = 1.0 if model.step_number else 0.0
    h = model.parameters.time_step / model.substeps
    return model.elements.spin - started * 0.5 * h * model.elements.spin_rate


def angular_momentum(model: Model) -> float:
    """Angular momentum about the origin with that of the spins, kg m2 s-1."""
    el = model.elements
    return float(np.sum(el.mass * (el.lon * el.v - el.lat * el.u)) + np.sum(inertia(model) * spin_now(model)))


def momentum(model: Model, *, synchronised: bool = False) -> Any:
    """Momentum, kg m s-1."""
    el = model.elements
    u, v = (el.u_sync, el.v_sync) if synchronised else (el.u, el.v)
    return np.array([np.sum(el.mass * u), np.sum(el.mass * v)])


def energy(model: Model) -> float:
    """Energy (J) of motion, spin and bonds of an undamped lattice of equal squares with ``linear_bending``."""
    el, bonds, p = model.elements, model.bonds, model.parameters.bonds
    kinetic = 0.5 * np.sum(el.mass * (el.u**2 + el.v**2)) + 0.5 * np.sum(inertia(model) * spin_now(model) ** 2)
    i, j = bonds.first, bonds.second
    normal = p.youngs_modulus * THICKNESS
    length = np.hypot(el.lon[i] - el.lon[j], el.lat[i] - el.lat[j])
    h = model.parameters.time_step / model.substeps
    # The angles of the state are one sub-step ahead of the positions.
    angle = el.rotation - (h * el.spin if model.step_number else 0.0)
    stretched = 0.5 * normal * np.sum((length - 2 * RADIUS) ** 2)
    sheared = 0.5 * normal / (2 * (1 + p.poisson)) * np.sum(bonds.shear_x**2 + bonds.shear_y**2)
    bent = 0.5 * normal * (2 * RADIUS) ** 2 / 12.0 * np.sum((angle[i] - angle[j]) ** 2)
    return float(kinetic + stretched + sheared + bent)
