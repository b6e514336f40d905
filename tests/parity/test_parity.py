"""Whole cases against the reference's output: positions, all other variables, breaks, bonds, restarts and layouts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from riftberg.kid.ncfile import checksum

from .cases import (
    BOND,
    BONDS_LEFT,
    CASES,
    CENTROID,
    POSITION,
    POSITION_WHILE_SAME,
    RELATIVE,
    STRESS,
    Case,
)
from .comparison import Comparison
from .records import checksums, layout, offset, paired, read

Compare = Callable[[str], Comparison]
LONG = ("a68_synthetic", "a68_oras5")
"""Cases of A68a that are slow: `a68_story` has the same berg, laws and files, and as many breaks."""


def with_name(fits: Callable[[Case], object]) -> pytest.MarkDecorator:
    """Give a test the names of the cases that fit."""
    names = [case.name for case in CASES.values() if fits(case)]
    return pytest.mark.parametrize(
        "name", [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in names]
    )


each_case = with_name(lambda case: True)
counting_bonds = with_name(lambda case: case.counts_bonds)
with_chaos = with_name(lambda case: case.chaotic_end)
with_bond_file = with_name(lambda case: case.name.startswith("a68"))

STAMPS = ("lon", "lat", "year", "day", "second", "id_cnt", "id_ij", "n_bonds")
CONSTANT = {"mass", "thickness", "width", "length", "start_lon", "start_lat", "start_year", "id_cnt", "id_ij",
            "start_day", "start_mass", "mass_scaling", "mass_of_bits", "heat_density", "bxn", "byn", "bxn_fast",
            "byn_fast"}  # fmt: skip
ACCELERATIONS = {"axn", "ayn", "axn_fast", "ayn_fast", "ang_accel"}


def tolerance(c: Comparison, variable: str) -> float:
    """Largest difference of a variable: part of its largest value in the case."""
    return c.case.relative_acceleration if variable in ACCELERATIONS else c.case.relative


@each_case
def test_positions_before_the_first_break(comparison: Compare, name: str) -> None:
    c = comparison(name)
    assert c.position(c.before_break) <= POSITION


@each_case
def test_all_other_variables_before_the_first_break(comparison: Compare, name: str) -> None:
    c = comparison(name)
    rows = c.before_break
    for variable in sorted(set(c.theirs) - set(STAMPS)):
        chosen = rows
        if variable in ("uvel_prev", "vvel_prev") and c.report.case.parameters.stepping.skip_first_long_force:
            chosen = rows & (c.theirs["second"] > c.stamps[0])  # undefined in the reference
        ours, theirs = c.ours[variable][chosen], c.theirs[variable][chosen]
        assert np.abs(ours - theirs).max() <= tolerance(c, variable) * np.abs(theirs).max(), variable


@counting_bonds
def test_bonds_of_each_element_at_each_record(comparison: Compare, name: str) -> None:
    c = comparison(name)
    rows = c.while_same
    np.testing.assert_array_equal(c.ours["n_bonds"][rows], c.theirs["n_bonds"][rows])
    assert c.position(rows) <= POSITION_WHILE_SAME


@each_case
def test_enough_breaks_are_compared(comparison: Compare, name: str) -> None:
    """The windows hold the breaks that they are meant to hold, so that the test before cannot pass by being empty."""
    c = comparison(name)
    assert (c.same_until < c.stamps[-1]) == (name in {"a68_synthetic", "a68_oras5"})
    least = {"dem_ground_frac": 31, "a68_synthetic": 10, "a68_story": 13, "a68_oras5": 13}
    if name in least:
        left = c.bonds_left(c.theirs)
        assert left[0] - left[c.stamps <= c.same_until][-1] >= least[name]


@with_bond_file
def test_bonds_and_stresses_at_the_stamps_of_the_bond_file(comparison: Compare, name: str) -> None:
    pair = comparison(name).bonds
    assert pair is not None
    ours, theirs = pair
    assert len(np.unique(theirs["second"])) >= 9
    np.testing.assert_array_equal(ours["broken"], theirs["broken"])
    for variables, limit in (
        (("length", "tangd1", "tangd2"), BOND),
        (("nstress", "sstress"), STRESS),
        (("n1", "n2", "rel_rotation"), RELATIVE),
    ):
        for variable in variables:
            np.testing.assert_allclose(ours[variable], theirs[variable], rtol=0.0, atol=limit, err_msg=variable)


@pytest.mark.slow
def test_a_broken_bond_is_listed_while_its_ends_belong_together(comparison: Compare) -> None:
    """a68_oras5 has a broken bond, listed from both ends, at stamp 4."""
    pair = comparison("a68_oras5").bonds
    assert pair is not None
    assert pair[1]["broken"].sum() == 2


@with_chaos
def test_two_more_days(comparison: Compare, name: str) -> None:
    """After the same breaks; in all other cases the breaks are the same to the end."""
    later = comparison(name).later()
    assert len(later) >= 8
    for second, ours, theirs, apart in later:
        assert abs(ours - theirs) <= BONDS_LEFT * theirs, f"bonds left at {second / 86400.0:g} d"
        assert apart <= CENTROID, f"centroid at {second / 86400.0:g} d"


@each_case
def test_final_restart(comparison: Compare, name: str) -> None:
    """All variables, by their largest value in the whole run, for a beam ends nearly at rest."""
    c = comparison(name)
    looser = POSITION_WHILE_SAME / POSITION if c.broken else 1.0
    ours, theirs = paired(read(c.file("_restart")), read(c.expected / "final_restart.nc"), ("id_cnt", "id_ij"))
    assert set(ours) == set(theirs)
    for variable in sorted(CONSTANT & set(theirs) if c.case.chaotic_end else set(theirs) - {"lon", "lat"}):
        scale = np.abs(c.theirs.get(variable, theirs[variable])).max()
        assert np.abs(ours[variable] - theirs[variable]).max() <= looser * tolerance(c, variable) * scale, variable
    if not c.case.chaotic_end:
        assert np.hypot(*offset(ours, theirs, c.case.latlon)).max() <= looser * POSITION


@each_case
def test_layout_of_the_restart(comparison: Compare, name: str) -> None:
    """Names, order, types and attributes; and checksums over the numbers that stand in the file."""
    c = comparison(name)
    path = c.file("_restart")
    assert layout(path) == layout(c.expected / "final_restart.nc")
    written = read(path)
    assert checksums(path) == {variable: checksum(values).rstrip() for variable, values in written.items()}
    theirs = c.expected / "final_restart.nc"
    assert checksums(theirs) == {variable: checksum(values).rstrip() for variable, values in read(theirs).items()}


@each_case
def test_layout_of_trajectory_and_bond_file(comparison: Compare, name: str) -> None:
    """The reference's files here hold fewer variables, in another order; each that they hold must be as ours."""
    c = comparison(name)
    pairs = [(c.file(), c.expected / "trajectories.nc")]
    if (c.expected / "bonds.nc").exists():
        pairs.append((c.file("_bonds"), c.expected / "bonds.nc"))
    for ours, theirs in pairs:
        known = {v.name: v for v in layout(ours)}
        for variable in layout(theirs):
            assert known[variable.name] == variable


@each_case
def test_all_records_of_the_reference_are_compared(comparison: Compare, name: str) -> None:
    c = comparison(name)
    assert c.distance.size == read(c.expected / "trajectories.nc")["lon"].size
