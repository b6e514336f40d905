"""What a berg aground weighs on the ocean in the reference: as much of each of its parts as the water bears."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg import Parameters
from riftberg.coupling.reference import NineCellRules, Spread, spread_nine
from riftberg.life.melt import bit_shape, life_values

RHO_SPREADING = 1035.0


@pytest.mark.parametrize("depth", [20.0, 1000.0])
def test_berg_and_footloose_bits_weigh_as_far_as_the_water_bears_them(depth: float) -> None:
    values = life_values(Parameters())
    thickness, share = 200.0, 0.5
    one = {name: np.ones(1) for name in Spread._fields}
    one |= {"cell_i": np.array([1]), "cell_j": np.array([1]), "xi": np.full(1, 0.5), "eta": np.full(1, 0.5)}
    one |= {
        "mass": np.full(1, 7e9),
        "fl_bits": np.full(1, 3e9),
        "area": np.full(1, 1e4),
        "thickness": np.full(1, thickness),
    }
    out, here = np.zeros((4, 9, 3, 3)), np.full((3, 3), depth)
    rules = NineCellRules(False, False, 0.0, False, share)
    spread_nine(Spread(**one), rules, values, here, np.zeros((3, 3)), np.full((3, 3), 1e8), np.ones((3, 3)), out)
    bit, _, _ = bit_shape(thickness, values)

    def borne(thick: float) -> float:
        return min(1.0, share * depth * RHO_SPREADING / (values.rho_ice * thick))

    assert out[0].sum() == pytest.approx(7e9 * borne(thickness) + 3e9 * borne(bit) + 2.0, rel=1e-12)
    assert (borne(bit) < 1.0) == (depth == 20.0)
