"""Contact of two faces of ice that crush each other: pressure up to a limit, stiff unloading, Coulomb friction (Riftberg).

A face of chord b (m) on ice of thickness h (m) that is pressed in by d (m) since it was touched bears

    F = min(k_u <d - d_p>, k <d - d_e>, p_c h b),    k = p_c h b / a,    k_u = r k

with the depth d_e at which the faces touched, the depth d_p to which the ice is crushed, the crushing strength p_c (Pa), the
depth a (m) over which it is reached, and the ratio r of the stiffness of unloading. The energy that comes back is 1 / r of that
which went in, so two faces rebound at ``1 / sqrt(r)`` of the speed at which they met, whatever that was.
"""

from __future__ import annotations

from riftberg.compiled.kernels import kernel


@kernel
def face_stiffness(strength: float, thickness: float, chord: float, depth: float) -> float:
    """Stiffness of loading, N m-1: ``k = p_c h b / a``.

    Parameters
    ----------
    strength : float
        Crushing strength of the face, Pa.
    thickness : float
        Of the thinner of both elements, m.
    chord : float
        Length of the face in plan, m.
    depth : float
        Depth over which the strength is reached, m.
    """
    return strength * thickness * chord / depth


@kernel
def crushing_force(
    depth: float, touched: float, crushed: float, stiffness: float, ratio: float, limit: float, compliance: float
) -> float:
    """Force between two faces, N: the least of unloading, loading and crushing; never a pull.

    Parameters
    ----------
    depth : float
        Depth of the overlap without the force, m.
    touched : float
        Depth at which the faces touched, m.
    crushed : float
        Depth to which the ice is crushed, m.
    stiffness : float
        Of loading, N m-1.
    ratio : float
        Stiffness of unloading over that of loading.
    limit : float
        Force at which the whole face is crushed, N.
    compliance : float
        How far the force presses the faces apart within the step, m N-1: the law is taken at ``depth - compliance F``.

    Notes
    -----
    Each branch rises with the depth, so the force under which law and motion agree is the least of those of the branches.
    """
    unloading = ratio * stiffness
    back = unloading * (depth - crushed) / (1.0 + unloading * compliance)
    on = stiffness * (depth - touched) / (1.0 + stiffness * compliance)
    return max(min(back, on, limit), 0.0)


@kernel
def sliding_force(stop: float, force: float, friction: float) -> float:
    """Coulomb friction between two faces, N: what stops the sliding, ``stop``, up to ``friction`` times the force on the face."""
    most = friction * force
    return min(max(stop, -most), most)
