"""Whole runs with their files, side by side in threads, processes and dask workers: the same bits as in turn."""

from __future__ import annotations

import ast
import hashlib
import multiprocessing
import os
import pickle
import subprocess
import sys
import textwrap
import threading
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import riftberg
from riftberg import A68A_2022, Forcing, Iceberg, Model, open_run
from riftberg.errors import InputError
from riftberg.kid.run import run_kid
from riftberg.system.netcdf_lock import NETCDF, NetcdfLock, open_lazily, open_netcdf
from riftberg.system.process import own_filters

SOURCES = Path(riftberg.__file__).parent
WEAK = A68A_2022.changed(fracture={"normal_strength": 2e3, "shear_strength": 2e3})
STEPS = 6
MADE_ANEW = ("history", "date_created")


def digest(path: str | Path) -> str:
    """Digest of all values and attributes of a run file."""
    found = hashlib.sha256()
    with open_netcdf(path) as file:
        file.set_auto_mask(False)
        for group in (file, *file.groups.values()):
            for name in sorted(group.ncattrs()):
                if name not in MADE_ANEW:
                    found.update(name.encode() + np.asarray(group.getncattr(name)).tobytes())
            for name, variable in sorted(group.variables.items()):
                values = np.ascontiguousarray(variable[...])
                # The bytes of an array of texts would be those of their addresses.
                found.update(
                    name.encode() + (str(values.tolist()).encode() if values.dtype.hasobject else values.tobytes())
                )
    return found.hexdigest()


def one_run(seed: int, path: str, forcing: Forcing | None = None) -> str:
    """Run a berg that drifts and breaks, save it, resume it, and return the digest of both files."""
    berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, placement=(-37.0, -56.0))
    ocean = forcing or Forcing.uniform(current=(0.3, 0.1), wind=(10.0, -4.0), depth=165.0, slope=(0.0, 0.0))
    model = Model(berg, ocean, WEAK)
    model.elements.u[:] += np.linspace(-0.05, 0.05, model.elements.u.size) * (1 + seed)
    model.run(steps=STEPS, output=path, every_hours=0.5).close()
    again = Model.resume(model.save(f"{path}.restart.nc"), ocean)
    again.run(steps=2, output=f"{path}.more.nc", every_hours=0.5).close()
    return digest(path) + digest(f"{path}.more.nc")


@pytest.fixture(scope="module")
def folder_alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("alone")


@pytest.fixture(scope="module")
def alone(folder_alone: Path) -> list[str]:
    """Digests of three runs, one after the other."""
    return [one_run(seed, str(folder_alone / f"alone{seed}.nc")) for seed in range(3)]


@pytest.mark.parametrize("threads", [4, pytest.param(2, marks=pytest.mark.slow)])
def test_runs_with_output_in_threads(tmp_path: Path, alone: list[str], threads: int) -> None:
    """Two runs in two threads crashed inside netCDF, every time."""
    assert len(set(alone)) == 3
    with ThreadPoolExecutor(threads) as pool:
        together = list(pool.map(one_run, range(3), [str(tmp_path / f"{seed}.nc") for seed in range(3)]))
    assert together == alone


@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
def test_runs_with_output_in_processes(tmp_path: Path, alone: list[str], start: str) -> None:
    if start not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system cannot {start}")
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(start)) as pool:
        together = list(pool.map(one_run, range(2), [str(tmp_path / f"{seed}.nc") for seed in range(2)]))
    assert together == alone[:2]


def _reading(path: Path, stop: threading.Event) -> None:
    while not stop.is_set():
        with open_lazily(path) as ds:
            ds["lon"].values  # noqa: B018


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_process_forked_while_another_thread_reads_can_read_too(alone: list[str], folder_alone: Path) -> None:
    """It would inherit a lock that nobody gives back."""
    file, stop = folder_alone / "alone0.nc", threading.Event()
    thread = threading.Thread(target=_reading, args=(file, stop))
    thread.start()
    try:
        for trial in range(3):
            with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
                assert pool.submit(digest, file).result(60) in alone[0], trial
    finally:
        stop.set()
        thread.join()


@pytest.mark.slow
@pytest.mark.parametrize(
    "processes", [pytest.param(False, id="threads"), pytest.param(True, id="processes", marks=pytest.mark.slow)]
)
@pytest.mark.filterwarnings("ignore")
def test_runs_with_output_in_dask_workers(tmp_path: Path, alone: list[str], processes: bool) -> None:
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2 if processes else 1, "threads_per_worker": 1 if processes else 3}
    with (
        distributed.LocalCluster(processes=processes, dashboard_address=None, **options) as cluster,
        distributed.Client(cluster) as client,
    ):
        tasks = client.map(one_run, range(3), [str(tmp_path / f"{seed}.nc") for seed in range(3)], pure=False)
        assert client.gather(tasks) == alone


