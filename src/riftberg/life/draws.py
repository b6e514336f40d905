"""Random numbers of births: the reference's streams, or draws that depend on seed, step and element alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

_LARGEST: Final = 2.0**32 - 1.0


class FmsStream:
    """Random numbers of FMS: Mersenne twister with an array as seed; a draw is the next 32 bits over the largest (files, 0.5).

    Examples
    --------
    >>> round(FmsStream((0, 0, 1, 1, 1, 0, 0, 0)).next(), 6)
    0.121208

    """

    def __init__(self, seed: int | Sequence[int]) -> None:
        self._twister = np.random.RandomState(seed)

    def next(self) -> float:
        """Return the next draw, from 0 to 1, both included."""
        return int.from_bytes(self._twister.bytes(4), "little") / _LARGEST


class ReferenceDraws:
    """Draws as in the reference (quirk T10): a stream for each process, seeded by its rank and the date of its first step.

    ``date``: year, month, day, hour, minute and second of the first step.
    """

    def __init__(self, date: tuple[int, ...], one_draw: bool = False) -> None:
        self._date, self._one_draw = date, one_draw
        self._streams: dict[int, FmsStream] = {}
        self._first: dict[int, float] = {}

    def draw(self, rank: int, identifier: int, step: int) -> float:
        """Return the next number of the stream of a process; every stream loses one draw at its start (files, 2.2)."""
        if rank not in self._streams:
            self._streams[rank] = FmsStream((rank, rank, *self._date))
            self._first[rank] = self._streams[rank].next()
        return self._first[rank] if self._one_draw else self._streams[rank].next()


class OwnDraws:
    """Draws by seed, step and element, so that a run that is resumed goes on alike, and no berg changes another's."""

    def __init__(self, seed: int, one_draw: bool = False) -> None:
        self._seed, self._one_draw = seed, one_draw

    def draw(self, rank: int, identifier: int, step: int) -> float:
        """Return the number of a child of an element that is born in a long step."""
        key = (self._seed,) if self._one_draw else (self._seed, step, identifier)
        return float(np.random.default_rng(key).random())


CalvingDraws = ReferenceDraws | OwnDraws
"""Where random numbers from 0 to 1 come from."""
