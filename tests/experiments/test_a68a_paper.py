"""The published run from its files: parity with the reference through stand-ins of their layout, parameters, refusals."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from experiments.paper_files import (
    GRID_FILE,
    HOURS,
    OCEAN_FILE,
    SEA_LEVEL_FILE,
    SIZES,
    VARIABLES,
    WIND_FILE,
    stand_ins,
    write_hours,
)
from parity.records import EARTH, read
from riftberg import A68A_2022, A68A_2022_KID, A68A_2022_MTS, Model, Options, build
from riftberg.constants import OCEAN_DRAG_BASE, OCEAN_DRAG_SIDE
from riftberg.errors import ForcingError, InputError
from riftberg.experiments.a68a_files import paper_model
from riftberg.fetching.fetch import HOURLY
from riftberg.kid.parameters import read_namelist, to_parameters

PAPER_DAYS = 18.0
START_RECORD = 206
ZONE = (-37.51, -55.2166)

ZONE_OF_STORY = (-37.305, -54.982)
POSITION = 1e-5
"""Largest difference of position (m), as in `parity.cases`."""

LITTLE = 1.0 / 24.0


class Reference:
    """The reference's trajectory of a case, paired with our elements by their places after the first step."""

    def __init__(self, case: Path, first: Model) -> None:
        self.table = read(case / "expected" / "trajectories.nc")
        self.seconds = np.unique(self.table["second"])
        e, rows = first.elements, self.rows(0)
        self.ids = [(self.table["id_cnt"][r], self.table["id_ij"][r]) for r in rows]
        apart = np.abs(e.lon[:, None] - self.table["lon"][rows]) + np.abs(e.lat[:, None] - self.table["lat"][rows])
        self.pairs = apart.argmin(axis=1)
        assert sorted(self.pairs) == list(range(len(rows)))

    def rows(self, second: int) -> np.ndarray:
        """Rows of a stamp, which is that of the start of a step."""
        return np.flatnonzero(self.table["second"] == second)

    def differences(self, model: Model) -> tuple[float, bool, int]:
        """Return the largest distance (m), whether every element has as many bonds, and the reference's broken bonds."""
        rows = self.rows(round(model.time) - 1800)
        order = {key: row for row in rows for key in [(self.table["id_cnt"][row], self.table["id_ij"][row])]}
        rows = np.array([order[self.ids[k]] for k in self.pairs])
        e, lat = model.elements, self.table["lat"][rows]
        east = np.radians(e.lon - self.table["lon"][rows]) * EARTH * np.cos(np.radians(lat))
        distance = np.hypot(east, np.radians(e.lat - lat) * EARTH)
        left = self.table["n_bonds"]
        broken = (left[self.rows(0)].sum() - left[rows].sum()) // 2
        return float(distance.max()), bool((e.bond_count == left[rows]).all()), int(broken)


def follow(model: Model, case: Path, days: float) -> Iterator[tuple[float, bool, int]]:
    """Run and yield the differences at every stamp of the reference."""
    model.forcing.check(model.elements, 0.0, days * 86400.0)
    model.step()
    reference = Reference(case, model)
    yield reference.differences(model)
    while model.time < days * 86400.0 - 1.0:
        model.step()
        if round(model.time) - 1800 in reference.seconds:
            yield reference.differences(model)


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path / "files"
    shutil.rmtree(tmp_path / "files", ignore_errors=True)  # some hundred MB


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("name", "days", "zone", "breaks"),
    [
        ("a68_oras5", 4.25 + LITTLE, None, 13),
        pytest.param("a68_synthetic", 14.0, None, 10, marks=pytest.mark.slow),
        pytest.param("a68_story", 15.5, ZONE_OF_STORY, 13, marks=pytest.mark.slow),
    ],
)
def test_the_paper_from_its_files_is_what_the_reference_gives(
    shared: Path, folder: Path, name: str, days: float, zone: tuple[float, float] | None, breaks: int
) -> None:
    """Hourly files of the published layout in, the reference's positions and breaks out; a68_oras5 has the paper's berg.

    The story's grounding zone is its own, all else is the experiment's. Later than so many breaks the pieces are chaotic.
    """
    case = shared / "reference" / name
    options = Options(data=stand_ins(case, folder, days), days=days)
    model = build("a68a-paper", options)[0] if zone is None else paper_model(folder, options, zone=zone)
    met = 0
    for distance, same, broken in follow(model, case, days):
        assert distance < (POSITION if broken == 0 else 1e-3)
        assert same
        met = broken
        if broken >= breaks:
            break
    assert met >= breaks


