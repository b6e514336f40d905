"""Twins of the melt laws of files 1: slow, plain, in the order of its text."""

from __future__ import annotations

import numpy as np

DAY = 86400.0


def rates(q_o, q_a, theta, ice, length):
    """Sides, base, waves (m/s) of section 1.2."""
    state = 1.5 * np.sqrt(q_a) + 0.1 * q_a
    sides = max(7.62e-3 * theta + 1.29e-3 * theta**2, 0.0) / DAY
    base = max(0.58 * q_o**0.8 * (theta + 4.0) / length**0.2, 0.0) / DAY
    waves = max((theta + 2.0) * state * (1.0 + np.cos(np.pi * ice**3)) / 12.0, 0.0) / DAY
    return np.array([sides, base, waves])


def block(mass, shape, base, sides, waves, dt, split):
    """What is left and what was lost (base, sides, waves) of section 1.6; ``shape`` is thickness, width, length."""
    t, w, length = shape
    volume = t * w * length

    def cut(x, *by):
        return max(x - sum(by) * dt, 0.0)

    if split:
        m1 = mass * cut(t, base) * w * length / volume
        w1, l1 = cut(w, sides), cut(length, sides)
        m2 = mass * cut(t, base) * w1 * l1 / volume
        w2, l2 = cut(w1, waves), cut(l1, waves)
        m3 = mass * cut(t, base) * w2 * l2 / volume
        return np.array([m3, cut(t, base), w2, l2, mass - m1, m1 - m2, m2 - m3])
    w2, l2 = cut(w, sides, waves), cut(length, sides, waves)
    left = mass * cut(t, base) * w2 * l2 / volume
    lost = mass / volume * np.array([w * length * base, t * (w + length) * sides, t * (w + length) * waves]) * dt
    return np.array([left, cut(t, base), w2, l2, *lost])


def bits(mass, born, shortest, q_o, theta, rho, dt, gone):
    """Bits left and melted of section 1.9."""
    size = min(shortest, 40.0)
    rate = max(0.58 * q_o**0.8 * (theta + 2.0) / size**0.2, 0.0) / DAY
    melt = min(rho * (mass / rho / size) * rate * dt, mass + born)
    left = mass + born - melt
    return np.array([0.0, melt + left]) if gone else np.array([left, melt])


# ------------------------------------------------------------------------------------------ base, section 1.5

NU, KT, KS = 1.95e-6, 1.41e-7, 8.02e-10
HEAT = 1025.0 * 3974.0 / 3.335e5


def freezing(salinity, pressure):
    return 0.0832 - 0.0573 * salinity - 7.53e-8 * pressure


class Layer:
    """The boundary layer at a base: friction velocity, depth and exchange coefficients."""

    def __init__(self, speed, f, least, drag, tide, scaled=True):
        self.scaled = scaled  # the laminar term is divided by 0.4 too, as in the reference
        self.u = max(least, np.sqrt(drag * (speed**2 + tide**2)))
        self.h = 10.0 if f == 0.0 or abs(f) * 10.0 <= 0.4 * self.u else 0.4 * self.u / abs(f)
        self.molecular = [12.5 * (NU / k) ** (2.0 / 3.0) - 6.0 for k in (KT, KS)]
        self.r = 0.052 * self.h * self.u / (5.0 * NU)

    def gammas(self, flux=0.0):
        n = np.sqrt(1.0 + 0.052 / 0.2 * self.h * 0.4 / self.u**3 * max(flux, 0.0))
        log = np.log(self.r) - 2.0 * np.log(n) if self.r > n**2 and self.r > 1.0 else 0.0
        turbulent = (log - 1.0) / 0.4 + 0.5 * n / 0.052 / (0.4 if self.scaled else 1.0)
        return [1.0 / (m + turbulent) for m in self.molecular]


def buoyancy(heat, salt, gammas, theta, salinity):
    rho = 999.910681 - 0.038357 * theta + 0.805876 * salinity
    return 9.8 / rho * (0.805876 * salt * gammas[1] - 0.038357 * heat * gammas[0])


def two_equation(layer, salinity, theta, thickness, rho):
    """Melt in m/s of section 1.5, two equations."""
    p = 101325.0 + 9.8 * thickness * rho
    return HEAT * layer.u * layer.gammas()[0] * (theta - freezing(salinity, p)) / rho


def reference_three_equation(layer, salinity, theta, thickness, rho, const=None):
    """Melt in m/s of section 1.5, three equations, as the reference searches."""
    p = 101325.0 + 9.8 * thickness * rho
    at_ice, melt, bounds = salinity, 0.0, [np.nan, np.nan]
    for _ in range(20):
        heat, salt = (theta - freezing(at_ice, p)) * layer.u, (salinity - at_ice) * layer.u
        gammas = [const, const / 35.0] if const else layer.gammas()
        if not const:
            gammas = layer.gammas(buoyancy(heat, salt, gammas, theta, salinity))
        melt = HEAT * heat * gammas[0]
        e = layer.u * gammas[1] * 1025.0
        new = salinity * e / (e + melt)
        if abs(new - at_ice) < 1e-4 * 0.5 * (salinity + at_ice + 1e-10):
            break
        side = 1 if new < at_ice else 0
        if (at_ice > bounds[1]) if side else (at_ice < bounds[0]):
            return two_equation(layer, salinity, theta, thickness, rho)
        bounds[side] = at_ice
        at_ice = new
    return melt / rho


def exact_three_equation(layer, salinity, theta, thickness, rho, const=None):
    """Melt in m/s with salinity at the ice and flux of buoyancy both in balance: two searches, one inside the other."""
    p = 101325.0 + 9.8 * thickness * rho

    def at_salinity(at_ice, gammas):
        heat, salt = (theta - freezing(at_ice, p)) * layer.u, (salinity - at_ice) * layer.u
        melt = HEAT * heat * gammas[0]
        return (
            melt,
            heat,
            salt,
            at_ice * (layer.u * gammas[1] * 1025.0 + melt) - salinity * layer.u * gammas[1] * 1025.0,
        )

    def balanced(gammas):
        low, high = 0.0, 3.0 * salinity + 1.0
        for _ in range(200):
            middle = 0.5 * (low + high)
            if at_salinity(middle, gammas)[3] > 0.0:
                high = middle
            else:
                low = middle
        melt, heat, salt, _ = at_salinity(low, gammas)
        return melt, buoyancy(heat, salt, gammas, theta, salinity)

    if const:
        return balanced([const, const / 35.0])[0] / rho
    melt, flux = balanced(layer.gammas())
    if flux > 0.0:
        low, high = 0.0, flux
        for _ in range(200):
            middle = 0.5 * (low + high)
            melt, flux = balanced(layer.gammas(middle))
            low, high = (middle, high) if flux > middle else (low, middle)
    return melt / rho
