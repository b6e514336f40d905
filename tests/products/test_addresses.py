"""Forcing from the network: a Zarr store behind plain HTTP and an OPeNDAP server, both on this machine."""

from __future__ import annotations

import struct
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import build, open_run
from riftberg.cli.main import app
from riftberg.errors import ForcingError
from riftberg.products.reading import is_zarr, open_raw

YAML = """\
start: 2020-12-09
days: 0.25
berg: {{rectangle: {{length: 10 km, width: 5 km}}, placement: [-38, -56]}}
forcing: [{entry}]
"""
STANDARD = {
    "uo": ("eastward_sea_water_velocity", "m s-1"), "vo": ("northward_sea_water_velocity", "m s-1"),
    "zos": ("sea_surface_height_above_geoid", "m"), "ua": ("eastward_wind", "m s-1"), "va": ("northward_wind", "m s-1"),
}  # fmt: skip
TYPES = {"f": ("Float64", "d"), "i": ("Int32", "i")}


def sea() -> xr.Dataset:
    """Currents, sea level and wind that differ from place to place and from day to day."""
    axes = {"time": np.arange(4.0), "lat": np.linspace(-58.0, -54.0, 9), "lon": np.linspace(-41.0, -35.0, 13)}
    day, north, east = np.meshgrid(*axes.values(), indexing="ij")
    values = {"uo": 0.1 + 0.01 * day, "vo": 0.05 + 0.01 * (north + 56.0), "zos": 0.01 * (east + 38.0), "ua": 3.0 + day,
              "va": 1.0 - 0.1 * (east + 38.0)}  # fmt: skip
    fields = {
        name: (tuple(axes), field, dict(zip(("standard_name", "units"), STANDARD[name], strict=True)))
        for name, field in values.items()
    }
    about = {
        "time": {"units": "days since 2020-12-08", "calendar": "standard"},
        "lat": {"units": "degrees_north"},
        "lon": {"units": "degrees_east"},
    }
    return xr.Dataset(fields, {name: (name, axis, about[name]) for name, axis in axes.items()})


class Dap(BaseHTTPRequestHandler):
    """As much of DAP 2 as its clients need: description, attributes, and whole arrays, asked for where these are small."""

    asked: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        address = urlsplit(self.path)
        self.asked.append(self.path)
        kind = address.path.rpartition(".")[2]
        ds = sea()
        asked = [part for part in unquote(address.query).split(",") if part] or list(map(str, ds.variables))
        parts = [(name, ds.variables[name]) for name in asked]
        lines = [
            f"    {TYPES[v.dtype.kind][0]} {n}" + "".join(f"[{d} = {v.sizes[d]}]" for d in v.dims) for n, v in parts
        ]
        described = "Dataset {\n" + "".join(f"{line};\n" for line in lines) + "} sea;\n"
        if kind == "dds":
            body = described.encode()
        elif kind == "das":
            about = [f"  {n} {{\n" + "".join(f'    String {k} "{v}";\n' for k, v in ds[n].attrs.items()) + "  }\n"
                     for n in ds.variables]  # fmt: skip
            body = ("Attributes {\n" + "".join(about) + "}\n").encode()
        else:
            body = (described + "\nData:\n").encode()
            for _, variable in parts:
                count = struct.pack(">i", variable.size)
                body += 2 * count + variable.values.astype(">" + TYPES[variable.dtype.kind][1]).tobytes()
        self.send_response(200)
        self.send_header("XDODS-Server", "dods/2.0")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *values: Any) -> None:
        """Say nothing."""


class Quiet(SimpleHTTPRequestHandler):
    """Files of a folder."""

    def log_message(self, format: str, *values: Any) -> None:
        """Say nothing."""


@contextmanager
def serving(handler: Any) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def track(folder: Path, entry: str) -> np.ndarray:
    """Run an experiment with this forcing, and return longitudes and latitudes."""
    file = folder / "own.yaml"
    file.write_text(YAML.format(entry=entry))
    result = CliRunner().invoke(app, ["run", str(file), "-o", str(folder / "out"), "-q", "--no-map"])
    assert result.exit_code == 0, result.output
    with open_run(folder / "out") as run:
        return np.stack([run["lon"].values, run["lat"].values])


@pytest.fixture
def expected(tmp_path: Path) -> np.ndarray:
    """The track in the same sea from a file in the folder."""
    (tmp_path / "file").mkdir()
    sea().to_netcdf(tmp_path / "file" / "sea.nc")
    return track(tmp_path / "file", "sea.nc")


@pytest.mark.quick(1)
@pytest.mark.parametrize("version", [2, 3])
def test_a_zarr_store_on_the_network_is_a_forcing(tmp_path: Path, expected: np.ndarray, version: int) -> None:
    sea().to_zarr(tmp_path / "sea.zarr", zarr_format=version, consolidated=version == 2)
    with serving(partial(Quiet, directory=str(tmp_path))) as address:
        np.testing.assert_array_equal(track(tmp_path, f"{address}/sea.zarr"), expected)


@pytest.mark.slow
def test_an_opendap_address_is_a_forcing(tmp_path: Path, expected: np.ndarray) -> None:
    Dap.asked.clear()
    with serving(Dap) as address:
        np.testing.assert_array_equal(track(tmp_path, f"{address}/sea"), expected)
        assert any(".dods" in path for path in Dap.asked)
        result = CliRunner().invoke(app, ["doctor", "--for", str(tmp_path / "own.yaml")])
        assert "Ready: the run starts" in result.output, result.output


def test_an_address_takes_names_of_variables(tmp_path: Path) -> None:
    renamed = sea().rename(uo="a", vo="b")
    for name in "ab":
        renamed[name].attrs = {"units": "m s-1"}
    renamed.to_zarr(tmp_path / "sea.zarr", zarr_format=2, consolidated=True)
    with serving(partial(Quiet, directory=str(tmp_path))) as address:
        file = tmp_path / "own.yaml"
        file.write_text(YAML.format(entry=f"{{file: '{address}/sea.zarr', names: {{uo: a, vo: b}}}}"))
        model, _ = build(str(file))
    assert {"uo", "ssh", "ua"} <= {name for part in model.forcing.parts for name in part.gives}


def test_what_is_no_such_address_is_refused_with_a_remedy(tmp_path: Path) -> None:
    sea().to_netcdf(tmp_path / "sea.nc")
    with serving(partial(Quiet, directory=str(tmp_path))) as address:
        for name, remedy in (("sea.nc", "must speak OPeNDAP"), ("none.zarr", "Check the address")):
            with pytest.raises(ForcingError, match=remedy) as told:
                open_raw(f"{address}/{name}")
            assert told.value.where == f"{address}/{name}"


def test_stores_in_buckets_need_no_ending() -> None:
    assert is_zarr("s3://bucket/cmems/time")
    assert is_zarr("gs://bucket/era5")
    assert not is_zarr("https://server/thredds/dodsC/glorys")


def test_references_of_kerchunk_go_to_its_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from riftberg.products import reading

    file = tmp_path / "sea.json"
    file.write_text("{}")
    monkeypatch.setattr(reading, "find_spec", lambda name: None)
    with pytest.raises(ForcingError, match="pip install kerchunk"):
        open_raw(str(file))
    monkeypatch.setitem(sys.modules, "kerchunk", ModuleType("kerchunk"))
    monkeypatch.setattr(reading, "find_spec", lambda name: True)
    given: dict[str, Any] = {}
    monkeypatch.setattr(reading, "open_lazily", lambda path, **options: given.update(options) or sea())
    assert "uo" in open_raw(str(file))
    assert given["engine"] == "kerchunk"
