"""Test cases with a known answer: a beam against elastic theory, and two bergs that collide.

Beams
-----
A beam of length L, bending stiffness E J (N m2) and load P (N):

- on two supports with the load in its middle, for small slopes,
  ``w(x) = P x (3 L^2 - 4 x^2) / (48 E J)`` up to the middle, so ``w(L/2) = P L^3 / (48 E J)``;
- clamped at one end with a dead load at the other, for deflections of any size (elastica),
  ``E J theta'(s) = P (x(L) - x(s))``, ``x' = cos theta``, ``y' = sin theta``, ``theta(0) = 0``; for a small load the end
  moves by ``P L^3 / (3 E J)``.

Neither includes stretching and shear, which change the deflection of a beam of few elements in height a little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xarray as xr

from riftberg.config.units import duration_text
from riftberg.runs.scene import Scene
from riftberg.state import Floats

Held = Literal["supported", "clamped"]


# ---- beams ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class BeamCase:
    """How a beam is made, held and loaded."""

    held: Held  # Supported at both ends with the load in the middle, or clamped at the first column and loaded at the last
    columns: int  # Elements along the beam; they are numbered column by column
    rows: int  # Elements across
    length: float  # Between the centres of the end columns, m
    width: float  # m
    thickness: float  # m
    load: float  # N, towards negative y

    @property
    def second_moment(self) -> float:
        """Second moment of area of the section for bending in the plane, m4."""
        return self.thickness * self.width**3 / 12.0


@dataclass(frozen=True)
class BentBeam:
    """Deflection of a beam in a run, and by theory."""

    case: BeamCase
    youngs_modulus: float  # Pa
    along: Floats  # Centre line at the end of the run: distance from the first column along x, m
    down: Floats  # Its deflection, m
    theory_along: Floats  # The same by theory, m
    theory_down: Floats  # m
    seconds: Floats  # Times of the records, s since the start
    history: Floats  # Deflection at the records, m, where theory has the largest

    @property
    def expected(self) -> float:
        """Largest deflection by theory, m."""
        return float(self.theory_down.max())

    @property
    def found(self) -> float:
        """Deflection there at the end of the run, m."""
        return float(self.history[-1])

    @property
    def error(self) -> float:
        """Relative difference of the two."""
        return self.found / self.expected - 1.0

    @property
    def settled(self) -> float | None:
        """Time (s) from which the deflection stays within 1 % of the last one; None if it still moves."""
        off = np.abs(self.history - self.found) > 0.01 * abs(self.found)
        last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
        return float(self.seconds[last]) if last < len(self.seconds) - 1 else None

    def facts(self) -> dict[str, Any]:
        """Return the figures for a summary."""
        return {
            "held": self.case.held,
            "load_n": self.case.load,
            "length_m": self.case.length,
            "youngs_modulus_pa": self.youngs_modulus,
            "deflection_m": self.found,
            "deflection_theory_m": self.expected,
            "relative_difference": self.error,
            "settled_s": self.settled,
        }

    def lines(self) -> list[str]:
        """Return deflection, theory and their difference in words."""
        case = self.case
        how, where, theory = {
            "supported": ("on two supports, loaded in the middle", "middle", "beam of small slopes"),
            "clamped": ("clamped at one end, loaded at the other", "end", "elastica"),
        }[case.held]
        time = self.settled
        settled = "still moving at the end of the run"
        if time is not None:
            settled = f"at rest from {f'{time:.3g} s' if time <= 180.0 else f'{time / 3600.0:.2g} h'} on"
        return [
            f"  beam {how} with {case.load:.3g} N: {_length(case.length)} long, {_length(case.width)} wide, "
            f"{_length(case.thickness)} thick, Young's modulus {self.youngs_modulus:.3g} Pa",
            f"  deflection of its {where}: {_length(self.found)}; theory ({theory}): {_length(self.expected)}, "
            f"difference {100.0 * self.error:+.1f} %; {settled}",
        ]


def bent_beam(run: xr.Dataset, case: BeamCase) -> BentBeam:
    """Compare the beam of a run with theory."""
    scene = Scene(run)
    shape = (len(scene.times), case.columns, case.rows)
    x, y = scene.x.reshape(shape).mean(axis=2), scene.y.reshape(shape).mean(axis=2)
    modulus = scene.parameters.bonds.youngs_modulus
    if case.held == "clamped":
        theory, column = clamped_line(case.length, case.load, modulus * case.second_moment), case.columns - 1
    else:
        at = np.linspace(0.0, case.length, 101)
        theory = at, supported_line(case.length, case.load, modulus * case.second_moment, at)
        column = case.columns // 2
    return BentBeam(
        case, modulus, x[-1] - x[0, 0], y[0] - y[-1], *theory, scene.seconds - scene.seconds[0],
        y[0, column] - y[:, column],
    )  # fmt: skip


def supported_line(length: float, load: float, stiffness: float, x: Floats) -> Floats:
    """Return the deflection (m) of a supported beam of stiffness E J (N m2) at ``x`` (m) from a support, for small slopes."""
    near = np.minimum(x, length - x)
    deflection: Floats = load * near * (3.0 * length**2 - 4.0 * near**2) / (48.0 * stiffness)
    return deflection


def clamped_line(length: float, load: float, stiffness: float, points: int = 101) -> tuple[Floats, Floats]:
    """Return x and deflection (m) along a clamped beam of stiffness E J (N m2) with a dead load at its end."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    curvature = load * length**2 / stiffness  # of unit length, per unit lever: theta' = curvature (x_end - x)

    def line(reach: float) -> Any:
        def along(_: float, state: Any) -> list[float]:
            return [curvature * (reach - state[1]), math.cos(state[0]), math.sin(state[0])]

        return solve_ivp(along, (0.0, 1.0), [0.0, 0.0, 0.0], rtol=1e-10, atol=1e-12, dense_output=True)

    # Shooting: the lever that is assumed at the clamp must be the x of the end.
    reach = brentq(lambda r: line(r).y[1, -1] - r, 1e-6, 1.0, xtol=1e-12)
    state = line(reach).sol(np.linspace(0.0, 1.0, points))
    return length * state[1], length * state[2]