def test_stand_ins_have_the_size_of_the_published_files(shared: Path, folder: Path) -> None:
    """Grid, variables, coordinates and hours add up to the published sizes, but for the attributes in the header."""
    stand_ins(shared / "reference" / "a68_oras5", folder, days=1.0)
    for file, size in SIZES.items():
        assert size - 1500 < (folder / file).stat().st_size <= size
        entry = next(hourly for hourly in HOURLY if hourly.merged == file)
        assert entry.records == HOURS[file]
        assert entry.variables == VARIABLES[file]


def test_parameters_are_those_of_the_reference_namelist(shared: Path) -> None:
    """Every value that the namelist of the paper's set-up gives, quirks included; four bonds are the default of squares."""
    namelist = read_namelist(shared / "reference" / "a68_oras5" / "input.nml")
    given = to_parameters(namelist)
    # The namelist has melt rates set to zero; what it says of melt and calving is no part of the preset.
    life = {name: getattr(given, name).model_dump() for name in ("melt", "rolling", "footloose", "calving")}
    assert given == A68A_2022_KID.changed(bonds={"max_bonds": 4}, **life)
    assert given.kernel_values() == A68A_2022_KID.changed(**life).kernel_values()
    driver, icebergs = namelist.driver, namelist.icebergs
    assert driver.whole("transient_a68_data_start_ind") == START_RECORD
    assert driver.number("REarth") == A68A_2022_KID.earth.radius
    assert (icebergs.number("A68_xdisp"), icebergs.number("A68_ydisp")) == ZONE
    assert driver.whole("ibhrs") == 24.0 * PAPER_DAYS


def test_parameters_are_those_of_the_publication_to_the_digit() -> None:
    """Equations 10.5 (table S1 of the paper)."""
    for p in (A68A_2022_KID, A68A_2022_MTS):
        assert p.ice.density == 850.0
        assert p.earth.radius == 6_363_827.0
        assert p.earth.period == 360.0
        assert p.drag.ocean_scale == 17.8
        assert p.drag.sides_by_bonds
        assert (p.time_step, p.stepping.substeps) == (1800.0, 90)
        assert (p.bonds.law, p.bonds.packing, p.bonds.max_bonds or 4) == ("dem", "square", 4)
        assert (p.bonds.youngs_modulus, p.bonds.poisson, p.bonds.damping) == (5e6, 0.3, 1.0)
        assert p.bonds.spring == 0.00065359477124183
        assert p.bonds.constant_size
        assert (p.contact.spring, p.contact.distance, p.contact.tolerance) == (1e-7, 4000.0, 1e-4)
        assert (p.contact.critical_damping, p.contact.tangential_critical_damping) == (True, False)
        assert (p.contact.tangential_damping, p.quirks.damping_by_speed, p.contact.iterate) == (0.0, False, True)
        assert (p.grounding.coefficient, p.grounding.ramp_height, p.grounding.on_substeps) == (1e4, 0.0, True)
        assert p.fracture.shear_strength == 100e3
        assert p.fracture.enabled
        assert p.fracture.on_substeps
        assert p.fracture.broken_as_contact
    assert A68A_2022_KID.fracture.normal_strength == 18e3  # of bonds; own numerics ask for that of the ice
    assert A68A_2022.fracture.normal_strength == 11e3
    assert A68A_2022_KID.stepping.skip_first_long_force
    assert (A68A_2022_KID.stepping.scheme, A68A_2022.stepping.scheme) == ("mts", "quasi_static")
    # The drag coefficients that the paper names, c_oh and c_ov, are those of point bergs times the scale.
    assert A68A_2022.drag.ocean_scale * OCEAN_DRAG_BASE == pytest.approx(0.02136, rel=1e-12)
    assert A68A_2022.drag.ocean_scale * OCEAN_DRAG_SIDE == pytest.approx(16.02, rel=1e-12)
    # k = E / (rho 4 R2), 14 significant digits.
    assert pytest.approx(5e6 / (850.0 * 4 * 1500.0**2), rel=1e-13) == A68A_2022_MTS.bonds.spring


