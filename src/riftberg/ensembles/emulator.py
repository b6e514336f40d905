"""What a model would give where it was not run: a Gaussian process through the members, with its variance.

A straight line in all inputs, and a process with the covariance ``s2 exp(-sum (x - x')2 / 2 l2)`` about it. What members scatter
beside it (their lattices, their random fields) is a variance of its own, a nugget. Lengths and nugget are those of the largest
likelihood; the variance counts the doubt in the line, not that in lengths and nugget (Rasmussen and Williams
2006, equations 2.41, 2.42 and 5.9).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from riftberg.state import Floats

SHORTEST, LONGEST = 0.1, 30.0
"""Lengths of correlation, in widths of the range of an input: shorter ones see no neighbour, longer ones are a line."""

NUGGET: Final = (1e-6, 1e2)
"""Scatter of single members, in parts of the variance of the process."""

BATCH: Final = 4096
"""Points that are predicted at once, for the memory."""


class Emulator:
    """One result of a model as a function of its inputs: ``x`` (members, inputs), 0 to 1; ``y`` (members,), all finite."""

    def __init__(self, x: Floats, y: Floats) -> None:
        from scipy.linalg import cho_factor, cho_solve
        from scipy.optimize import minimize

        self._x = np.asarray(x, float)
        self._mean, self._unit = float(np.mean(y)), float(np.std(y))
        if self._unit <= 1e-12 * max(abs(self._mean), 1.0):  # the same for all members: nothing to learn
            self._unit = 0.0
            return
        y = (np.asarray(y, float) - self._mean) / self._unit
        apart = (self._x[:, None] - self._x[None]) ** 2
        line = _line(self._x)
        count, spare = len(y), max(len(y) - line.shape[1], 1)

        def likelihood(logs: Floats) -> tuple[float, Floats]:
            """Return minus the logarithm of the likelihood, and its gradient."""
            length, nugget = np.exp(logs[:-1]), np.exp(logs[-1])
            near = np.exp(-0.5 * (apart / length**2).sum(axis=-1))
            inverse = cho_solve(whole := cho_factor(near + nugget * np.eye(count), lower=True), np.eye(count))
            rest = y - line @ np.linalg.lstsq(line.T @ inverse @ line, line.T @ inverse @ y, rcond=None)[0]
            pull = inverse @ rest
            variance = max(float(rest @ pull) / spare, 1e-12)
            # Lengths in a row beyond the data would say the same: a weak pull towards the range keeps them apart.
            value = 0.5 * spare * np.log(variance) + np.log(np.diag(whole[0])).sum() + 0.05 * (logs[:-1] ** 2).sum()
            turn = inverse - np.outer(pull, pull) / variance
            by_length = 0.5 * np.einsum("ij,ij,ijk->k", turn, near, apart) / length**2 + 0.1 * logs[:-1]
            return value, np.append(by_length, 0.5 * nugget * np.trace(turn))

        limits = [np.log([SHORTEST, LONGEST])] * x.shape[1] + [np.log(NUGGET)]
        # The likelihood has several hollows: a smooth function without scatter, and a smoother one with it.
        starts = [
            np.append(np.full(x.shape[1], np.log(length)), np.log(nugget))
            for length, nugget in ((0.5, 1e-3), (2.0, 0.1))
        ]
        best = min((minimize(likelihood, start, jac=True, method="L-BFGS-B", bounds=limits) for start in starts),
                   key=lambda found: found.fun)  # fmt: skip
        self.length, self.nugget = np.exp(best.x[:-1]), float(np.exp(best.x[-1]))
        self._factor = cho_factor(self._near(self._x) + self.nugget * np.eye(count), lower=True)
        solved = cho_solve(self._factor, line)
        self._inner = np.linalg.pinv(line.T @ solved)
        self._line = self._inner @ solved.T @ y
        self._pull = cho_solve(self._factor, y - line @ self._line)
        self._solved = solved
        self._variance = max(float((y - line @ self._line) @ self._pull) / spare, 1e-12)

    def _near(self, x: Floats) -> Floats:
        """Return the correlation of points with the members."""
        a, b = x / self.length, self._x / self.length
        square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
        return np.asarray(np.exp(-0.5 * np.maximum(square, 0.0)))

    def predict(self, x: Floats) -> tuple[Floats, Floats]:
        """Return mean and variance of one more member at points (points, inputs)."""
        from scipy.linalg import cho_solve

        if self._unit == 0.0:
            return np.full(len(x), self._mean), np.zeros(len(x))
        mean, variance = np.empty(len(x)), np.empty(len(x))
        for first in range(0, len(x), BATCH):
            part = slice(first, first + BATCH)
            near, line = self._near(x[part]), _line(x[part])
            beside = line - near @ self._solved
            mean[part] = line @ self._line + near @ self._pull
            known = np.einsum("ij,ji->i", near, cho_solve(self._factor, near.T))
            variance[part] = 1.0 + self.nugget - known + np.einsum("ij,jk,ik->i", beside, self._inner, beside)
        return self._mean + self._unit * mean, self._unit**2 * self._variance * np.maximum(variance, 0.0)


def _line(x: Floats) -> Floats:
    return np.column_stack([np.ones(len(x)), x])
