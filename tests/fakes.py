"""A small model without physics: a lattice berg that drifts, turns and loses a piece at a known time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from riftberg import A68A_2022_MTS, Laws, Parameters, constants
from riftberg.engines.common.fragments.contact_log import ContactLog
from riftberg.engines.common.fragments.grounding_log import GroundingLog
from riftberg.engines.common.fragments.tree import Fragment, FragmentTree
from riftberg.errors import RunError
from riftberg.ocean.forcing import Forcing
from riftberg.runs.restart import save
from riftberg.state import new_bonds, new_elements
from riftberg.system.process import held

SIDE = 3000.0
EXPLICIT = A68A_2022_MTS.changed(fracture={"normal_strength": 18e3})


@dataclass
class FakeTree:
    """Family tree of the fragments."""

    rows: list[Fragment] = field(default_factory=list)
    bergs: tuple[tuple[str, int], ...] = ()

    origin = FragmentTree.origin


class FakeForcing(Forcing):
    """Uniform eastward current over a sloping floor."""

    title = "uniform current of 0.2 m/s"
    citations = ("Nobody (2000): A uniform current.",)

    def describe(self) -> str:
        """Return what this forcing is."""
        return "uniform current of 0.2 m/s east, made up for tests"

    def currents(self, lon: Any, lat: Any, time: float) -> tuple[Any, Any]:
        """Return the current at points."""
        return np.full(np.shape(lon), 0.2), np.full(np.shape(lon), 0.05)

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return a bump in the floor."""
        return 250.0 - 130.0 * np.exp(-(((lon + 37.25) * 64) ** 2 + ((lat + 54.95) * 111) ** 2) / 7.58**2)


class FakeModel:
    """Berg of ``nx`` by ``ny`` square elements; its last columns break off at ``break_time`` seconds."""

    life: Any = None  # nothing melts
    motion: Any = None
    contacts = ContactLog()  # nothing touches
    groundings = GroundingLog()
    rift_tips: tuple[()] = ()
    laws = Laws()
    sea_level_notice = ""

    def __init__(
        self,
        nx: int = 8,
        ny: int = 3,
        *,
        latlon: bool = True,
        parameters: Parameters = EXPLICIT,
        lon: float = -39.0,
        lat: float = -55.0,
        turn_per_day: float = -12.0,
        break_time: float = 86_400.0,
        start: datetime = datetime(2020, 12, 9, 13),
    ) -> None:
        if not latlon:
            parameters = parameters.changed(earth={"latlon": False})
        self.parameters, self.start, self.forcing = parameters, start, FakeForcing()
        self.constants = parameters.kernel_values()
        self.time, self.step_number, self.substeps = 0.0, 0, 90
        self.remembered: dict[str, Any] = {}
        self.turns = 0.0
        self.fail_at, self.failure = math.inf, RunError("the contact iteration does not converge")
        self.origin, self.turn, self.break_time = (lon, lat), math.radians(turn_per_day) / 86_400.0, break_time
        i, j = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
        self._x, self._y = (i.ravel() - (nx - 1) / 2) * SIDE, (j.ravel() - (ny - 1) / 2) * SIDE
        self._column, self._nx = i.ravel(), nx
        rows = np.arange(nx * ny).reshape(nx, ny)
        pairs = [(rows[:-1], rows[1:]), (rows[:, :-1], rows[:, 1:])]
        self.bonds = new_bonds(*(np.concatenate([p[k].ravel() for p in pairs]) for k in (0, 1)))
        self.bonds.bond_length[:] = self.bonds.rest_length[:] = SIDE
        self.elements = new_elements(nx * ny)
        self.elements.body.substeps[:] = self.substeps
        self.elements.length[:] = self.elements.width[:] = SIDE
        self.elements.thickness[:] = 200.0
        self.elements.mass[:] = 200.0 * SIDE**2 * 850.0
        self.elements.berg[:] = 1
        area = SIDE**2 * nx * ny
        self.fragments = FakeTree([Fragment(1, 0, 0.0, lon, lat, nx * ny, area, area * 200.0 * 850.0, 0, False)])
        self._place()

    def _place(self) -> None:
        angle = self.turn * self.time
        x = self._x * math.cos(angle) - self._y * math.sin(angle) + 0.2 * self.time
        y = self._x * math.sin(angle) + self._y * math.cos(angle) - 0.02 * self.time
        x = x + np.where(self.elements.berg == 2, 0.1 * max(0.0, self.time - self.break_time), 0.0)
        e = self.elements
        if self.parameters.earth.latlon:
            metres = constants.DEGREE * self.parameters.earth.radius
            e.lat[:] = self.origin[1] + y / metres
            e.lon[:] = self.origin[0] + x / (metres * np.cos(np.radians(self.origin[1])))
        else:
            e.lon[:], e.lat[:] = x, y
        e.u_sync[:], e.v_sync[:], e.rotation[:], e.spin[:] = 0.2, -0.02, angle, self.turn
        stress = 1000.0 + self.time / 100.0
        self.bonds.normal_stress[:] = stress
        self.bonds.peak_stress[:] = stress + (500.0 if self.step_number % 2 else 30.0)

    def fit_time_step(self, interval: float) -> None:
        """Keep the time step."""

    @property
    def date(self) -> datetime:
        """Date of the state."""
        return self.start + timedelta(seconds=self.time)

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocity of the elements."""
        return self.elements.u_sync.copy(), self.elements.v_sync.copy()

    @property
    def fragment_count(self) -> int:
        """Number of fragments."""
        return len(self.fragments.rows)

    @property
    def bonds_broken(self) -> int:
        """Number of broken bonds."""
        return int(np.isfinite(self.bonds.break_time).sum())

    def save(self, path: Path) -> Path:
        """Write a restart file."""
        return save(self, path)  # type: ignore[arg-type]

    def step(self) -> None:
        """Move on by one long step, or fail at ``fail_at`` (s)."""
        if self.time >= self.fail_at:
            raise self.failure
        self.step_number += 1
        self.time = self.step_number * self.parameters.time_step
        if self.time >= self.break_time and len(self.fragments.rows) == 1:
            self._break()
        self._place()

    def _break(self) -> None:
        loose = self._column >= self._nx - 2
        self.elements.berg[loose] = 2
        cut = loose[self.bonds.first] != loose[self.bonds.second]
        self.bonds.status[cut], self.bonds.break_time[cut] = 2, self.time
        lon, lat = float(self.elements.lon[loose].mean()), float(self.elements.lat[loose].mean())
        area = float(loose.sum()) * SIDE**2
        self.fragments.rows.append(
            Fragment(2, 1, self.time, lon, lat, int(loose.sum()), area, area * 170e3, int(cut.sum()), True)
        )

    def check(self, days: float | None = None, *, steps: int | None = None) -> int:
        """Refuse nothing."""
        return 1

    def advance(self, days: float | None = None, *, steps: int = 0, recorders: Any = (), step: Any = None) -> None:
        """Run as the real model does."""
        end = self.time + (steps * self.parameters.time_step if days is None else days * 86_400.0)
        started = []
        try:
            for recorder in recorders:
                recorder.start(self)
                started.append(recorder)
            with held() as hold:
                while self.time < end - 1e-6 and not hold.requested:
                    (step or self.step)()
                    for recorder in recorders:
                        recorder.record(self)
        finally:
            for recorder in started:
                recorder.finish(self)
        hold.check()