def test_the_berg_and_the_set_up_are_the_published_ones(shared: Path, folder: Path) -> None:
    stand_ins(shared / "reference" / "a68_oras5", folder, days=1.0)
    model, info = build("a68a-paper", Options(data=folder, days=1.0))
    e = model.elements
    assert (e.lon.size, model.bonds.first.size) == (472, 874)
    for values, right in ((e.mass, 1.53e12), (e.thickness, 200.0), (e.length, 3000.0), (e.u, 0.22), (e.v, 0.0)):
        assert (values == right).all()
    assert (info.name, info.days, model.date) == ("a68a-paper", 18.0, datetime(2020, 12, 9, 13))
    assert round(info.days * 48) == 864
    forcing = model.forcing
    assert forcing.rules.zone == (360.0 - 37.51, -55.2166)  # type: ignore[attr-defined]
    corner, h = np.array([322.49, -55.2166]), 1e-6
    lon, lat = corner[0] + np.array([h, h, -h, -h]), corner[1] + np.array([h, -h, h, -h])
    assert forcing.depth(lon, lat).tolist() == [0.0, 1000.0, 1000.0, 1000.0]


def hour_file(folder: Path, file: str, value: float, **changes: Any) -> Path:
    """Replace a file by one whose values are ``value`` times the record (from 1)."""
    with netCDF4.Dataset(folder / GRID_FILE) as grid:
        lon, lat = np.array(grid["longitude"][0]), np.array(grid["latitude"][:, 0])
    ones = np.ones((lat.size, lon.size))
    fields = {name: {k: value * (k + 1) * ones for k in range(205, 230)} for name in VARIABLES[file]}
    (folder / file).unlink(missing_ok=True)
    write_hours(folder / file, fields, lon, lat, changes.pop("hours", HOURS[file]), **changes)
    return folder / file


@pytest.fixture
def small(shared: Path, folder: Path) -> Path:
    """Stand-ins of a small grid for a day."""
    return stand_ins(shared / "reference" / "a68_story", folder, days=1.0)


def test_hours_follow_the_clock_of_the_driver(small: Path) -> None:
    """Record 206 is 9 December 13:00; half hours are means, but the reference holds the sea level."""
    hour_file(small, OCEAN_FILE, 1e-3)
    hour_file(small, SEA_LEVEL_FILE, 1e-3)
    middle = np.s_[20, 20]
    for numerics, level in ((None, 0.207), ("reference", 0.207), ("own", 0.2075)):
        forcing: Any = build("a68a-paper", Options(data=small, days=1.0, numerics=numerics))[0].forcing  # type: ignore[arg-type]
        assert forcing.fields_at(0.0).uo[middle] == pytest.approx(0.206, rel=1e-12)
        assert forcing.fields_at(5400.0).uo[middle] == pytest.approx(0.2075, rel=1e-12)
        assert forcing.fields_at(5400.0).ssh[middle] == pytest.approx(level, rel=1e-12)


