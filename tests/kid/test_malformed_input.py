"""Files of a KID folder that mean nothing: refused with the file, the variable and what would be right, never a traceback."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg.errors import InputError, NamelistError
from riftberg.kid.run import load_case

from .conftest import namelist_text, restart_variables, write_case

COUNTER = "iceberg_counter_grd"
ICE = ("Time", "zaxis_1", "yaxis_1", "xaxis_1")


def written(path: Path, **variables: tuple[Any, tuple[str, ...]]) -> Path:
    """Write variables with their dimensions, of any type."""
    with netCDF4.Dataset(path, "w") as dataset:
        for name, (values, dimensions) in variables.items():
            array = np.asarray(values)
            for dimension, size in zip(dimensions, array.shape, strict=True):
                if dimension not in dataset.dimensions:
                    dataset.createDimension(dimension, size)
            kind = str if array.dtype.kind in "OU" else array.dtype
            dataset.createVariable(name, kind, dimensions)[...] = array
    return path


def stores(*shape: int, value: float = 0.0) -> np.ndarray:
    return np.full(shape, value)


GOOD = stores(1, 10, 20, 20), ICE
PLANE = ("Time", "yaxis_1", "xaxis_1")
CALVING: dict[str, tuple[dict[str, Any], str]] = {
    "one dimension": ({"stored_ice": (stores(4000), ("i",))}, r"shape \(4000,\), expected \(10, 20, 20\)"),
    "three classes": ({"stored_ice": (stores(1, 3, 20, 20), ICE)}, r"shape \(1, 3, 20, 20\), expected \(10, 20, 20\)"),
    # of the same class
    "no dimension": ({"stored_ice": (np.float64(1.0), ())}, r"shape \(\), expected"),
    "no class": ({"stored_ice": (stores(1, 0, 20, 20), ICE)}, r"shape .*, expected"),
    "another grid": ({"stored_ice": (stores(1, 10, 20, 19), ICE)}, r"shape \(1, 10, 20, 19\)"),
    "two moments": ({"stored_ice": (stores(2, 10, 20, 20), ICE)}, r"shape \(2, 10, 20, 20\)"),
    "text": ({"stored_ice": (np.full((1, 10, 20, 20), "x"), ICE)}, "variable stored_ice: holds text, not numbers"),
    "NaN": ({"stored_ice": (stores(1, 10, 20, 20, value=np.nan), ICE)}, "the first nan in row 1, column 1"),
    "negative ice": ({"stored_ice": (stores(1, 10, 20, 20, value=-1.0), ICE)}, "the first -1 in row 1"),
    "no ice": ({"stored_heat": (stores(1, 20, 20), PLANE)}, "no variable 'stored_ice'"),
    "counter of one dimension": ({"stored_ice": GOOD, COUNTER: (stores(7), ("i",))}, "variable iceberg_counter_grd: shape"),
    "counter below 0": ({"stored_ice": GOOD, COUNTER: (stores(1, 20, 20, value=-3), PLANE)}, "a count below 0"),
    "half a berg": ({"stored_ice": GOOD, COUNTER: (stores(1, 20, 20, value=0.5), PLANE)}, "no whole number"),
    "counter beyond 32 bits": ({"stored_ice": GOOD, COUNTER: (stores(1, 20, 20, value=2.0**40), PLANE)}, "no whole"),
    "heat of another grid": ({"stored_ice": GOOD, "stored_heat": (stores(3, 3), ("y", "x"))}, "stored_heat: shape"),
}  # fmt: skip


@pytest.mark.quick(10)
@pytest.mark.parametrize("what", CALVING)
@pytest.mark.parametrize("melts", [False, True])
def test_a_malformed_calving_restart_is_refused(case: Path, what: str, melts: bool) -> None:
    """Whether it is read for the ice alone, or for the counters of a run that makes bergs."""
    variables, words = CALVING[what]
    written(case / "INPUT" / "calving.res.nc", **variables)
    if melts:
        (case / "input.nml").write_text(namelist_text({"sst": 2.0}, {"set_melt_rates_to_zero": False}))
    with pytest.raises(InputError, match=f"calving.res.nc.*{words}"):
        load_case(case)


Change = Callable[[dict[str, Any]], Any]
BERGS: dict[str, tuple[Change, str]] = {
    "lon in words": (lambda v: v.update(lon=np.array(["five", "six"])), "variable lon: holds text, not numbers"),
    "mass in letters": (lambda v: v.update(mass=np.array([b"a", b"b"])), "variable mass: holds text"),
    "start_year in words": (lambda v: v.update(start_year=np.array(["MMXX", "MMXXI"])), "variable start_year: holds text"),
    "whole numbers beyond 32 bits": (lambda v: v.update(start_year=np.array([2**40, 1])), "whole number of 32 bits"),
    "half a year": (lambda v: v.update(start_year=np.array([1.5, 1.0])), "start_year = 1.5 of record 1"),
    "infinite speed": (lambda v: v.update(uvel=np.array([np.inf, 0.0])), "uvel = inf of record 1"),
    "speeds in cm/s": (lambda v: v.update(uvel=np.array([22.0, 22.0])), "uvel = 22 of record 1 is not a speed of ice"),
}  # fmt: skip


@pytest.mark.parametrize("what", BERGS)
def test_a_malformed_berg_restart_is_refused(case: Path, what: str) -> None:
    change, words = BERGS[what]
    variables = restart_variables()
    change(variables)
    written(case / "INPUT" / "icebergs.res.nc", **{name: (values, ("i",)) for name, values in variables.items()})
    with pytest.raises(InputError, match=words):
        load_case(case)


def test_variables_of_other_shapes_are_refused(case: Path) -> None:
    variables = {name: (values, ("i",)) for name, values in restart_variables().items()}
    for other in ((np.zeros((2, 2)), ("i", "k")), (np.float64(1.0), ()), (np.zeros(3), ("k",))):
        written(case / "INPUT" / "icebergs.res.nc", **{**variables, "thickness": other})
        with pytest.raises(InputError, match=r"variable thickness: shape \(.*expected \(2,\)"):
            load_case(case)


def test_packed_numbers_are_unpacked(case: Path) -> None:
    """A restart that was packed would else begin with bergs of another size."""
    variables = {name: (values, ("i",)) for name, values in restart_variables().items()}
    path = written(case / "INPUT" / "icebergs.res.nc", **variables)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset["thickness"][:] = 2000.0
        dataset["thickness"].scale_factor = 0.1
    np.testing.assert_allclose(load_case(case).model.elements.thickness, 200.0)


BONDS: dict[str, tuple[Change, str]] = {
    "identifiers in words": (lambda v: v.update(first_id_cnt=np.array(["a", "b"])), "variable first_id_cnt: holds text"),
    "half an identifier": (lambda v: v.update(other_id_ij=np.array([0.5, 1.0])), "other_id_ij = 0.5 of record 1"),
    "two dimensions": (lambda v: v.update(first_id_ij=np.zeros((2, 2), "i4")), "variable first_id_ij: shape"),
    "stress in letters": (lambda v: v.update(nstress=np.array([b"x", b"y"])), "variable nstress: holds text"),
}  # fmt: skip


@pytest.mark.parametrize("what", BONDS)
def test_a_malformed_bond_restart_is_refused(case: Path, what: str) -> None:
    change, words = BONDS[what]
    ids = np.array([load_case(case).model.elements.id[k] for k in (0, 1)])
    cnt, ij = ids >> 32, ids & 0xFFFFFFFF
    variables: dict[str, Any] = {
        "first_id_cnt": cnt, "first_id_ij": ij, "other_id_cnt": cnt[::-1], "other_id_ij": ij[::-1], "nstress": np.zeros(2),
    }  # fmt: skip
    change(variables)
    dimensions = {name: ("i", "k")[: np.asarray(values).ndim] for name, values in variables.items()}
    written(case / "INPUT" / "bonds_iceberg.res.nc", **{n: (v, dimensions[n]) for n, v in variables.items()})
    (case / "input.nml").write_text(namelist_text(None, {"manually_initialize_bonds": False}))
    with pytest.raises(InputError, match=rf"bonds_iceberg.res.nc.*{words}"):
        load_case(case)


def many(text: str, count: int) -> str:
    return namelist_text().replace(
        "&icebergs_nml\n", "&icebergs_nml\n" + "\n".join(text.format(k=k) for k in range(count)) + "\n"
    )


LONG = {
    "unknown entries": (lambda: many("u{k}=1", 45_000), "unknown entry 'u0'"),
    "one entry again and again": (lambda: many("dem=T", 80_000), "80022 assignments, 80001 of them to dem"),
    "a list given number by number": (lambda: many("mass_scaling(3)=1", 24_000), "24000 of them to mass_scaling"),
    "a list without end": (lambda: many("mass_scaling=" + "1," * 90_000, 1), "is not a list of at most 10 numbers"),
    "a name of half a million letters": (lambda: many("x" * 450_000 + "=1", 1), "unknown entry 'xxxx"),
}  # fmt: skip


@pytest.mark.quick(2)
@pytest.mark.parametrize("what", LONG)
def test_long_namelists_are_refused_at_once(case: Path, what: str) -> None:
    text, words = LONG[what]
    (case / "input.nml").write_text(text())
    began = time.perf_counter()
    with pytest.raises(NamelistError, match=words) as caught:
        load_case(case)
    assert time.perf_counter() - began < 20.0  # it took minutes
    assert len(str(caught.value)) < 1000


TYPES = {
    "spring_coef": ("'soft'", "spring_coef = 'soft' is not a finite number"),
    "mts_sub_steps": (".true.", "mts_sub_steps = True is not a whole number"),
    "max_bonds": ("4.5", "max_bonds = 4.5 is not a whole number"),
    "dem": ("7", "dem = 7 is not a logical"),
    "Lx": ("1, 2, 3", r"Lx = \[1, 2, 3\] is not a single value"),
    "h_to_init_grounding": ("(1.0, 2.0)", "h_to_init_grounding = .* is not a finite number"),
    "dem_spring_coef": ("NaN", "dem_spring_coef = .* is not a finite number"),
    "traj_sample_hrs": ("1e999", "traj_sample_hrs = .* is not a finite number"),
}


@pytest.mark.parametrize("name", TYPES)
def test_values_of_another_type_are_refused(tmp_path: Path, name: str) -> None:
    value, words = TYPES[name]
    case = write_case(tmp_path / "case")
    lines = (case / "input.nml").read_text().splitlines()
    changed = [f"  {name} = {value}" if line.split("=")[0].strip() == name else line for line in lines]
    assert changed != lines
    (case / "input.nml").write_text("\n".join(changed))
    with pytest.raises(NamelistError, match=words):
        load_case(case)
