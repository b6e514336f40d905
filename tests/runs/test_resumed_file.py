"""The run file of a run that goes on holds, record by record and variable by variable, what the whole run's holds."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from riftberg import A68A_2022, A68A_2022_MTS, Forcing, Iceberg, Model, Parameters
from riftberg.runs.run_file import RunWriter

STEPS = 16
DT = A68A_2022_MTS.time_step
WEAK = {"fracture": {"normal_strength": 2e3, "shear_strength": 2e3}}
WEAKER = {"fracture": {"normal_strength": 630.0, "shear_strength": 630.0}}
WEAR = {"damage": {"enabled": True, "threshold": 0.1, "time_scale": 3600.0}}
EXPLICIT = A68A_2022_MTS
LAWS = {
    "breaking": EXPLICIT.changed(**WEAK),
    "wearing": A68A_2022.changed(**WEAKER, **WEAR, stepping={"time_step": 1800.0}),
}
MADE_ANEW = {"history", "date_created"}
"""Attributes that say when a file was written."""


def forcing() -> Forcing:
    return Forcing.uniform(current=(0.3, 0.1), wind=(10.0, -4.0), depth=165.0, slope=(0.0, 0.0))


def fresh(p: Parameters) -> Model:
    model = Model(Iceberg.rectangle(30e3, 12e3, thickness=200.0, placement=(-37.0, -56.0)), forcing(), p)
    model.elements.u[:] += np.linspace(-0.05, 0.05, model.elements.u.size)
    return model


def writer(path: Path, every_hours: float, forces: bool = False) -> RunWriter:
    return RunWriter(path, every_hours=every_hours, forces=forces)


def contents(path: Path) -> tuple[dict[str, np.ndarray], dict[str, tuple[str, ...]], dict[str, object]]:
    """Return values and dimensions of all variables, and all attributes of file and variables."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        values = {name: variable[...] for name, variable in file.variables.items()}
        dims = {name: variable.dimensions for name, variable in file.variables.items()}
        attributes: dict[str, object] = {name: file.getncattr(name) for name in file.ncattrs() if name not in MADE_ANEW}
        for name, variable in file.variables.items():
            attributes |= {f"{name}:{key}": str(variable.getncattr(key)) for key in variable.ncattrs()}
    return values, dims, attributes