@pytest.mark.slow
def test_the_numerics_are_the_references_unless_riftbergs_are_asked_for(small: Path) -> None:
    def parameters(numerics: Any) -> Any:
        return build("a68a-paper", Options(data=small, days=1.0, numerics=numerics))[0].parameters

    assert parameters(None) == parameters("reference")
    assert parameters(None).compatibility == A68A_2022_KID.compatibility
    assert parameters("own").quirks == A68A_2022.quirks
    assert parameters("own").stepping.scheme == "quasi_static"
    changed = build("a68a-paper", Options({"fracture": {"normal_strength": 2e4}}, days=1.0, data=small))[0].parameters
    assert changed.fracture.normal_strength == 2e4


def test_the_shoal_can_be_left_out(small: Path) -> None:
    model, info = build("a68a-paper", Options(data=small, days=1.0, without=frozenset({"shoal"})))
    lon, lat = np.meshgrid(np.linspace(-41.0, -34.0, 9) + 360.0, np.linspace(-58.0, -54.0, 7))
    depth = model.forcing.depth(lon, lat)
    assert (depth[np.isfinite(depth)] == 1000.0).all()
    assert np.isfinite(depth).sum() > 40
    assert info.title.endswith("without shoal")


def test_with_riftbergs_numerics_the_shoal_is_a_bank_below_the_keel(small: Path) -> None:
    """A cliff up to the surface carries nothing. So it lies 1 m above the keel, and falls off by 1 in 100."""
    corner, draft, degree = (
        np.array([322.49, -55.2166]),
        200.0 * 850.0 / 1025.0,
        math.radians(1.0) * A68A_2022.earth.radius,
    )
    lon = corner[0] + np.array([0.1, 0.1, -1000.0 / (degree * math.cos(math.radians(corner[1] + 0.1)))])
    lat = corner[1] + np.array([0.1, -2000.0 / degree, 0.1])
    model = build("a68a-paper", Options(data=small, days=1.0, numerics="own"))[0]
    np.testing.assert_allclose(model.forcing.depth(lon, lat), draft - 1.0 + np.array([0.0, 20.0, 10.0]), atol=0.2)
    model.forcing.grid.locate(model.elements)  # type: ignore[union-attr]
    model.forcing.sample(model.elements, 0.0)
    e = model.elements
    np.testing.assert_allclose(e.depth, model.forcing.depth(e.lon, e.lat))
    assert "a bank 164.9 m deep" in model.forcing.describe()
    other = build("a68a-paper", Options(data=small, days=1.0))[0]
    assert other.forcing.depth(lon, lat).tolist() == [0.0, 1000.0, 1000.0]


def test_gaps_in_the_sea_level_make_no_slope_beside_them(small: Path) -> None:
    """As in the reference: what stands on land or in gaps must not push the berg away from them."""
    model, _ = build("a68a-paper", Options(data=small, days=1.0))
    model.forcing.grid.locate(model.elements)  # type: ignore[union-attr]
    model.forcing.sample(model.elements, 0.0)
    whole, e = model.elements.slope_x.copy(), model.elements
    j, i = int(e.cell_j[0]) - 4, int(e.cell_i[0]) - 4
    with netCDF4.Dataset(small / SEA_LEVEL_FILE, "a") as dataset:
        dataset["SSH"][:, j, i] = np.nan
    model, _ = build("a68a-paper", Options(data=small, days=1.0))
    model.advance(steps=2)
    e = model.elements
    model.forcing.sample(e, 0.0)
    beside = np.maximum(np.abs(e.cell_j - 4 - j), np.abs(e.cell_i - 4 - i))
    assert (e.slope_x[beside == 0] == 0.0).all()
    np.testing.assert_array_equal(e.slope_x[beside > 2] == 0.0, False)
    assert np.abs(e.slope_x).max() <= 1.5 * np.abs(whole).max()
    assert np.isfinite(e.u).all()


# ---- files that do not serve -----------------------------------------------------------------------------------------


def refused(folder: Path, *words: str, days: float | None = 1.0) -> None:
    with pytest.raises(ForcingError) as caught:
        build("a68a-paper", Options(data=folder, days=days))
    for word in (*words, "riftberg fetch a68a"):
        assert word in str(caught.value)


