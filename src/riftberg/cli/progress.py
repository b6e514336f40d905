"""The interrupt that lets a step finish."""

from __future__ import annotations

from typing import TYPE_CHECKING

from riftberg.system.interrupts import Hold

if TYPE_CHECKING:
    from riftberg.model import BareModel


class Interrupt:
    """Recorder that ends a run between two steps after Ctrl-C or a request to terminate.

    Give it last, so that the other recorders have seen the step.
    """

    def __init__(self, hold: Hold) -> None:
        self.hold = hold

    def start(self, model: BareModel) -> None:
        """Do nothing: the signals are held already."""

    def record(self, model: BareModel) -> None:
        """End the run if this was asked for."""
        self.hold.check()

    def finish(self, model: BareModel) -> None:
        """Do nothing."""