def assert_goes_on(whole: Path, resumed: Path, *, first: float) -> None:
    """Every record of the whole run from ``first`` (s) on stands in the resumed one, with the same bits."""
    a, dims, said = contents(whole)
    b, dims_b, said_b = contents(resumed)
    assert dims == dims_b
    for attributes in (said, said_b):  # a state names also the parameters that follow from those that were set
        attributes.pop("command", None)
    assert said == said_b
    times = a["time"][a["time"] >= first]
    extra = np.setdiff1d(b["time"], a["time"])
    assert set(extra) <= {first}, "the record where it goes on is the only one beside those of the whole run"
    assert np.isin(times, b["time"]).all()
    rows_a, rows_b = np.isin(a["time"], times), np.isin(b["time"], times)
    for name, axes in dims.items():
        x, y = a[name], b[name]
        if "time" in axes:
            axis = axes.index("time")
            x, y = np.compress(rows_a, x, axis), np.compress(rows_b, y, axis)
        assert x.tobytes() == y.tobytes(), f"{name} differs"


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "every",
    [
        pytest.param(0.0, id="every step"),
        pytest.param(1.0, id="1 h", marks=pytest.mark.slow),
        pytest.param(2.0, id="2 h"),
        pytest.param(3.0 * DT / 3600.0, id="3 steps", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("apart", [6, pytest.param(2, marks=pytest.mark.slow)], ids=["few stops", "many stops"])
def test_every_variable_of_a_resumed_run_is_that_of_the_whole_run(
    tmp_path: Path, law: str, every: float, apart: int
) -> None:
    whole = fresh(LAWS[law])
    whole.advance(steps=STEPS, recorders=[writer(tmp_path / "whole.nc", every)])
    assert whole.bonds_broken > 0
    for stop in range(1, STEPS, apart):
        part = fresh(LAWS[law])
        part.advance(steps=stop, recorders=[writer(tmp_path / "part.nc", every)])
        resumed = Model.resume(part.save(tmp_path / "part.restart.nc"), forcing())
        resumed.advance(steps=STEPS - stop, recorders=[writer(tmp_path / "resumed.nc", every)])
        assert_goes_on(tmp_path / "whole.nc", tmp_path / "resumed.nc", first=stop * DT)


@pytest.mark.quick(1)
@pytest.mark.parametrize("every", [0.0, 1.0, 3.0 * DT / 3600.0], ids=["every step", "1 h", "3 steps"])
def test_forces_of_a_resumed_run_are_those_of_the_whole_run(tmp_path: Path, every: float) -> None:
    """A mean between two records counts what acted before a stop between them."""
    whole = fresh(LAWS["breaking"])
    whole.advance(steps=8, recorders=[writer(tmp_path / "whole.nc", every, forces=True)])
    assert any(name.startswith("force") for name in contents(tmp_path / "whole.nc")[0])
    for stop in (1, 4, 5):
        part = fresh(LAWS["breaking"])
        part.advance(steps=stop, recorders=[writer(tmp_path / "part.nc", every, forces=True)])
        resumed = Model.resume(part.save(tmp_path / "part.restart.nc"), forcing())
        resumed.advance(steps=8 - stop, recorders=[writer(tmp_path / "resumed.nc", every, forces=True)])
        assert_goes_on(tmp_path / "whole.nc", tmp_path / "resumed.nc", first=stop * DT)


@pytest.mark.slow
def test_stops_lie_between_records_and_peaks_matter_there(tmp_path: Path) -> None:
    """Without what is remembered, the record after a stop between two records lacks the peak from before the stop."""
    part = fresh(LAWS["breaking"])
    part.advance(steps=7, recorders=[writer(tmp_path / "part.nc", 2.0)])
    file = part.save(tmp_path / "part.restart.nc")
    peaks = []
    for forget in (False, True):
        resumed = Model.resume(file, forcing())
        if forget:
            resumed.remembered = {}
        resumed.advance(steps=8, recorders=[writer(tmp_path / "resumed.nc", 2.0)])
        peaks.append(contents(tmp_path / "resumed.nc")[0]["peak_stress"])
    assert (peaks[0] != peaks[1]).any()


@pytest.mark.slow
def test_two_stops_are_as_good_as_one(tmp_path: Path) -> None:
    """A state saved before the first new record still knows what was remembered before the first stop."""
    whole = fresh(LAWS["wearing"])
    whole.advance(steps=12, recorders=[writer(tmp_path / "whole.nc", 2.0)])
    model = fresh(LAWS["wearing"])
    for steps in (5, 1, 1):
        model.advance(steps=steps, recorders=[writer(tmp_path / "part.nc", 2.0)])
        model = Model.resume(model.save(tmp_path / "part.restart.nc"), forcing())
    model.advance(steps=5, recorders=[writer(tmp_path / "resumed.nc", 2.0)])
    assert_goes_on(tmp_path / "whole.nc", tmp_path / "resumed.nc", first=7 * DT)


@pytest.mark.slow
def test_runs_through_model_run_too(tmp_path: Path) -> None:
    fresh(LAWS["breaking"]).run(steps=10, output=tmp_path / "whole.nc", every_hours=1.5)
    part = fresh(LAWS["breaking"])
    part.run(steps=4, output=tmp_path / "part.nc", every_hours=1.5)
    resumed = Model.resume(part.save(tmp_path / "part.restart.nc"), forcing())
    resumed.run(steps=6, output=tmp_path / "resumed.nc", every_hours=1.5)
    assert_goes_on(tmp_path / "whole.nc", tmp_path / "resumed.nc", first=4 * DT)
