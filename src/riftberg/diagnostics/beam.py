"""A bending beam of a run against the theory of elastic beams.

Theory
------
A beam of length L, bending stiffness E J (N m2) and load P (N):

- on two supports with the load in its middle, for small slopes,
  ``w(x) = P x (3 L^2 - 4 x^2) / (48 E J)`` up to the middle, so ``w(L/2) = P L^3 / (48 E J)``;
- clamped at one end with a dead load at the other, for deflections of any size (elastica),
  ``E J theta'(s) = P (x(L) - x(s))``, ``x' = cos theta``, ``y' = sin theta``, ``theta(0) = 0``; for a small load the end comes
  down by ``P L^3 / (3 E J)``.

Neither knows of stretching and shear, by which a beam of few elements in height differs a little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xarray as xr

from riftberg.runs.scene import Scene
from riftberg.state import Floats

Held = Literal["supported", "clamped"]


@dataclass(frozen=True)
class BeamCase:
    """How a beam is made, held and loaded."""

    # On supports at both ends with the load in the middle, or clamped at the first column with the load at the last
    held: Held
    columns: int  # Elements along and across; elements are numbered column by column
    rows: int  # Elements along and across; elements are numbered column by column
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
    """What a run made of a beam, and what theory says."""

    case: BeamCase
    youngs_modulus: float  # Pa
    along: Floats  # Centre line at the end: distance from the first column along x, and deflection, m
    down: Floats  # Centre line at the end: distance from the first column along x, and deflection, m
    theory_along: Floats  # The same by theory
    theory_down: Floats  # The same by theory
    seconds: Floats  # Times of the records, s since the start
    history: Floats  # Deflection at the place of its largest value by theory, at the records, m
    speed: float  # Largest speed of an element at the end, m s-1

    @property
    def expected(self) -> float:
        """Largest deflection by theory, m."""
        return float(self.theory_down.max())

    @property
    def found(self) -> float:
        """Deflection at that place at the end of the run, m."""
        return float(self.history[-1])

    @property
    def error(self) -> float:
        """Relative difference of the two."""
        return self.found / self.expected - 1.0

    @property
    def settled(self) -> float | None:
        """Time (s) from which the deflection stays within 1 % of the last one; None where it was still moving."""
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


def bent(run: xr.Dataset, case: BeamCase) -> BentBeam:
    """Compare the beam of a run with theory."""
    scene = Scene(run)
    shape = (len(scene.times), case.columns, case.rows)
    x, y = scene.x.reshape(shape).mean(axis=2), scene.y.reshape(shape).mean(axis=2)
    stiffness = scene.parameters.bonds.youngs_modulus * case.second_moment
    theory = clamped_line(case.length, case.load, stiffness) if case.held == "clamped" else _supported(case, stiffness)
    place = case.columns - 1 if case.held == "clamped" else case.columns // 2
    speed = np.hypot(run["u_sync"].isel(time=-1).values, run["v_sync"].isel(time=-1).values)
    return BentBeam(
        case, scene.parameters.bonds.youngs_modulus, x[-1] - x[0, 0], y[0] - y[-1], *theory,
        scene.seconds - scene.seconds[0], y[0, place] - y[:, place], float(np.nanmax(speed)),
    )  # fmt: skip


def _supported(case: BeamCase, stiffness: float) -> tuple[Floats, Floats]:
    x = np.linspace(0.0, case.length, 101)
    return x, supported_line(case.length, case.load, stiffness, x)


def supported_line(length: float, load: float, stiffness: float, x: Floats) -> Floats:
    """Return the deflection (m) of a beam on two supports at distances ``x`` (m) from one of them, for small slopes.

    ``length``, ``load``, ``stiffness``: l (m), P (N) and E J (N m2).
    """
    near = np.minimum(x, length - x)
    deflection: Floats = load * near * (3.0 * length**2 - 4.0 * near**2) / (48.0 * stiffness)
    return deflection


def clamped_line(length: float, load: float, stiffness: float, points: int = 101) -> tuple[Floats, Floats]:
    """Return x and deflection (m) along a clamped beam with a dead load at its end, however far it bends.

    The moment at the clamp is found by shooting: it must be the load times the x of the end.

    ``length``, ``load``, ``stiffness``: l (m), P (N) and E J (N m2).
    """
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    # In lengths of the beam: curvature = bend * (x_end - x).
    bend = load * length**2 / stiffness

    def line(reach: float) -> Any:
        def along(_: float, state: Any) -> list[float]:
            return [bend * (reach - state[1]), math.cos(state[0]), math.sin(state[0])]

        return solve_ivp(along, (0.0, 1.0), [0.0, 0.0, 0.0], rtol=1e-10, atol=1e-12, dense_output=True)

    reach = brentq(lambda r: line(r).y[1, -1] - r, 1e-6, 1.0, xtol=1e-12)
    state = line(reach).sol(np.linspace(0.0, 1.0, points))
    return length * state[1], length * state[2]


def words(beam: BentBeam) -> list[str]:
    """Return in plain words how far the beam bends, and how far it should."""
    case = beam.case
    how = (
        "on two supports, loaded in the middle"
        if case.held == "supported"
        else "clamped at one end, loaded at the other"
    )
    where = "middle" if case.held == "supported" else "end"
    theory = "beam of small slopes" if case.held == "supported" else "elastica"
    settled = "still moving at the end of the run" if beam.settled is None else f"at rest from {_time(beam.settled)} on"
    return [
        f"  beam {how} with {case.load:.3g} N: {_length(case.length)} long, {_length(case.width)} wide, "
        f"{_length(case.thickness)} thick, Young's modulus {beam.youngs_modulus:.3g} Pa",
        f"  deflection of its {where}: {_length(beam.found)}; theory ({theory}): {_length(beam.expected)}, "
        f"difference {100.0 * beam.error:+.1f} %; {settled}",
    ]


def _length(metres: float) -> str:
    return f"{metres / 1e3:.4g} km" if abs(metres) >= 1e3 else f"{metres:.4g} m"


def _time(seconds: float) -> str:
    return f"{seconds:.3g} s" if seconds <= 180.0 else f"{seconds / 3600.0:.2g} h"
