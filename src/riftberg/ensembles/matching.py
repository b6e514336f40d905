"""Inputs that agree with observations: history matching wave by wave, the likeliest inputs, and their distribution.

All inputs are parts of the probability of their distributions, 0 to 1, so that the prior is uniform. A wave runs members at
inputs that no wave before has ruled out, and emulates each result. Inputs are ruled out where the emulated result is so far from
the observed one, in standard deviations of emulator, observation and model together, as a true value would be in 0.27 % of cases.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.ensembles.probability import effective
from riftberg.errors import RunError
from riftberg.state import Floats, Ints

Flags = NDArray[np.bool_]

SHORTEST, LONGEST = 0.1, 30.0
"""Lengths of correlation, in widths of the range of an input: shorter ones see no neighbour, longer ones are a line."""

NUGGET: Final = (1e-6, 1e2)
"""Scatter of single members, in parts of the variance of the process."""

BATCH: Final = 4096
"""Points that are predicted at once, for the memory."""

RULED_OUT: Final = 0.0027
"""Probability that the truth is ruled out by one wave: that beyond three standard deviations."""

CANDIDATES: Final = 4096
"""Points that are looked at together where inputs are drawn that are not ruled out."""

MOST_CANDIDATES: Final = 2**16
"""Points that are looked at in all."""

FEW: Final = 20
"""Points of `CANDIDATES` below which the search goes on in a smaller box."""

SEARCHES: Final = 15
"""Boxes after which nothing is said to be left."""

KEPT: Final = 0.25
"""Part of the probability of members with errors that the rejection keeps."""

TELLS: Final = 0.02
"""Part of the variance of the inputs that a combination of results must explain, to be a summary of them."""

FEW_MEMBERS: Final = 10.0
"""Members that count, below which their spread counts less than that of a linear regression."""

REPLICATES: Final = 6000
"""Members with errors added, in all."""


class Emulator:
    """One result of a model as a function of its inputs: ``x`` (members, inputs), 0 to 1; ``y`` (members,), all finite.

    A straight line in all inputs, and a process with the covariance ``s2 exp(-sum (x - x')2 / 2 l2)`` about it. The scatter of
    members about it (their lattices, their random fields) is a variance of its own, a nugget. Lengths and nugget maximise the
    likelihood; the variance counts the uncertainty of the line, not of lengths and nugget (Rasmussen and Williams 2006,
    equations 2.41, 2.42 and 5.9).
    """

    def __init__(self, x: Floats, y: Floats) -> None:
        from scipy.linalg import cho_factor, cho_solve
        from scipy.optimize import minimize

        self._x = np.asarray(x, float)
        self._mean, self._unit = float(np.mean(y)), float(np.std(y))
        if self._unit <= 1e-12 * max(abs(self._mean), 1.0):  # the same for all members: nothing to learn
            self._unit = 0.0
            return
        y = (np.asarray(y, float) - self._mean) / self._unit
        squares = (self._x[:, None] - self._x[None]) ** 2
        line = _line(self._x)
        count, spare = len(y), max(len(y) - line.shape[1], 1)

        def likelihood(logs: Floats) -> tuple[float, Floats]:
            """Return minus the logarithm of the likelihood, and its gradient."""
            length, nugget = np.exp(logs[:-1]), np.exp(logs[-1])
            correlation = np.exp(-0.5 * (squares / length**2).sum(axis=-1))
            inverse = cho_solve(factor := cho_factor(correlation + nugget * np.eye(count), lower=True), np.eye(count))
            rest = y - line @ np.linalg.lstsq(line.T @ inverse @ line, line.T @ inverse @ y, rcond=None)[0]
            pull = inverse @ rest
            variance = max(float(rest @ pull) / spare, 1e-12)
            # Lengths in a row beyond the data would say the same: a weak pull towards the range keeps them apart.
            value = 0.5 * spare * np.log(variance) + np.log(np.diag(factor[0])).sum() + 0.05 * (logs[:-1] ** 2).sum()
            turn = inverse - np.outer(pull, pull) / variance
            by_length = 0.5 * np.einsum("ij,ij,ijk->k", turn, correlation, squares) / length**2 + 0.1 * logs[:-1]
            return value, np.append(by_length, 0.5 * nugget * np.trace(turn))

        limits = [np.log([SHORTEST, LONGEST])] * x.shape[1] + [np.log(NUGGET)]
        # The likelihood has several hollows: a smooth function without scatter, and a smoother one with it.
        starts = [
            np.append(np.full(x.shape[1], np.log(length)), np.log(nugget))
            for length, nugget in ((0.5, 1e-3), (2.0, 0.1))
        ]
        best = min((minimize(likelihood, start, jac=True, method="L-BFGS-B", bounds=limits) for start in starts),
                   key=lambda result: result.fun)  # fmt: skip
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
            rows = slice(first, first + BATCH)
            correlation, line = self._near(x[rows]), _line(x[rows])
            beside = line - correlation @ self._solved
            mean[rows] = line @ self._line + correlation @ self._pull
            explained = np.einsum("ij,ji->i", correlation, cho_solve(self._factor, correlation.T))
            variance[rows] = 1.0 + self.nugget - explained + np.einsum("ij,jk,ik->i", beside, self._inner, beside)
        return self._mean + self._unit * mean, self._unit**2 * self._variance * np.maximum(variance, 0.0)


def _line(x: Floats) -> Floats:
    return np.column_stack([np.ones(len(x)), x])


@dataclass(frozen=True)
class Targets:
    """Observations as numbers: a result of the model is to equal its number, or to lie on one side of it."""

    names: Sequence[str]
    values: Floats  # (targets,)
    covariance: Floats  # (targets, targets) of the errors of observation and model
    sides: Floats  # (targets,): 0 equal to the value, 1 above it, -1 below it

    @property
    def cutoff(self) -> float:
        """Standard deviations beyond which the largest misfit rules out: 3 for one result, more for many."""
        from scipy.stats import norm

        return float(norm.isf(0.5 * RULED_OUT / len(self.values)))

    def misfit(self, mean: Floats, variance: Floats | float = 0.0) -> Floats:
        """Return how far results (points, targets) are from the observations, in standard deviations."""
        deviation = (mean - self.values) / np.sqrt(np.diag(self.covariance) + variance)
        return np.where(self.sides == 0.0, np.abs(deviation), np.maximum(-self.sides * deviation, 0.0))


@dataclass(frozen=True)
class Region:
    """Inputs that no wave has ruled out."""

    targets: Targets
    waves: tuple[tuple[Emulator, ...], ...] = ()
    box: Floats | None = None  # (2, inputs): within it all of them were found
    volume: float = 1.0  # Part of the prior that is left

    def emulated(self, u: Floats, wave: int = -1) -> tuple[Floats, Floats]:
        """Return means and variances of the results at points (points, targets)."""
        pairs = [emulator.predict(u) for emulator in self.waves[wave]]
        return np.stack([mean for mean, _ in pairs], axis=1), np.stack([variance for _, variance in pairs], axis=1)

    def inside(self, u: Floats) -> Flags:
        """Return which points are not ruled out."""
        left = np.ones(len(u), bool)
        for wave in range(len(self.waves) - 1, -1, -1):  # the last one rules out most
            if left.any():
                worst = self.targets.misfit(*self.emulated(u[left], wave)).max(axis=1)
                left[left] = worst < self.targets.cutoff
        return left

    def draw(self, count: int, inputs: int, seed: int) -> tuple[Floats, Region]:
        """Return points that are not ruled out, and the region with its volume."""
        from scipy.stats import qmc

        numbers = qmc.Sobol(inputs, scramble=True, rng=np.random.default_rng(seed))
        if not self.waves:
            return np.asarray(numbers.random_base2(int(np.ceil(np.log2(max(count, 1)))))[:count]), self
        box = np.stack([np.zeros(inputs), np.ones(inputs)]) if self.box is None else self.box
        for _ in range(SEARCHES):
            u = box[0] + (box[1] - box[0]) * np.asarray(numbers.random(CANDIDATES))
            good = self.inside(u)
            points, looked = u[good], CANDIDATES
            if len(points) >= min(count, FEW):
                break
            # Nearly all of the box is ruled out: go on in a smaller one around the points that are nearest to what is left.
            box = _around(points if len(points) >= FEW else u[np.argsort(self._worst(u))[: CANDIDATES // 20]])
        if not len(points):
            raise RunError(self._nothing_left(u))
        while len(points) < count and looked < MOST_CANDIDATES:
            u = box[0] + (box[1] - box[0]) * np.asarray(numbers.random(CANDIDATES))
            points, looked = np.concatenate([points, u[self.inside(u)]]), looked + CANDIDATES
        return points[:count], replace(self, box=box, volume=float(np.prod(box[1] - box[0])) * len(points) / looked)

    def _worst(self, u: Floats) -> Floats:
        """Return the largest misfit of points over all waves and targets, standard deviations."""
        each = [self.targets.misfit(*self.emulated(u, wave)).max(axis=1) for wave in range(len(self.waves))]
        return np.asarray(np.max(each, axis=0))

    def _nothing_left(self, u: Floats) -> str:
        best = u[[np.argmin(self._worst(u))]]
        misfit = np.max([self.targets.misfit(*self.emulated(best, wave))[0] for wave in range(len(self.waves))], axis=0)
        far = ", ".join(
            f"{self.targets.names[k]} ({misfit[k]:.1f} standard deviations)" for k in np.argsort(-misfit)[:3]
        )
        return (
            "no inputs within their distributions agree with what was observed. The best ones are farthest away in "
            f"{far}; {self.targets.cutoff:.1f} are allowed. Widen the distributions, or allow the model a larger error"
        )


def _around(u: Floats) -> Floats:
    """Return the box (2, inputs) around points, with a margin of a fifth."""
    wide = 0.2 * np.ptp(u, axis=0)
    return np.stack([np.maximum(u.min(axis=0) - wide, 0.0), np.minimum(u.max(axis=0) + wide, 1.0)])


class Wave(NamedTuple):
    """A wave, when it is done."""

    members: int
    left: float  # Part of the prior that is not ruled out after it


@dataclass
class Matched:
    """All members of the waves, and the region that they leave."""

    region: Region
    inputs: Floats  # (members, inputs), 0 to 1
    results: Floats  # (members, targets); NaN where a member failed
    wave: Floats  # (members,) from 0
    waves: list[Wave] = field(default_factory=list)
    weight: Floats = field(
        default_factory=lambda: np.empty(0)
    )  # (members,) prior over the density that they were drawn from


def match(
    run: Callable[[int, Floats], Floats], inputs: int, targets: Targets, *, waves: int, members: int, seed: int = 1
) -> Matched:
    """Rule out inputs wave by wave.

    ``run``: takes the number of a wave and inputs (members, inputs), and returns the results (members, targets).
    """
    region = Region(targets)
    matched = Matched(region, np.empty((0, inputs)), np.empty((0, len(targets.values))), np.empty(0, int))
    regions = []
    for number in range(waves):
        u, region = region.draw(members, inputs, seed + 1000 * number)
        regions.append(region)
        matched.inputs = np.concatenate([matched.inputs, u])
        matched.results = np.concatenate([matched.results, run(number, u)])
        matched.wave = np.append(matched.wave, np.full(len(u), number))
        # Emulators need to be right where something is left; members of earlier waves that lie there help.
        good = np.isfinite(matched.results).all(axis=1) & region.inside(matched.inputs)
        if good.sum() < inputs + 4:
            raise RunError(
                f"{int(good.sum())} members of {len(u)} came to their end with all results; {inputs + 4} are needed"
            )
        emulators = tuple(Emulator(matched.inputs[good], column) for column in matched.results[good].T)
        region = Region(targets, (*region.waves, emulators), region.box)
        _, region = region.draw(200, inputs, seed + 1000 * number + 1)
        matched.waves.append(Wave(len(u), region.volume))
    matched.region = region
    # Prior density 1 over that of the mixture of all waves (deterministic mixture: Owen and Zhou 2000).
    density = sum(wave.members / len(matched.inputs) * earlier.inside(matched.inputs) / earlier.volume
                  for wave, earlier in zip(matched.waves, regions, strict=True))  # fmt: skip
    matched.weight = 1.0 / np.asarray(density)
    return matched


def likeliest(region: Region, inputs: int, *, seed: int = 1) -> Floats:
    """Return the inputs of the largest likelihood on the emulators of the last wave (scipy's differential evolution)."""
    from scipy.optimize import differential_evolution

    def misfit(u: Floats) -> Floats:
        return -_log_likelihood(region.targets, *region.emulated(np.atleast_2d(u.T)))

    low, high = (np.zeros(inputs), np.ones(inputs)) if region.box is None else region.box
    result = differential_evolution(
        misfit, list(zip(low, high, strict=True)), rng=np.random.default_rng(seed), vectorized=True, updating="deferred",
        maxiter=100, polish=False,
    )  # fmt: skip
    return np.asarray(result.x)


def _log_likelihood(targets: Targets, mean: Floats, variance: Floats) -> Floats:
    """Return the logarithm of the likelihood of results (points, targets) that are emulated with a variance."""
    from scipy.stats import norm

    exact = targets.sides == 0.0
    deviation = mean - targets.values
    spread = np.sqrt(np.diag(targets.covariance) + variance)
    total = np.asarray(norm.logcdf(targets.sides * deviation / spread)[:, ~exact].sum(axis=1))
    if exact.any():
        covariance = targets.covariance[np.ix_(exact, exact)] + variance[:, exact, None] * np.eye(int(exact.sum()))
        factor = np.linalg.cholesky(covariance)
        white = np.linalg.solve(factor, deviation[:, exact, None])[..., 0]
        total -= 0.5 * (white**2).sum(axis=1) + np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    return total


class Posterior(NamedTuple):
    """Distribution of the inputs given the observations."""

    samples: Floats  # (samples, inputs), 0 to 1
    weight: Floats  # (samples,), sum 1
    members: Floats  # (members,) weight of each member, sum 1
    effective: float  # Number of members that count


def posterior(matched: Matched, *, seed: int = 1) -> Posterior:
    """Return the distribution of the inputs from the members of the waves.

    Members that are not ruled out get errors of observation and model added. The results are
    summarised in as many numbers as there are inputs, the linear expectation of each input (Fearnhead and Prangle 2012). Members
    whose numbers are near the observed ones are kept (rejection, Epanechnikov kernel), and their inputs are corrected
    for the remaining difference by local regression (Beaumont and others 2002). Inputs are normal scores there, which
    keeps them within their distributions.
    """
    from scipy.stats import norm

    targets, random = matched.region.targets, np.random.default_rng(seed)
    rows = np.flatnonzero(np.isfinite(matched.results).all(axis=1) & matched.region.inside(matched.inputs))
    if not rows.size:  # the emulator leaves something between the members, but none of them
        rows = np.flatnonzero(np.isfinite(matched.results).all(axis=1))
    u, f, weight = matched.inputs[rows], matched.results[rows], matched.weight[rows]
    exact = targets.sides == 0.0
    beyond = targets.sides * (f - targets.values) / np.sqrt(np.diag(targets.covariance))
    weight = weight * np.exp(norm.logcdf(beyond[:, ~exact]).sum(axis=1))
    weight = weight / weight.sum()
    z = norm.ppf(np.clip(u, 1e-6, 1.0 - 1e-6))
    parent = np.repeat(np.arange(len(rows)), max(1, REPLICATES // len(rows)))
    middle = weight @ z
    kernel, corrected, spread = np.ones(len(parent)), z[parent], (weight[:, None] * (z - middle)).T @ (z - middle)
    if exact.any():
        factor = np.linalg.cholesky(targets.covariance[np.ix_(exact, exact)])
        white = np.linalg.solve(factor, (f - targets.values)[:, exact].T).T
        kernel, corrected, spread = _regress_inputs(z, white, weight, parent, random)
    total = weight[parent] * kernel
    total /= total.sum()
    by_member = np.zeros(len(matched.inputs))
    np.add.at(by_member, rows[parent], total)
    used = total > 0.0
    corrected, total, number = corrected[used], total[used], effective(by_member)
    # Few members lie close together by chance. Their place is kept and their spread drawn towards that of all members that are
    # left, by linear regression; exact where all is linear and normal, however few they are.
    shrinkage, middle = FEW_MEMBERS / (FEW_MEMBERS + number), total @ corrected
    values, vectors = np.linalg.eigh(spread)
    noise = random.standard_normal(corrected.shape) @ np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))).T
    corrected = middle + np.sqrt(1.0 - shrinkage) * (corrected - middle) + np.sqrt(shrinkage) * noise
    return Posterior(norm.cdf(corrected), total, by_member, number)


def _regress_inputs(
    z: Floats, white: Floats, weight: Floats, parent: Ints, random: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Return kernel weights and corrected inputs of members with errors added, and the covariance by linear regression alone.

    ``z``: (members, inputs); ``white``: results minus observations, in units in which their errors are independent and 1.
    """
    middle, centre = weight @ z, weight @ white
    dz, dw = z - middle, white - centre
    spread = (weight[:, None] * dz).T @ dz
    cross = (weight[:, None] * dz).T @ dw
    errors = (weight[:, None] * dw).T @ dw + np.eye(white.shape[1])
    gain = np.linalg.solve(errors, cross.T).T
    left = spread - gain @ cross.T
    # In units in which the inputs are independent with variance 1, the variance that the results explain is 0 to 1.
    values, vectors = np.linalg.eigh(spread)
    root = vectors / np.sqrt(np.maximum(values, 1e-12))
    share, turn = np.linalg.eigh(root.T @ gain @ cross.T @ root)
    informative = share > TELLS
    if not informative.any():
        return np.ones(len(parent)), z[parent], left
    project = (root @ turn[:, informative]).T @ gain / np.sqrt(share[informative])[:, None]
    noisy = white[parent] + random.standard_normal((len(parent), white.shape[1]))
    deviation = noisy @ project.T  # from the observations, which are 0 there
    distance = np.linalg.norm(deviation, axis=1)
    order = np.argsort(distance)
    until = int(np.searchsorted(np.cumsum(weight[parent][order]) / weight[parent].sum(), KEPT))
    width = distance[order[min(until, len(order) - 1)]]
    kernel = np.maximum(1.0 - (distance / width) ** 2, 0.0)
    root_weight = np.sqrt(weight[parent] * kernel)[:, None]
    sides = np.column_stack([np.ones(len(parent)), deviation])
    slope = np.linalg.lstsq(sides * root_weight, z[parent] * root_weight, rcond=None)[0]
    return kernel, z[parent] - deviation @ slope[1:], left