def field_file(path: Path) -> Path:
    """Write hourly currents of 20 x 30 points that differ from hour to hour, in compressed chunks."""
    hours, lat, lon = np.arange(48), np.linspace(-58.0, -54.0, 20), np.linspace(-40.0, -34.0, 30)
    wave = np.sin(0.3 * hours[:, None, None] + lat[:, None] + lon)
    names = {"uo": ("eastward_sea_water_velocity", 0.3), "vo": ("northward_sea_water_velocity", 0.2)}
    ds = xr.Dataset(
        {
            name: (("time", "latitude", "longitude"), size * wave, {"units": "m s-1", "standard_name": standard})
            for name, (standard, size) in names.items()
        },
        {
            "time": ("time", hours, {"units": "hours since 2020-12-09 00:00:00", "standard_name": "time"}),
            "latitude": ("latitude", lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "longitude": ("longitude", lon, {"units": "degrees_east", "standard_name": "longitude"}),
        },
    )
    ds.to_netcdf(path, encoding={name: {"zlib": True, "chunksizes": (1, 20, 30)} for name in names})
    return path


EXPERIMENT = """
start: 2020-12-09 13:00
days: 0.5
berg:
  rectangle: {length: 18 km, width: 9 km}
  placement: [-37, -56]
  thickness: 200 m
forcing:
  kind: files
  files: [FIELDS]
  longitude: [-38.5, -35.5]
  latitude: [-57, -55]
"""


def from_files(number: int, folder: str) -> str:
    """Build an experiment on currents from a file, and run it."""
    from riftberg import Options, build

    model, _ = build(str(Path(folder) / "case.yaml"), Options(data=Path(folder)))
    path = Path(folder) / f"from_files_{threading.get_ident()}_{number}.nc"
    model.run(steps=6, output=path).close()
    return digest(path)


def test_forcing_files_are_read_from_several_threads(tmp_path: Path) -> None:
    field_file(tmp_path / "currents.nc")
    (tmp_path / "case.yaml").write_text(EXPERIMENT.replace("FIELDS", "currents.nc"))
    alone = from_files(0, str(tmp_path))
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(from_files, range(1, 5), [str(tmp_path)] * 4)) == {alone}


def test_one_forcing_is_shared_by_models_in_threads(tmp_path: Path) -> None:
    """Each model reads records of its own times from the one forcing, whose blocks of records all of them use."""
    from riftberg import Options, build

    field_file(tmp_path / "currents.nc")
    (tmp_path / "case.yaml").write_text(EXPERIMENT.replace("FIELDS", "currents.nc"))
    shared = build(str(tmp_path / "case.yaml"), Options(data=tmp_path))[0].forcing

    def run(lon: float, name: str) -> str:
        berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, placement=(lon, -56.0))
        path = tmp_path / name
        Model(berg, shared, WEAK, datetime(2020, 12, 9, 13)).run(steps=STEPS, output=path).close()
        return digest(path)

    places = [-37.3, -37.0, -36.7, -36.4]
    alone = [run(lon, f"alone{lon}.nc") for lon in places]
    assert len(set(alone)) == 4
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(run, places, [f"shared{lon}.nc" for lon in places])) == alone


@pytest.mark.slow
def test_filters_of_warnings_are_what_they_were_after_threads(tmp_path: Path) -> None:
    """Where the blocks of two threads overlapped, the second put back for ever what the first had set."""
    from riftberg import open_product

    path = field_file(tmp_path / "currents.nc")

    def read(number: int) -> float:
        return float(open_product(path)["uo"].isel(time=number).sum())

    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(read, [number % 6 for number in range(36)]))
    assert found[:6] == found[6:12] == found[30:]
    # Those of other libraries' own overlapping blocks are theirs to put back.
    ours = ("Ambiguous reference date", "Unable to decode time", "has multiple fill values", "consolidated metadata")
    assert [entry for entry in warnings.filters if entry[1] and any(word in entry[1].pattern for word in ours)] == []


@pytest.mark.parametrize("foreign_ends_first", [False, True])
def test_filters_end_with_their_block_whatever_another_library_puts_back(foreign_ends_first: bool) -> None:
    foreign, before = warnings.catch_warnings(), list(warnings.filters)
    with own_filters():
        warnings.filterwarnings("ignore", message="of ours")
        foreign.__enter__()
        if foreign_ends_first:
            foreign.__exit__()
    if not foreign_ends_first:
        assert not any(entry[1] and "of ours" in entry[1].pattern for entry in warnings.filters)
        foreign.__exit__()
    assert list(warnings.filters) == before


@pytest.mark.slow
def test_lazy_data_of_the_program_itself_stay_apart_from_runs(tmp_path: Path, alone: list[str]) -> None:
    """Datasets that were opened by xarray as they are, with and without dask, are read while runs write."""
    own = field_file(tmp_path / "currents.nc")
    plain, chunked = xr.open_dataset(own), xr.open_dataset(own, chunks={"time": 1})
    with ThreadPoolExecutor(4) as pool:
        sums = [pool.submit(lambda ds=ds: float(ds["uo"].isel(time=slice(0, 40)).sum())) for ds in (plain, chunked)]
        runs = [pool.submit(one_run, seed, str(tmp_path / f"{seed}.nc")) for seed in range(2)]
        assert [run.result() for run in runs] == alone[:2]
        assert sums[0].result() == pytest.approx(sums[1].result())
    plain.close()
    chunked.close()


