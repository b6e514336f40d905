"""Passwords, tokens and signed links reach no file, no message and no log; who makes a run again is asked for them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg.cli.main import app
from riftberg.errors import ForcingError, InputError, without_secrets
from riftberg.experiments.changes import origin
from riftberg.products import open_all
from riftberg.system import input_files
from riftberg.system.process import say

SECRET = "s3cretPW"
ADDRESSES = {
    f"https://user:{SECRET}@host/x.zarr": "https://***@host/x.zarr",
    f"https://{SECRET}@host/x.zarr": "https://***@host/x.zarr",
    f"https://user:at@{SECRET}@host/x.zarr": "https://***@host/x.zarr",
    f"s3://KEY:{SECRET}@bucket/x.zarr": "s3://***@bucket/x.zarr",
    f"simplecache::https://u:{SECRET}@host/x.zarr": "simplecache::https://***@host/x.zarr",
    f"https://host/x.zarr?token={SECRET}": "https://host/x.zarr?token=***",
    f"https://host/x.zarr?v=1&X-Amz-Signature={SECRET};sig={SECRET}": "https://host/x.zarr?v=***&X-Amz-Signature=***;sig=***",
    f"https://host/x.zarr?{SECRET}": "https://host/x.zarr?***",
    f"https://host/x.zarr#{SECRET}": "https://host/x.zarr#***",
    f"https://host/x.zarr#token={SECRET}": "https://host/x.zarr#token=***",
    f"https://host/x.zarr;jsessionid={SECRET}?v=1": "https://host/x.zarr;jsessionid=***?v=***",
    f"https://user:a/{SECRET}@host/x.zarr": "https://***@host/x.zarr",
    f"https://user:a'{SECRET}@host:80/x.zarr": "https://***@host:80/x.zarr",
    f"https:/user:{SECRET}@host/x.zarr": "https:/***@host/x.zarr",
    f"http:///user:{SECRET}@[::1]/x.zarr": "http:///***@[::1]/x.zarr",
}


@pytest.fixture(autouse=True)
def nothing_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(input_files, "_WHOLE", {})
    monkeypatch.delenv("RIFTBERG_ADDRESSES", raising=False)


@pytest.mark.parametrize(("address", "cut"), ADDRESSES.items())
def test_what_is_secret_is_cut_from_an_address_wherever_it_stands(address: str, cut: str) -> None:
    for text in ("{}", "forcing: [{}]", 'a "{}", and b', "{}: cannot be opened (401)", "[{}, other.nc]  # {}"):
        assert without_secrets(text.format(address, address)) == text.format(cut, cut)
    assert without_secrets(cut) == cut


@pytest.mark.parametrize(
    "text",
    ["https://host/a/b.nc#mode=bytes", "https://doi.org/10.1126/sciadv.abq6974", "C: the token is missing", "run.nc#3",
     "Check user name and password at https://urs.earthdata.nasa.gov; tokens expire", "a@b.c", "data/*?.nc",
     "https://host:8443/a@b.nc", "C:/data/a@b.nc", "see https://host/a; token a@b.c", "https://host/a.nc and me@host.org"],
)  # fmt: skip
def test_what_is_no_secret_stays(text: str) -> None:
    assert without_secrets(text) == text


@pytest.mark.parametrize(
    "text",
    [
        f"Authorization: Bearer {SECRET}",
        f"{{'aws_secret_access_key': '{SECRET}'}}",
        f"password={SECRET}",
        f'"token": "{SECRET}"',
    ],
)
def test_what_is_called_a_secret_is_cut(text: str) -> None:
    assert SECRET not in without_secrets(text)
    assert without_secrets(without_secrets(text)) == without_secrets(text)
    assert SECRET not in str(InputError(text, where=text, remedy=text))


def test_nothing_that_is_said_or_kept_of_a_run_has_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for address, cut in ADDRESSES.items():
        say(f"Go on with: riftberg run {address}")
        assert cut in capsys.readouterr().err
        file = tmp_path / "sea.yaml"
        file.write_text(f'name: sea\nforcing: ["{address}", floor.nc]\n')
        kept = origin(str(file), ["--names", address], [f"forcing.files={address}"], None, tmp_path)
        assert SECRET not in str(kept)
        assert f'forcing: ["{cut}", floor.nc]' in kept["experiment_file"]


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Serve a sea at whatever address; return the addresses that were asked for."""
    asked: list[str] = []
    axes = {"time": ("time", np.arange(3.0), {"units": "days since 2020-12-09"}),
            "lat": ("lat", np.arange(-57.0, -54.0), {"units": "degrees_north"}),
            "lon": ("lon", np.arange(-39.0, -35.0), {"units": "degrees_east"})}  # fmt: skip
    field: Any = {name: (("time", "lat", "lon"), np.full((3, 3, 4), 0.1), {"units": "m s-1", "standard_name": long})
                  for name, long in (("uo", "eastward_sea_water_velocity"), ("vo", "northward_sea_water_velocity"))}  # fmt: skip

    def opened(place: str, **options: Any) -> xr.Dataset:
        asked.append(place)
        if "gone" in place:
            raise OSError(f"401, message='Unauthorized', url='{place}'")
        return xr.Dataset(field, axes)

    monkeypatch.setattr(xr, "open_zarr", opened)
    return asked


def test_a_store_is_opened_by_the_whole_address_and_known_by_the_rest(
    served: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    whole = f"https://user:{SECRET}@host/x.zarr?token={SECRET}"
    with caplog.at_level(logging.DEBUG):
        (ds,) = open_all([whole])
    assert set(served) == {whole}
    assert ds.attrs["source"] == "https://***@host/x.zarr?token=***"
    assert SECRET not in f"{ds.attrs} {ds.encoding} {caplog.text}"
    result = CliRunner().invoke(app, ["doctor", whole])
    assert "https://***@host" in result.output
    assert SECRET not in result.output


def test_an_error_of_a_library_does_not_tell_it(served: list[str]) -> None:
    whole = f"https://user:{SECRET}@host/gone.zarr"
    with pytest.raises(ForcingError) as caught:
        open_all([whole])
    error: BaseException | None = caught.value
    assert SECRET not in str(error)
    while error is not None and not error.__suppress_context__:
        assert SECRET not in str(error)
        error = error.__cause__
    assert SECRET not in CliRunner().invoke(app, ["doctor", whole]).output


def test_an_address_that_was_cut_is_made_whole_from_the_environment(
    served: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = "https://***@host/x.zarr?token=***"
    with pytest.raises(InputError, match=r"\*\*\*\) were cut .* into the environment variable RIFTBERG_ADDRESSES"):
        open_all([cut])
    whole = f"https://user:{SECRET}@host/x.zarr?token={SECRET}"
    monkeypatch.setenv("RIFTBERG_ADDRESSES", f"https://a:b@other/y.zarr {whole}")
    open_all([cut])
    assert set(served) == {whole}
