"""Twin of the fields at a crack tip and of the interaction integral: functions of the polar angle, triangle by triangle."""

from __future__ import annotations

import math


def stress(x, y, mode):
    """Stress xx, yy, xy of a crack of K = 1 (Williams 1957)."""
    r, t = math.hypot(x, y), math.atan2(y, x)
    f, c, s = 1.0 / math.sqrt(2.0 * math.pi * r), math.cos(0.5 * t), math.sin(0.5 * t)
    c3, s3 = math.cos(1.5 * t), math.sin(1.5 * t)
    if mode == 1:
        return f * c * (1.0 - s * s3), f * c * (1.0 + s * s3), f * s * c * c3
    return -f * s * (2.0 + c * c3), f * s * c * c3, f * c * (1.0 - s * s3)


def displacement(x, y, mode, youngs, poisson):
    """Displacements of the same crack in plane stress."""
    r, t = math.hypot(x, y), math.atan2(y, x)
    kappa, mu = (3.0 - poisson) / (1.0 + poisson), 0.5 * youngs / (1.0 + poisson)
    v, c, s = math.sqrt(r / (2.0 * math.pi)) / (2.0 * mu), math.cos(0.5 * t), math.sin(0.5 * t)
    if mode == 1:
        return v * c * (kappa - 1.0 + 2.0 * s * s), v * s * (kappa + 1.0 - 2.0 * c * c)
    return v * s * (kappa + 1.0 + 2.0 * c * c), -v * c * (kappa - 1.0 - 2.0 * s * s)


def gradient(x, y, mode, youngs, poisson):
    """Derivatives of the displacements along x, by differences."""
    step = 1e-6 * math.hypot(x, y)
    after, before = (displacement(x + d, y, mode, youngs, poisson) for d in (step, -step))
    return [(a - b) / (2.0 * step) for a, b in zip(after, before)]


def hoop(opening, shearing, t):
    """Hoop stress at an angle, as an intensity."""
    return math.cos(0.5 * t) * (opening * math.cos(0.5 * t) ** 2 - 1.5 * shearing * math.sin(t))


def intensity(triangles, elements, end, direction, radius, youngs, poisson):
    """K_I and K_II by the interaction integral.

    ``triangles``: vertices (m), displacements of these (m) and volume (m3) of each whole triangle; ``elements``: places (m) and
    forces (N); the thickness is 1 m.
    """

    def local(vector):
        ux, uy = direction
        return ux * vector[0] + uy * vector[1], ux * vector[1] - uy * vector[0]

    def weight(x, y):
        return min(1.0, max(0.0, 2.0 - 2.0 * math.hypot(x, y) / radius))

    found = []
    for mode in (1, 2):
        total = 0.0
        for vertices, moved, volume in triangles:
            p = [local((v[0] - end[0], v[1] - end[1])) for v in vertices]
            u = [local(m) for m in moved]
            w = [weight(*q) for q in p]
            if max(w) == 0.0 or min(w) == 1.0:
                continue
            twice = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1])
            bx = [(p[(k + 1) % 3][1] - p[(k + 2) % 3][1]) / twice for k in range(3)]
            by = [(p[(k + 2) % 3][0] - p[(k + 1) % 3][0]) / twice for k in range(3)]
            ux_x, ux_y, uy_x, uy_y = (
                sum(b[k] * u[k][c] for k in range(3)) for c in (0, 1) for b in (bx, by)
            )  # fmt: skip
            w_x, w_y = (sum(b[k] * w[k] for k in range(3)) for b in (bx, by))
            exx, eyy, exy = ux_x, uy_y, 0.5 * (ux_y + uy_x)
            plane = youngs / (1.0 - poisson**2)
            sxx, syy, sxy = plane * (exx + poisson * eyy), plane * (eyy + poisson * exx), plane * (1.0 - poisson) * exy
            for k in range(3):
                x, y = (0.5 * (p[k][c] + p[(k + 1) % 3][c]) for c in (0, 1))
                (txx, tyy, txy), (ax, ay) = stress(x, y, mode), gradient(x, y, mode, youngs, poisson)
                energy = txx * exx + tyy * eyy + 2.0 * txy * exy
                along = sxx * ax + sxy * ay + txx * ux_x + txy * uy_x - energy
                across = sxy * ax + syy * ay + txy * ux_x + tyy * uy_x
                total += volume / 3.0 * (along * w_x + across * w_y)
        for place, force in elements:
            x, y = local((place[0] - end[0], place[1] - end[1]))
            (ax, ay), (fx, fy) = gradient(x, y, mode, youngs, poisson), local(force)
            total -= weight(x, y) * (fx * ax + fy * ay)
        found.append(0.5 * youngs * total)
    return found
