"""Rings around the tips of rifts stay as they are while ice melts; stress intensities are those of rings that are made anew."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.quasi_static.fracture import crack_paths

WARM = Forcing.uniform(temperature=30.0, salinity=34.0, wind=(10.0, 0.0))
STRONG: dict[str, Any] = {"criterion": "toughness", "toughness": 1e9, "normal_strength": 1e9, "shear_strength": 1e9}


def cracked(*, melt: bool = True, **other: Any) -> Model:
    """15 x 15 km of ice with a rift inside, pulled apart along x, thicker in the east, in water that melts it."""
    berg = Iceberg.rectangle(15e3, 15e3, thickness=200.0, radius=500.0, latlon=False, lattice_angle=20.0)
    berg = berg.with_rifts([[(130.0, -2.9e3), (130.0, 3.1e3)]], broken=True)
    berg.elements.thickness[:] += 2e-3 * berg.elements.lon
    berg.elements.mass[:] = berg.elements.length * berg.elements.width * 850.0 * berg.elements.thickness
    parameters = Parameters(
        fracture=STRONG, earth={"latlon": False}, melt={"enabled": melt}, stepping={"time_step": 3600.0}, **other
    )
    model = Model(berg, WARM, parameters)
    el = model.elements
    el.load_x[:] = 3e7 * np.sign(el.lon) * el.mass / el.mass.mean()
    return model


def nothing(_: Model) -> None:
    """Let the ice melt."""


def stretch(model: Model) -> None:
    """Move the elements."""
    model.elements.lon[:] *= 1.001


def thin(model: Model) -> None:
    """Take ice from the elements on one side of the rift."""
    model.elements.thickness[model.elements.lat > model.elements.lat.mean()] *= 0.9


def cut(model: Model) -> None:
    """Break the bonds of the corner that lies the farthest north."""
    corner, bonds = int(np.argmax(model.elements.lat)), model.bonds
    bonds.status[(bonds.first == corner) | (bonds.second == corner)] = 1


def cut_beside_a_tip(model: Model) -> None:
    """Break a bond two elements from a tip."""
    bonds, el, (tip, *_) = model.bonds, model.elements, model.rift_tips
    x, y = (0.5 * (place[bonds.first] + place[bonds.second]) for place in (el.lon, el.lat))
    distance = np.hypot(x - tip.lon, y - tip.lat)
    bonds.status[np.argmin(np.where(bonds.status == 0, abs(distance - 2.5e3), np.inf))] = 1


@pytest.mark.parametrize("change", [nothing, stretch, thin, cut, cut_beside_a_tip])
def test_intensities_are_those_of_a_fresh_model_after_melt_and_after_a_restart(
    change: Callable[[Model], None], tmp_path: Path
) -> None:
    """Bit for bit, with all else; a restarted run has to make its rings anew."""
    model = cracked()
    model.advance(steps=3)
    before, thickness = model.rift_tips, model.elements.thickness.copy()
    again = Model.resume(model.save(tmp_path / "restart.nc"), WARM)
    for run in (model, again):
        change(run)
        run.advance(steps=2)
    assert [tip.hoop > 0.0 for tip in before] == [True, True]
    assert (model.elements.thickness < thickness - 0.1).all()
    assert model.rift_tips == again.rift_tips
    assert all(now.opening != tip.opening for now, tip in zip(model.rift_tips, before, strict=False))
    mine, of_restart = model._stepper.state_dict(), again._stepper.state_dict()
    assert mine.keys() == of_restart.keys()
    for name in mine:
        np.testing.assert_array_equal(mine[name], of_restart[name], err_msg=name)


def test_a_ring_is_made_once_while_ice_melts_and_anew_where_a_bond_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    made, make = [], crack_paths.tip_ring
    monkeypatch.setattr(crack_paths, "tip_ring", lambda *a, **k: made.append(a[3]) or make(*a, **k))
    model = cracked()
    counts = []
    for change in (nothing, nothing, nothing, thin, cut_beside_a_tip, nothing, stretch, nothing):
        change(model)
        model.advance(steps=1)
        counts.append(len(made))
    assert counts == [2, 2, 2, 2, 4, 4, 6, 6]