def test_missing_files_are_named_with_the_command_that_gets_them(tmp_path: Path, small: Path) -> None:
    refused(
        tmp_path, "no icebergs.res.nc (5 of 5 files are missing)", f"riftberg run a68a-paper --data {tmp_path} --fetch"
    )
    (small / WIND_FILE).unlink()
    refused(small, f"no {WIND_FILE}", str(small))


def test_without_a_folder_the_place_of_the_fetch_is_looked_at(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("RIFTBERG_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ForcingError, match=r"riftberg-data/a68a: no folder of data.*--data or RIFTBERG_DATA"):
        build("a68a-paper")
    (tmp_path / "riftberg-data").mkdir()
    small.rename(tmp_path / "riftberg-data" / "a68a")
    assert build("a68a-paper", Options(days=1.0))[1].name == "a68a-paper"
    for path in sorted((tmp_path / "riftberg-data" / "a68a").iterdir()):  # each of which it needs
        path.rename(tmp_path / "aside")
        with pytest.raises(ForcingError, match=path.name):
            build("a68a-paper", Options(days=1.0))
        (tmp_path / "aside").rename(path)


def test_a_pointer_of_git_lfs_is_no_file(small: Path) -> None:
    (small / OCEAN_FILE).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:431be\nsize 419792376\n")
    refused(small, "only a pointer of Git LFS instead of", OCEAN_FILE)


def test_a_file_that_is_too_short_is_refused_before_the_first_step(small: Path) -> None:
    """The wind's 739 records are enough for 18 days, which end with record 638."""
    hour_file(small, WIND_FILE, 0.01, hours=637)
    refused(small, WIND_FILE, "637 hourly records", "18 days from record 206 (9 December 13:00) need 638", days=None)
    hour_file(small, WIND_FILE, 0.01, hours=638)
    build("a68a-paper", Options(data=small))
    refused(small, "20 days", "need 686", "shorten the run with --days", days=20.0)
    assert 205 + math.ceil(18.0 * 24) < HOURS[WIND_FILE]


def test_a_file_without_its_variables_is_refused(small: Path) -> None:
    with netCDF4.Dataset(small / SEA_LEVEL_FILE, "a") as dataset:
        dataset.renameVariable("SSH", "adt")
    refused(small, SEA_LEVEL_FILE, "no variable 'SSH'", "found:", "adt")


def test_a_file_on_another_grid_is_refused(small: Path) -> None:
    hour_file(small, OCEAN_FILE, 1e-3, shift=0.125)
    refused(small, OCEAN_FILE, "degrees away from the grid's", GRID_FILE)
    (small / OCEAN_FILE).unlink()
    ones = {name: {205: np.ones((3, 5))} for name in VARIABLES[OCEAN_FILE]}
    write_hours(small / OCEAN_FILE, ones, np.arange(5.0), np.arange(3.0), 744)
    refused(small, OCEAN_FILE, "shape (744, 3, 5) does not fit the grid of 40 x 72 cells")


def test_a_file_that_was_cut_or_is_no_netcdf_is_refused(small: Path) -> None:
    with (small / WIND_FILE).open("r+b") as file:
        file.truncate(1_000_000)
    refused(small, WIND_FILE, "bytes short")
    (small / WIND_FILE).write_text("<html>maintenance</html>")
    refused(small, WIND_FILE, "cannot be read")


@pytest.mark.parametrize(("value", "words"), [(1e17, "uo = 2.06e+19"), (np.nan, "no value at all")])
def test_values_that_cannot_be_are_refused(small: Path, value: float, words: str) -> None:
    hour_file(small, OCEAN_FILE, value)
    refused(small, OCEAN_FILE, words, "record 206", "variable uo")


def test_it_is_listed() -> None:
    with pytest.raises(InputError, match=r"Built in are .*a68a-paper"):
        build("nothing")
