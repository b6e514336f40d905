"""Checks of a KID run before its first step: what calving would change although it is off, and elements that cannot be.

Source: files 3.2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.errors import BergError
from riftberg.kid.calving_file import CALVING_FILE, read_stores
from riftberg.kid.entries import REALS_SIZE
from riftberg.kid.namelist import NamelistGroup
from riftberg.kid.restart import id_text, split_id
from riftberg.ocean.grid import Grid
from riftberg.parameters import Packing, Parameters
from riftberg.state import Bonds, Elements


def check_calving_store(folder: Path, group: NamelistGroup, grid: Grid) -> None:
    """Refuse a store of calved ice that is large enough to release a berg."""
    path = folder / CALVING_FILE
    stores = read_stores(path, grid, REALS_SIZE)
    if stores is None:
        return
    classes = stores.ice
    northern = "_n" if group.flag("separate_distrib_for_n_hemisphere") else ""
    for suffix in {"", northern}:
        mass, scaling = group.numbers(f"initial_mass{suffix}"), group.numbers(f"mass_scaling{suffix}")
        for k, (m, s) in enumerate(zip(mass, scaling, strict=True)):
            if float(classes[k].max()) >= m * s:
                raise group.error(
                    f"{path} stores {float(classes[k].max()):g} kg in size class {k + 1}, enough to calve a berg",
                    "Only cases with an ocean (group drv_nml) calve: remove the file",
                )


TOO_CLOSE: Final = 0.01
"""Distance of two elements, in sums of their radii, that no run can start from."""


def check_distances(elements: Elements, packing: Packing, metric: Metric) -> None:
    """Refuse elements that lie on top of each other: contact and bonds have no direction between them."""
    near = form_bonds(elements, BondRule(packing=packing, radii_factor=TOO_CLOSE), metric)
    if len(near.first):
        names = " and ".join(id_text(elements.id[rows[0]]) for rows in (near.first, near.second))
        raise BergError(
            f"two elements lie on top of each other, {near.bond_length[0]:.3g} m apart at "
            f"{elements.lon[near.first[0]]:g}, {elements.lat[near.first[0]]:g}",
            where=f"elements {names}",
            remedy="Remove one of them from the iceberg restart",
        )


def check_both_sides(elements: Elements, bonds: Bonds, group: NamelistGroup, p: Parameters) -> None:
    """Refuse bonds whose two sides KID would compute with unequal thickness: it then pulls at both with unequal forces.

    So it is with equal sizes, where the side that is not its own gives the thickness (quirk Q11).
    """
    if p.bonds.law != "dem" or p.compatibility.shared_shear_lever:
        return
    body, i, j = elements.body, bonds.first, bonds.second
    alike = p.bonds.constant_size | (body.length[i] * body.width[i] == body.length[j] * body.width[j])
    unequal = alike & ((body.thickness[i] != body.thickness[j]) | p.melt.enabled)
    if unequal.any():
        k = int(np.argmax(unequal))
        (one, other), thickness = (split_id(elements.id[[i[k], j[k]]])), body.thickness
        raise group.error(
            f"save_bond_forces = .false. with bonded elements of {thickness[i[k]]:g} and {thickness[j[k]]:g} m (id_cnt = "
            f"{one[0]} and {one[1]}, id_ij = {other[0]} and {other[1]}){' that melt' if p.melt.enabled else ''}: each "
            "side of the bond then has a force of its own, and the berg drives itself",
            "Set save_bond_forces = .true.",
        )


def check_footloose(elements: Elements, group: NamelistGroup) -> None:
    """Refuse footloose calving of elements with bonds, at which the reference stops in its first step (files, 2)."""
    bonded = (elements.bond_count > 0) & (elements.static < 0.5) & (elements.life.fl_k >= 0.0)
    if group.flag("footloose") and bonded.any():
        k = int(np.argmax(bonded))
        raise group.error(
            f"footloose = .true. with iceberg_bonds_on = .true.: the element at {elements.lon[k]:g}, {elements.lat[k]:g} has "
            f"{elements.bond_count[k]} bonds, and the reference stops there too",
            "Set one of them to .false.",
        )


def order_sides(elements: Elements) -> int:
    """Make length the longer side, as KID does in its first step; return how many elements changed."""
    wrong = elements.width > elements.length
    elements.width[wrong], elements.length[wrong] = elements.length[wrong], elements.width[wrong]
    return int(wrong.sum())
