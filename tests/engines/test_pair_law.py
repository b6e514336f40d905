"""Contact of the slow half kicks, found once for all passes, against the sums of the pair law."""

from __future__ import annotations

import numpy as np
import pytest

from engines.lattices import parameters
from riftberg.compiled.kernels import plain
from riftberg.engines.common.forces.pair_law import (
    Mover,
    NeighbourLists,
    PairLaw,
    allocate_contact_table,
    contact_terms,
    fill_contact_table,
    interaction_terms,
    pair_view,
)
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.state import new_elements
from riftberg.state.neighbours import OTHER_BERG, find_pairs, no_pairs

LAW = {
    "spring": 1e-6, "modulus": 5.0, "contact_spring": 1e-7, "contact_stiffest": 1e-3,
    "contact_distance": 4e3, "critical": True,
    "tangential_critical": True, "radial": 1e-4, "tangential": 2e-5, "by_speed": True, "latlon": True, "earth_radius": 6.37e6,
    "period": 360.0,
}  # fmt: skip


@pytest.mark.parametrize(
    "changes",
    [{}, {"by_speed": False}, {"critical": False}, {"contact_spring": -1.0, "contact_distance": 0.0}],
    ids=["by speed", "plain", "given", "stiff ice"],
)
def test_contact_found_once_gives_the_sums_of_the_pair_law(changes: dict[str, float]) -> None:
    """To the last digit, also for elements that touch nobody, lie upon each other, or differ in mass."""
    law = PairLaw(**{**LAW, **changes})
    random = np.random.default_rng(5)
    el = new_elements(60)
    el.lon[:], el.lat[:] = -37.0 + 0.25 * random.random(60), -55.0 + 0.15 * random.random(60)
    el.lon[1], el.lat[1] = el.lon[0], el.lat[0]
    el.length[:], el.width[:], el.thickness[:] = 3000.0, 3000.0, 200.0
    el.mass[:] = random.uniform(1e12, 2e12, 60)
    el.berg[:] = np.arange(60) // 2
    el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
    el.u[:], el.v[:] = random.normal(size=(2, 60))
    el.u_pair[:], el.v_pair[:] = random.normal(size=(2, 60))
    sizes = interaction_sizes(el, parameters())
    pairs = find_pairs(el.lon, el.lat, el.berg, 5000.0, OTHER_BERG, True, law.earth_radius, law.period)
    none = no_pairs(60)
    partners = NeighbourLists(none, none, pairs, np.zeros(0), np.zeros(0, np.int64))
    table, view = allocate_contact_table(60, pairs.partner.size), plain(pair_view)(el, sizes)
    fill_contact_table(el, pairs, sizes, law, table)
    assert 60 < table.start[-1] < pairs.partner.size
    for e in range(60):
        at = el.u[e], el.v[e], el.u[e] + 0.1, el.v[e] - 0.2
        want = plain(interaction_terms)(e, Mover(el.lon[e], el.lat[e], *at), partners, False, False, view, law)
        got = plain(contact_terms)(e, *at, table, el.u_pair, el.v_pair, law.by_speed)
        assert tuple(got) == tuple(want)
