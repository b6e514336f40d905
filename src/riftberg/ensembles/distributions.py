"""Numbers that are not known exactly: distributions as text, plans that draw from them, and seeds.

``lognormal(median, standard deviation of the logarithm)``, ``normal(mean, standard deviation)``, ``uniform(lowest, highest)``,
``triangular(lowest, likeliest, highest)``, ``choice(value, value, ...)``, ``each(value, value, ...)``, whose values the members
take in turn. A percentage is a share of 1 in the spread of a lognormal, and a share of the mean in the spread of a normal one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from riftberg.config.units import count_text, looks_like_quantity, quantity_text
from riftberg.errors import InputError, nearest
from riftberg.state import Floats
from riftberg.system.input_files import value_shown

PLANS: Final = ("sobol", "random", "latin-hypercube", "morris", "saltelli")
"""Ways to draw: Sobol' numbers (scrambled), independent ones, a Latin hypercube; two for `riftberg sensitivity`."""

POINTS: Final = {"morris": 1, "saltelli": 2}
"""Plans for sensitivity: members of a draw beside one for each input."""
STEP: Final = 0.4
"""Part of its distribution by which an input moves in the plan ``morris``."""

ARGUMENTS: Final = {
    "lognormal": ("median", "standard deviation of the logarithm"),
    "normal": ("mean", "standard deviation"),
    "uniform": ("lowest", "highest"),
    "triangular": ("lowest", "likeliest", "highest"),
}
"""What the numbers of each distribution are."""

OF_VALUES: Final = ("choice", "each")
"""Distributions of any values: drawn, or taken in turn."""

EXAMPLE: Final = "For example --vary 'fracture.normal_strength~lognormal(18 kPa, 20 %)'"

_WIDEST: Final = 2.0
"""Standard deviation of a logarithm above which a part of a hundred was meant: 20 for 20 %."""

_CALL: Final = re.compile(r"\s*([\w' -]+?)\s*\((.*)\)\s*$", re.DOTALL)


