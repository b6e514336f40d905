"""Twin of pre-stress and reserve: a column of ice whose crevasses are opened step by step."""

from __future__ import annotations

SEA, GRAVITY = 1025.0, 9.8


def prestress(thickness, rho_ice, layers=500):
    """Mean over the thickness of the pressure of the water on a front, less the weight of the ice above, layer by layer."""
    draft, total = rho_ice / SEA * thickness, 0.0
    for k in range(layers):
        above = (k + 0.5) / layers * thickness  # depth of the middle of a layer below the surface of the ice
        below_sea = above - (thickness - draft)
        total += rho_ice * GRAVITY * above - SEA * GRAVITY * max(0.0, below_sea)
    return total / layers


def column_tension(depth, tip_tension, thickness, rho_ice):
    """Tension beside the pre-stress of a column whose crevasses, dry above and full of sea water below, stand at ``depth``.

    The integral of the stress that is left over the column: none over the pressure of air and water in the crevasses, and one
    that grows from the tips so that it is the tension there over that pressure.
    """
    sigma = prestress(thickness, rho_ice)
    deviation = 2.0 * sigma * depth + tip_tension  # horizontal stress over the weight of the ice above, of intact ice
    top = (deviation - tip_tension) / (rho_ice * GRAVITY)
    base = (deviation - tip_tension) / ((SEA - rho_ice) * GRAVITY)
    total, layers = 0.0, 1000
    for k in range(layers):
        above = (k + 0.5) / layers * thickness
        if above < top:
            force = rho_ice * GRAVITY * above  # no stress at all in a dry crevasse, over the weight of the ice
        elif thickness - above < base:
            force = (SEA - rho_ice) * GRAVITY * (thickness - above)  # minus the pressure of sea water, over that weight
        else:
            force = deviation
        total += force / layers
    return total - sigma


def reserve(tip_tension, thickness, rho_ice):
    """Largest of these tensions over all depths at which two sets of crevasses find room."""
    return max(column_tension(k / 50.0, tip_tension, thickness, rho_ice) for k in range(50))
