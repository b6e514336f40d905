"""Twin of the damage of a bond."""


def grow(damage, normal_stress, shear_stress, normal_strength, shear_strength, law, dt):
    """Damage after one explicit step of ``dD/dt = <(r / (1 - D) - r0) / (1 - r0)>^m / tau``; strengths are undamaged.

    ``law`` has ``damage_threshold``, ``damage_time`` and ``damage_exponent``. At the strength and beyond the rate is
    that of the strength; damage stops one millionth short of 1.
    """
    r = max(normal_stress / normal_strength, shear_stress / shear_strength)
    left = min(r / (1 - damage), 1.0)
    bracket = max(0.0, (left - law.damage_threshold) / (1 - law.damage_threshold))
    new = damage + dt / law.damage_time * bracket**law.damage_exponent
    return max(damage, min(new, 1 - 1e-6))
