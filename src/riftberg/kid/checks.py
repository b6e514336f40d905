"""Checks of a KID run before its first step: what melt, rolling and calving would change although they are off.

Source: specification of files, sections 1.9, 1.11, 3.2.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from riftberg.errors import BergError
from riftberg.kid.identifiers import split_id
from riftberg.kid.namelist import NamelistGroup
from riftberg.kid.ncfile import opened_dataset, unpacked
from riftberg.kid.restart import Origin
from riftberg.physics.floating import draft_of
from riftberg.state import Elements, Floats

CALVING_FILE: Final = "calving.res.nc"

_SCHEME_TWO: Final = 999.0


def tips_over(elements: Elements, group: NamelistGroup) -> Floats:
    """Return 1 for elements whose shape makes them roll as soon as they have no bond, else 0 (section 1.11)."""
    thickness, density = elements.thickness, group.number("rho_bergs")
    ratio, draft = draft_of(1.0, density), draft_of(thickness, density)
    short, long = np.minimum(elements.width, elements.length), np.maximum(elements.width, elements.length)
    tip = group.number("tip_parameter")
    squared = 6.0 * ratio * (1.0 - ratio)
    if group.flag("use_updated_rolling_scheme"):
        limit = (tip if tip > 0 else math.sqrt(squared)) * thickness
        return np.where(limit > short, 1.0, 0.0)
    if tip >= _SCHEME_TWO:
        radicand = squared * thickness**2 - 72.0 * ratio * thickness
        return np.where((radicand > 0) & (short < np.sqrt(np.maximum(radicand, 0.0))), 1.0, 0.0)
    return np.where(long < np.sqrt(0.92 * draft**2 + 58.32 * draft), 1.0, 0.0)


def check_rolling(elements: Elements, group: NamelistGroup, *, breakable: bool) -> None:
    """Refuse elements that would roll; bonded ones only if bonds can break.

    Parameters
    ----------
    elements : Elements
        Read: shape, ``bond_count``, ``static``.
    group : NamelistGroup
        ``icebergs_nml``.
    breakable : bool
        Whether bonds can break in this run.
    """
    if not group.flag("allow_bergs_to_roll"):
        return
    free = (elements.static < 0.5) & ((elements.bond_count == 0) | breakable)
    rolling = free & (tips_over(elements, group) > 0)
    if rolling.any():
        k = int(np.argmax(rolling))
        counter, cell = split_id(elements.id[k : k + 1])
        raise BergError(
            f"{elements.length[k]:g} x {elements.width[k]:g} m wide and {elements.thickness[k]:g} m thick, "
            "it would roll over, which KID runs here do not follow",
            where=f"element id_cnt = {counter[0]}, id_ij = {cell[0]}",
            remedy="Set allow_bergs_to_roll = .false.",
        )


def check_bits(origin: Origin, group: NamelistGroup) -> None:
    """Refuse bergy bits that would melt in spite of ``set_melt_rates_to_zero`` (quirk T5)."""
    if group.number("bergy_bit_erosion_fraction") > 0 and (origin.mass_of_bits > 0).any():
        raise group.error(
            f"bergy_bit_erosion_fraction = {group.number('bergy_bit_erosion_fraction')} with bits in the restart, "
            "which KID goes on melting",
            "Set it to 0, or remove mass_of_bits from the restart",
        )


def check_calving_store(folder: Path, group: NamelistGroup) -> None:
    """Refuse a store of calved ice that is large enough to release a berg."""
    path = folder / CALVING_FILE
    if not path.is_file():
        return
    with opened_dataset(path) as dataset:
        stored = unpacked(dataset, path, "stored_ice")
    classes = stored.reshape(-1, *stored.shape[-3:])[0]
    northern = "_n" if group.flag("separate_distrib_for_n_hemisphere") else ""
    for suffix in {"", northern}:
        mass, scaling = group.numbers(f"initial_mass{suffix}"), group.numbers(f"mass_scaling{suffix}")
        for k, (m, s) in enumerate(zip(mass, scaling, strict=True)):
            if float(classes[k].max()) >= m * s:
                raise group.error(
                    f"{path} stores {float(classes[k].max()):g} kg in size class {k + 1}, enough to calve a berg",
                    "Calving is not built into KID runs yet: remove the file",
                )


def order_sides(elements: Elements) -> int:
    """Make length the longer side, as KID does in its first step; return how many elements changed."""
    wrong = elements.width > elements.length
    elements.width[wrong], elements.length[wrong] = elements.length[wrong], elements.width[wrong]
    return int(wrong.sum())