def kid_digest(case: Path, output: str) -> str:
    files = run_kid(case, Path(output)).files
    return "".join(digest(path) for path in files)


@pytest.mark.slow
def test_kid_runs_in_threads(tmp_path: Path) -> None:
    from kid.conftest import write_case

    case = write_case(tmp_path / "case", {"ibhrs": 24}, {"traj_write_hrs": 1.0, "mts_sub_steps": 40})
    alone = kid_digest(case, str(tmp_path / "alone.nc"))
    with ThreadPoolExecutor(3) as pool:
        together = set(pool.map(kid_digest, [case] * 3, [str(tmp_path / f"{n}.nc") for n in range(3)]))
    assert together == {alone}


def test_two_runs_into_one_file_are_noticed(tmp_path: Path) -> None:
    class Second:
        """Recorder that starts another run into the same file."""

        def start(self, model: Model) -> None: ...

        def record(self, model: Model) -> None:
            with pytest.raises(InputError, match=r"another run \(process \d+\) is writing this file"):
                one_run(1, str(tmp_path / "run.nc"))

        def finish(self, model: Model) -> None: ...

    berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, placement=(-37.0, -56.0))
    model = Model(berg, Forcing.uniform(current=(0.3, 0.1), depth=500.0, slope=(0.0, 0.0)))
    model.run(steps=2, output=tmp_path / "run.nc", recorders=[Second()]).close()
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]
    one_run(1, str(tmp_path / "run.nc"))  # it is free again
    with open_run(tmp_path) as run:
        assert run.sizes["time"] == STEPS + 1


def test_the_lock_is_one_in_the_process_and_may_be_taken_again() -> None:
    assert pickle.loads(pickle.dumps(NETCDF)) is NETCDF
    assert isinstance(NETCDF, NetcdfLock)
    assert not NETCDF.locked()
    with NETCDF, NETCDF:
        assert NETCDF.locked()
        seen: list[bool] = []
        thread = threading.Thread(target=lambda: seen.append(NETCDF.acquire(blocking=False)))
        thread.start()
        thread.join()
        assert seen == [False]
    assert not NETCDF.locked()


def test_files_are_opened_in_one_place_only() -> None:
    """Anything else would not take the lock."""
    openers = {"Dataset", "MFDataset", "open_dataset", "open_mfdataset", "open_dataarray", "load_dataset", "to_netcdf"}
    allowed = {("system/netcdf_lock.py", "Dataset"), ("system/netcdf_lock.py", "open_dataset")}
    found = set()
    for path in SOURCES.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            owner, name = ast.unparse(node.func.value), node.func.attr
            if name == "open" and owner.endswith("DataStore"):
                found.add((path.relative_to(SOURCES).as_posix(), owner))
            elif name in openers and (name != "Dataset" or owner == "netCDF4"):
                found.add((path.relative_to(SOURCES).as_posix(), name))
    assert found == allowed


COMPILE = """
import sys
import textwrap
from riftberg.compiled.kernels import kernel
from riftberg.state.neighbours import find_pairs
from riftberg.engines.common.forces.sizes import interaction_radius
from riftberg.physics.geometry import separation
import numpy as np
kind = {"0": np.float64, "1": np.float32}[sys.argv[1]]
x = np.arange(6, dtype=kind)
y = np.zeros(6, dtype=kind)
print(find_pairs(x, y, np.zeros(6, np.int64), 1.5, 0, False, 6.4e6, 0.0).partner.tolist())
"""
"""Compiles the search for pairs for single or double precision: other machine code for another signature."""


@pytest.mark.slow
@pytest.mark.parametrize("kinds", ["01", "0101"])
def test_first_compile_in_processes_with_one_cache(tmp_path: Path, kinds: str) -> None:
    """Also for different signatures of one kernel, whose entries share an index: nobody may get the other's code."""
    environment = {**os.environ, "RIFTBERG_CACHE": str(tmp_path / "cache")}

    def started(kind: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", COMPILE, kind]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    for _ in range(2):  # compiling, then from the cache
        running = [started(kind) for kind in kinds]
        answers = [process.communicate(timeout=300) for process in running]
        assert [process.returncode for process in running] == [0] * len(kinds), answers
        assert {answer for answer, _ in answers} == {"[1, 0, 2, 1, 3, 2, 4, 3, 5, 4]\n"[0:]}


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["words.nc", "words.nc4", "words.h5"])
def test_a_file_that_only_looks_like_netcdf_does_not_stop_the_program(tmp_path: Path, name: str) -> None:
    """Bug once: xarray wanted its lock a second time, for ever."""
    (tmp_path / name).write_text("no run at all")
    script = f"""
    from riftberg.system.netcdf_lock import open_lazily
    try:
        open_lazily({str(tmp_path / name)!r})
    except (OSError, ValueError) as error:
        print("refused")
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, timeout=120)
    assert done.stdout == "refused\n", done.stderr
