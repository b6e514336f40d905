"""Files that leave the house are read by others: texts of a fixed length only, for of other ones plain xarray dies."""

from __future__ import annotations

import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from fakes import FakeModel
from riftberg import open_run, open_sweep
from riftberg.ensembles.member import Outcome
from riftberg.ensembles.result import build_dataset, write_blocks, write_sweep
from riftberg.ensembles.vary import Varied
from riftberg.runs.run_file import RunWriter
from riftberg.system.netcdf_lock import write_dataset

START = datetime(2020, 12, 9)
ABOUT = {"title": "Größe", "experiment": "e", "parts": ["crack", "floor of the sea"]}


def result(first: int, texts: list[str]) -> xr.Dataset:
    """Return a block of a sweep whose members failed for a reason, with a text that is varied."""
    outcomes = {k: Outcome(k, "failed", text) for k, text in enumerate(texts)}
    varied = [Varied("berg.offset", ([0, 0], [1, 2]), "", "offset")]
    members = [{"berg.offset": [first, k]} for k in range(len(texts))]
    ds = build_dataset(varied, members, outcomes, start=START, days=1.0, every=21600.0, latlon=True, attributes=ABOUT)  # type: ignore[arg-type]
    return ds.assign_coords(member=("member", first + ds["member"].values, ds["member"].attrs))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return one file of each writer: a sweep in blocks, one at once, a dataset with lists of texts, a run, a restart."""
    folder = tmp_path_factory.mktemp("files")
    paths = {name: folder / f"{name}.nc" for name in ("blocks", "sweep", "dataset", "run", "restart")}
    write_blocks([result(0, ["", "short"]), result(2, ["längst: " + "x" * 200])], paths["blocks"], 208 + 1)
    write_sweep(result(0, ["ä", ""]), paths["sweep"])
    names = xr.DataArray(["first", "zweite Größe"], dims="input", attrs={"long_name": "Größe", "kinds": ["a", "b"]})
    write_dataset(
        xr.Dataset({"input": names, "empty": ("nothing", np.zeros(0)), "label": "µ"}, attrs=ABOUT), paths["dataset"]
    )
    model = FakeModel()
    writer = RunWriter(
        paths["run"], experiment="Größe", origin={"experiment_file": "title: 南極\n"},
        derived={"speed": ("µm s-1", lambda model: model.elements.u)},
    )  # fmt: skip
    model.advance(0.3, recorders=[writer])
    model.save(paths["restart"])
    return paths


COMPARED = """
import sys, itertools
import numpy as np, xarray as xr
assert not any(name.startswith("riftberg") for name in sys.modules)
first = xr.open_dataset(sys.argv[1])
for _ in range(int(sys.argv[2])):
    for a, b in itertools.combinations(sys.argv[3:], 2):
        one, two = xr.open_dataset(a), xr.open_dataset(b)
        for name in one.variables:
            if name in two:
                np.array_equal(one[name].values, two[name].values)
assert not any(name.startswith("riftberg") for name in sys.modules)
print("compared", first.title)
"""


def test_plain_xarray_compares_our_files_as_often_as_it_likes(files: dict[str, Path]) -> None:
    """It died of SIGSEGV at the second pair, each time (netcdf-c issue 2510)."""
    names = [str(path) for path in files.values()]
    ended = subprocess.run(
        [sys.executable, "-c", COMPARED, names[0], "2", *names], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == "compared Größe\n"


LISTED = """
import sys, h5py
def look(name, thing):
    for key in thing.attrs:
        kind = thing.attrs.get_id(key).get_type()
        if not key.startswith(("_Netcdf4", "REFERENCE_LIST", "DIMENSION_LIST", "CLASS", "NAME")):
            if isinstance(kind, h5py.h5t.TypeVlenID) or (isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str()):
                print(name, key)
    if isinstance(thing, h5py.Dataset) and h5py.check_string_dtype(thing.dtype) and thing.dtype.kind == "O":
        print(name)
for path in sys.argv[1:]:
    with h5py.File(path) as file:
        look(path, file)
        file.visititems(lambda name, thing: look(f"{path} {name}", thing))
print("all")
"""


def test_no_text_has_any_length_it_likes(files: dict[str, Path]) -> None:
    """Neither a variable nor an attribute, be it a list, or of letters beyond ASCII."""
    pytest.importorskip("h5py")
    names = [str(path) for path in files.values()]
    ended = subprocess.run([sys.executable, "-c", LISTED, *names], capture_output=True, text=True, check=True)
    assert ended.stdout == "all\n"


def test_texts_come_back_as_they_were(files: dict[str, Path]) -> None:
    blocks = open_sweep(files["blocks"])
    assert blocks["message"].values.tolist() == ["", "short", "längst: " + "x" * 200]
    assert blocks["berg_offset"].values.tolist() == ["[0, 0]", "[0, 1]", "[2, 0]"]
    assert blocks.attrs["title"] == "Größe"
    assert blocks.attrs["parts"] == "crack; floor of the sea"
    with xr.open_dataset(files["dataset"]) as ds:
        assert ds["input"].values.tolist() == ["first", "zweite Größe"]
        assert (ds["input"].attrs["kinds"], ds["label"].item(), ds.sizes["nothing"]) == ("a b", "µ", 0)
    with open_run(files["run"]) as run:
        assert run.attrs["experiment_file"] == "title: 南極\n"
        assert run["speed"].attrs["units"] == "µm s-1"


def changed_in(path: Path, values: Any) -> None:
    """Flip one bit in the bytes of an array of a file."""
    raw, wanted = bytearray(path.read_bytes()), np.ascontiguousarray(values).tobytes()
    assert raw.count(wanted) == 1
    raw[raw.index(wanted) + len(wanted) // 2] ^= 4
    path.write_bytes(raw)


@pytest.mark.parametrize(
    ("name", "variable"), [("run", "strength"), ("run", "mass"), ("run", "tracks/mass"), ("dataset", "size")]
)
def test_a_flipped_bit_in_an_array_is_no_value(
    files: dict[str, Path], tmp_path: Path, name: str, variable: str
) -> None:
    import netCDF4

    path = tmp_path / "flipped.nc"
    if name == "dataset":
        write_dataset(xr.Dataset({"size": ("x", np.linspace(1.0, 2.0, 100))}), path)
    else:
        path.write_bytes(files[name].read_bytes())
    with netCDF4.Dataset(path) as file:
        values = np.asarray(file[variable][:])
    changed_in(path, values)
    with netCDF4.Dataset(path) as file, pytest.raises(RuntimeError, match="HDF error"):
        file[variable][:]
    if variable == "mass":
        from riftberg.errors import InputError

        with pytest.raises(InputError, match=r"flipped\.nc"):
            open_run(path)