_UNIT: Final = re.compile(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?\s*(.*)$")


@dataclass(frozen=True)
class Limits:
    """Values that are physically possible."""

    low: float = -np.inf
    high: float = np.inf

    @classmethod
    def of(cls, metadata: Sequence[Any]) -> Limits:
        """Return the limits of a pydantic field."""
        bounds = [(name, float(getattr(item, name))) for item in metadata for name in ("gt", "ge", "lt", "le")
                 if getattr(item, name, None) is not None]  # fmt: skip
        low = max((value for name, value in bounds if name in ("gt", "ge")), default=-np.inf)
        high = min((value for name, value in bounds if name in ("lt", "le")), default=np.inf)
        return cls(low, high)


@dataclass(frozen=True)
class Distribution:
    """A distribution of one number, cut off at its physical limits; or a choice of values."""

    name: str
    numbers: tuple[float, ...]  # As `ARGUMENTS` lists them, in the unit of the parameter
    choices: tuple[Any, ...] = ()
    limits: Limits = Limits()
    text: str = ""  # As it was given

    def frozen(self) -> Any:
        """Return it as scipy has it, without limits."""
        from scipy import stats

        a = self.numbers
        if self.name == "lognormal":
            return stats.lognorm(s=a[1], scale=a[0])
        if self.name == "normal":
            return stats.norm(a[0], a[1])
        if self.name == "uniform":
            return stats.uniform(a[0], a[1] - a[0])
        return stats.triang((a[1] - a[0]) / (a[2] - a[0]), loc=a[0], scale=a[2] - a[0])

    def in_turn(self, draws: int, seed: int) -> list[Any]:
        """Return the values of ``each`` for draws: each once, then each once again, in an order of its own every time.

        Not by the number of the draw alone: every second Sobol' number lies in the same half of each input. Distributions of
        as many values keep step, so that they may be the columns of a table.
        """
        count = len(self.choices)
        order = [
            int(index) for turn in range(-(-draws // count))
            for index in np.random.default_rng([seed, count, turn]).permutation(count)
        ]  # fmt: skip
        return [self.choices[index] for index in order[:draws]]

    @property
    def cut_off(self) -> float:
        """Probability that lies beyond the limits."""
        if self.choices:
            return 0.0
        distribution = self.frozen()
        return float(distribution.cdf(self.limits.low) + distribution.sf(self.limits.high))

    def quantiles(self, share: Floats) -> list[Any]:
        """Return the values below which these parts (0 to 1) of the probability lie."""
        if self.choices:
            return [self.choices[min(int(p * len(self.choices)), len(self.choices) - 1)] for p in share]
        distribution = self.frozen()
        low, high = float(distribution.cdf(self.limits.low)), float(distribution.cdf(self.limits.high))
        return [float(v) for v in distribution.ppf(low + (high - low) * share)]

    def shares_below(self, values: Floats) -> Floats:
        """Return the parts of the probability below values; the inverse of `quantiles`."""
        distribution = self.frozen()
        low, high = float(distribution.cdf(self.limits.low)), float(distribution.cdf(self.limits.high))
        return np.asarray((distribution.cdf(values) - low) / (high - low))

    def described(self, unit: str = "") -> str:
        """Describe its numbers, for a line of the run."""
        if self.choices:
            values = ", ".join(value_shown(v) for v in self.choices[:8]) + (", ..." if len(self.choices) > 8 else "")
            return f"each of {values} in turn" if self.name == "each" else f"one of {values}, equally likely"
        arguments = [
            f"{word} {quantity_text(number, '' if 'logarithm' in word else unit)}"
            for word, number in zip(ARGUMENTS[self.name], self.numbers, strict=True)
        ]
        cut = self.cut_off
        limits = [
            f"{sign} {value:g}"
            for sign, value in ((">", self.limits.low), ("<", self.limits.high))
            if np.isfinite(value)
        ]
        beyond = (
            f"; limited to {' and '.join(limits)}, which cuts off {100.0 * cut:.2g} %" if limits and cut >= 5e-5 else ""
        )
        return f"{self.name}, {', '.join(arguments)}{beyond}"


def is_distribution(text: str) -> bool:
    """Whether a text is the name of a distribution with something in brackets."""
    call = _CALL.match(text)
    return call is not None and call[1].strip().lower() in (*ARGUMENTS, *OF_VALUES)


def read_distribution(
    text: str, *, where: str, number: Callable[[str], float], value: Callable[[str], Any], limits: Limits
) -> Distribution:
    """Read a distribution.

    ``number``: reads one of its numbers, with a unit or without; ``value``: reads one of the values of a choice.
    """
    call = _CALL.match(text)
    name = call[1].strip().lower() if call else ""
    if call is None or name not in (*ARGUMENTS, *OF_VALUES):
        forms = [f"{word}({', '.join(numbers)})" for word, numbers in ARGUMENTS.items()]
        raise InputError(
            f"{value_shown(text)} is no distribution", where=where,
            remedy=f"{nearest(name, [*ARGUMENTS, *OF_VALUES])}There are {'; '.join(forms)}; choice(value, value, ...)",
        )  # fmt: skip
    entries = [entry.strip() for entry in re.split(r",(?![^\[]*\])", call[2])]  # a list in brackets is one value
    if not all(entries) or (name not in OF_VALUES and len(entries) != len(ARGUMENTS[name])):
        words = ", ".join(ARGUMENTS.get(name, ("value", "value", "...")))
        many = count_text(len(entries), "number") if all(entries) else "an empty place"
        raise InputError(f"{value_shown(text)} has {many}", where=where, remedy=f"Give {name}({words})")
    if name in OF_VALUES:
        return Distribution(name, (), tuple(value(entry) for entry in with_unit_of_last(entries, where)), text=text)
    return _checked(Distribution(name, _numbers(name, entries, where, number), (), limits, text), where)


def refuse_bare_numbers(texts: Sequence[str], where: str) -> None:
    """Refuse numbers without a unit beside others with one: 18 kPa and 20 are not 18 kPa and 20 Pa."""
    units = [(_UNIT.match(text) or ["", ""])[1].strip() if looks_like_quantity(text) else "" for text in texts]
    bare = [text for text, unit in zip(texts, units, strict=True) if looks_like_quantity(text) and not unit]
    if bare and any(units) and bare[0].strip("+-.0"):
        raise InputError(
            f"{bare[0]} has no unit, but {next(p for p, unit in zip(texts, units, strict=True) if unit)} has", where=where,
            remedy="Write the unit behind each",
        )  # fmt: skip


def with_unit_of_last(texts: Sequence[str], where: str) -> list[str]:
    """Give numbers without a unit the unit of the last one: ``14..24kPa`` is not 14 Pa to 24 kPa."""
    last = _UNIT.match(texts[-1])
    unit = last[1].strip() if last else ""
    # Only bare numbers take the unit of the last one; a part with a unit of its own keeps it.
    plain = [looks_like_quantity(text) and not (_UNIT.match(text) or ["", "x"])[1] for text in texts]
    if not unit:
        if plain[-1] and float(texts[-1]) != 0.0 and not all(plain):
            raise InputError(
                f"{texts[-1]} has no unit, but {texts[plain.index(False)]} has", where=where,
                remedy="Write the unit behind the last number, for all, or behind each",
            )  # fmt: skip
        return list(texts)
    return [f"{text} {unit}" if bare else text for text, bare in zip(texts, plain, strict=True)]


def _numbers(name: str, texts: list[str], where: str, number: Callable[[str], float]) -> tuple[float, ...]:
    spread = {"lognormal": 1, "normal": 1}.get(name)
    if spread is None:
        return tuple(number(text) for text in with_unit_of_last(texts, where))
    share = re.fullmatch(r"([-+.\deE]+)\s*%", texts[1])
    if share is not None:
        texts = [texts[0], str(float(share[1]) / 100.0)]
    centre = number(texts[0])
    if name == "lognormal":
        try:
            return centre, float(texts[1])
        except ValueError as error:
            raise InputError(
                f"{value_shown(texts[1])} is no standard deviation of a logarithm", where=where,
                remedy="Give a number without a unit, such as 0.2 or 20 %",
            ) from error  # fmt: skip
    if share is not None:
        return centre, abs(centre) * float(texts[1])
    centre, deviation = (number(text) for text in with_unit_of_last(texts, where))
    return centre, deviation


def _checked(d: Distribution, where: str) -> Distribution:
    """Refuse numbers that no such distribution has, and one that is mostly impossible."""
    a = d.numbers
    fault = ""
    if not np.isfinite(a).all():
        fault = "numbers that are not finite"
    elif d.name == "lognormal" and a[0] <= 0.0:
        fault = f"a median of {a[0]:g}, but a lognormal number is above 0"
    elif d.name in ("lognormal", "normal") and a[1] <= 0.0:
        fault = f"a standard deviation of {a[1]:g}"
    elif d.name == "lognormal" and a[1] > _WIDEST:
        fault = (
            f"a standard deviation of the logarithm of {a[1]:g}, a factor of {np.exp(min(a[1], 700.0)):.2g} up and down"
        )
    elif d.name == "uniform" and not a[0] < a[1]:
        fault = f"{a[0]:g} is not below {a[1]:g}"
    elif d.name == "triangular" and not (a[0] <= a[1] <= a[2] and a[0] < a[2]):
        fault = f"{a[0]:g}, {a[1]:g} and {a[2]:g} are not in order"
    if fault:
        raise InputError(fault, where=where, remedy=EXAMPLE)
    if d.cut_off > 0.5:
        to = f" to {d.limits.high:g}" if np.isfinite(d.limits.high) else " on"
        raise InputError(
            f"{100.0 * d.cut_off:.0f} % of the probability lies at impossible values", where=where,
            remedy=f"Possible are numbers from {d.limits.low:g}{to}",
        )  # fmt: skip
    return d


def shares(draws: int, dimensions: int, plan: str, seed: int, widths: Sequence[int] = ()) -> Floats:
    """Return the parts of the probability at which members draw, shape (draws, dimensions).

    The first rows do not depend on how many follow, but for a Latin hypercube. Plans for sensitivity have several rows for each
    draw: a point, the same with each input in turn taken from a second point, and for ``saltelli`` that second point.
    ``widths``: numbers of each input, by default one.
    """
    if plan not in PLANS:
        raise InputError(f"{plan!r} is no plan", where="plan", remedy=f"{nearest(plan, PLANS)}Use {', '.join(PLANS)}")
    if dimensions == 0:
        return np.zeros((draws, 0))
    if plan == "random":
        streams = (np.random.Philox(key=seed, counter=[0, 0, 0, k]) for k in range(draws))
        return np.array([np.random.Generator(stream).random(dimensions) for stream in streams])
    from scipy.stats import qmc

    if plan == "latin-hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, rng=np.random.default_rng(seed)).random(draws))
    if plan in POINTS:
        # Morris: an input moves by 40 % of its distribution (a half would miss what repeats itself), in a radial design
        # (Campolongo and others 2011). Saltelli and others (2010): the second point is independent.
        points = shares(draws, dimensions * POINTS[plan], "sobol", seed)
        first = points[:, :dimensions]
        second = points[:, dimensions:] if plan == "saltelli" else first + np.where(first < 0.5, STEP, -STEP)
        is_input = np.repeat(np.eye(len(widths) or dimensions, dtype=bool), widths or 1, axis=1)
        turns = np.where(is_input, second[:, None, :], first[:, None, :])
        blocks = [first[:, None], turns, second[:, None]][: POINTS[plan] + 1]
        return np.concatenate(blocks, axis=1).reshape(-1, dimensions)
    # In whole powers of two, where Sobol' numbers are balanced; what is not needed is left out.
    sequence = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed)).random_base2(
        max(int(np.ceil(np.log2(max(draws, 1)))), 0)
    )
    return np.asarray(sequence[:draws])


def member_seed(seed: int, draw: int) -> int:
    """Return the seed of the random fields of a draw, a whole number that a double holds exactly."""
    words = np.random.SeedSequence(seed, spawn_key=(draw,)).generate_state(2)
    return (int(words[0]) << 20) | (int(words[1]) >> 12)