def _length(metres: float) -> str:
    return f"{metres / 1e3:.4g} km" if abs(metres) >= 1e3 else f"{metres:.4g} m"


# ---- two bergs --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Approach:
    """Distance of two bergs over a Cartesian run."""

    seconds: Floats  # Times of the records, s since the start
    apart: Floats  # Smallest distance of the centres of two elements, one of each berg, m
    closing: Floats  # Closing speed of the centroids, m s-1; negative where the bergs separate
    # Distance (m) of centres below which contact acts: the sum of the radii of two elements, or `contact.distance`
    reach: float

    @property
    def touching(self) -> Any:
        """Whether the bergs are in contact, by record."""
        return self.apart < self.reach

    def facts(self) -> dict[str, Any]:
        """Return the figures for a summary."""
        first = int(np.argmax(self.touching)) if self.touching.any() else None
        return {
            "contact_reach_m": self.reach,
            "first_contact_s": None if first is None else float(self.seconds[first]),
            "closing_before_m_s": None if first is None else float(self.closing[max(first - 1, 0)]),
            "smallest_distance_m": float(self.apart.min()),
            "fastest_parting_m_s": float(max(0.0, -self.closing.min())),
            "contact_records": int(self.touching.sum()),
        }

    def lines(self) -> list[str]:
        """Return in words how the bergs collided."""
        facts = self.facts()
        if facts["first_contact_s"] is None:
            return [f"  no contact: the smallest distance between elements is {facts['smallest_distance_m']:.0f} m"]
        return [
            f"  the bergs close at {facts['closing_before_m_s']:.2f} m/s and are in contact from "
            f"{duration_text(facts['first_contact_s'] / 86_400.0)} on (elements nearer than {self.reach:.0f} m)",
            f"  smallest distance between elements {facts['smallest_distance_m']:.0f} m; then the bergs separate at up to "
            f"{facts['fastest_parting_m_s']:.2f} m/s",
        ]


def approach(run: xr.Dataset) -> Approach:
    """Return the distance of the two bergs of a run in metres."""
    scene = Scene(run)
    one, other = scene.berg[0] == 1, scene.berg[0] == 2
    dx = scene.x[:, one][:, :, None] - scene.x[:, other][:, None, :]
    dy = scene.y[:, one][:, :, None] - scene.y[:, other][:, None, :]
    middle = np.hypot(dx.mean(axis=(1, 2)), dy.mean(axis=(1, 2)))
    seconds = scene.seconds - scene.seconds[0]
    radius = math.sqrt(float(scene.area[0]) / (2.0 * math.sqrt(3.0)))  # of the circle inscribed in a hexagon
    reach = max(2.0 * radius, scene.parameters.contact_distance)
    closing: Floats = -np.gradient(middle, seconds) if len(seconds) > 1 else np.zeros(1)
    return Approach(seconds, np.hypot(dx, dy).min(axis=(1, 2)), closing, reach)
