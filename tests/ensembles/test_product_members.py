"""Products with members of their own: each member of a forecast reads one of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Options, build, forecast, sweep
from riftberg.ensembles.forecast import default_errors, errors_line, forecast_errors
from riftberg.ensembles.vary import read_varied
from riftberg.errors import ForcingError, InputError
from riftberg.experiments.changes import parse_settings
from riftberg.ocean import files_forcing

YAML = """start: 2020-12-09
days: 0.25
forcing: {kind: files, files: [ocean.nc, air.nc], sea_level: geostrophic}
berg: {rectangle: {length: 6 km, width: 3 km}, placement: [-39.2, -55.2], thickness: 200 m}
"""


def fields(names: tuple[str, str], standard: str, values: list[float]) -> xr.Dataset:
    """Return a field of each member that is the same everywhere, to the east."""
    shape = len(values), 3, 9, 9
    east = np.broadcast_to(np.array(values)[:, None, None, None], shape)
    ds = xr.Dataset(
        {name: (("number", "time", "lat", "lon"), data, {"units": "m s-1", "standard_name": f"{way}ward_{standard}"})
         for name, data, way in zip(names, (east, np.zeros(shape)), ("east", "north"), strict=True)},
        coords={"number": ("number", np.arange(len(values)), {"standard_name": "realization"}),
                "time": np.arange("2020-12-08", "2020-12-11", dtype="datetime64[D]").astype("datetime64[ns]"),
                "lat": ("lat", np.linspace(-57.0, -53.0, 9), {"units": "degrees_north"}),
                "lon": ("lon", np.linspace(-41.0, -37.0, 9), {"units": "degrees_east"})},
    )  # fmt: skip
    return ds.isel(number=0, drop=True) if len(values) == 1 else ds


@pytest.fixture
def file(tmp_path: Path) -> Path:
    fields(("uo", "vo"), "sea_water_velocity", [0.1, 0.2, 0.3]).to_netcdf(tmp_path / "ocean.nc")
    fields(("ua", "va"), "wind", [0.0]).to_netcdf(tmp_path / "air.nc")
    (tmp_path / "it.yaml").write_text(YAML)
    return tmp_path / "it.yaml"


def current_of(file: Path, *settings: str) -> float:
    model = build(str(file), Options(changes=parse_settings(settings)))[0]
    model.forcing.sample(model.elements, 0.0)
    return float(model.elements.uo[0])


@pytest.mark.slow
def test_a_run_reads_the_member_that_is_named(file: Path) -> None:
    assert [current_of(file, f"forcing.member={k}") for k in range(3)] == pytest.approx([0.1, 0.2, 0.3])
    with pytest.raises(ForcingError, match=r"3 members of an ensemble .*member: 0 .*riftberg forecast"):
        current_of(file)
    with pytest.raises(ForcingError, match=r"member 3 of files with 3 members\. Give 0 to 2"):
        current_of(file, "forcing.member=3")
    fields(("uo", "vo"), "sea_water_velocity", [0.1]).to_netcdf(file.with_name("ocean.nc"))
    with pytest.raises(ForcingError, match=r"no members\. Leave it out"):
        current_of(file, "forcing.member=0")


def test_files_of_two_ensembles_go_together(file: Path) -> None:
    fields(("ua", "va"), "wind", [1.0, 2.0]).to_netcdf(file.with_name("air.nc"))
    model = build(str(file), Options(changes=parse_settings(["forcing.member=2"])))[0]
    model.forcing.sample(model.elements, 0.0)
    assert (model.elements.uo[0], model.elements.ua[0]) == pytest.approx((0.3, 1.0))


@pytest.mark.slow
def test_members_of_a_forecast_take_those_of_the_product_in_turn(file: Path) -> None:
    line = errors_line(read_varied(forecast_errors(str(file), ())))
    assert line.startswith("Errors: 3 members of the products in turn; wind 2 m/s")
    assert "current 0.1" not in line  # their spread is the error of the current
    result = forecast(file, ["wind_error.speed=0"], members=5, workers=0, every_hours=6)
    assert result["status"].values.tolist() == [0] * 5
    taken = result["forcing_member"].values.astype(int).tolist()
    assert sorted(taken[:3]) == [0, 1, 2]
    assert len(set(taken[3:])) == 2
    way = (result["lon"].isel(fragment=0, time=-1) - result["lon"].isel(fragment=0, time=0)).values
    way = way[[taken.index(k) for k in range(3)]]
    assert way[1] - way[0] == pytest.approx(way[2] - way[1], rel=0.1)
    assert way[2] > way[1] > way[0] > 0.0
    control = result["control_lon"].isel(control_fragment=0).values
    assert control[-1] - control[0] == pytest.approx(way[0], rel=0.05)  # the first member of the product
    swept = sweep(file, "forcing.member=0,2", workers=0, every_hours=6)
    assert swept["status"].values.tolist() == [0, 0]


def test_files_without_members_keep_the_errors(file: Path) -> None:
    fields(("uo", "vo"), "sea_water_velocity", [0.1]).to_netcdf(file.with_name("ocean.nc"))
    assert default_errors(str(file))[0].text.startswith("current 0.1 m/s")


def test_a_member_below_zero_is_refused(file: Path) -> None:
    with pytest.raises(InputError, match="member"):
        current_of(file, "forcing.member=-1")


def test_members_read_no_file_again_and_come_to_the_same(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[object] = []
    whole = files_forcing.forcing_from_files

    def counted(*given: Any) -> Any:
        read.append(given)
        return whole(*given)

    monkeypatch.setattr(files_forcing, "forcing_from_files", counted)
    vary = {"start.thickness": [0.9, 1.0, 1.1], "berg.lattice_angle": [0.0, 30.0], "forcing.member": [0, 1]}
    found = sweep(file, vary, workers=0)
    # Two while the sweep is planned, for its first and last member; then once for each member of the product.
    assert len(read) == 2 + 2
    assert not files_forcing._SHARED
    monkeypatch.setattr(files_forcing, "MOST_KEPT", 0)
    xr.testing.assert_identical(found.drop_vars("wall_time"), sweep(file, vary, workers=0).drop_vars("wall_time"))
    assert len(read) == 4 + 2 + 12


def test_of_two_ensembles_the_larger_one_is_run_through(file: Path) -> None:
    """The members of the smaller one begin anew."""
    fields(("ua", "va"), "wind", [1.0, 2.0]).to_netcdf(file.with_name("air.nc"))
    said = [error for error in default_errors(str(file)) if "members of the products" in str(error)]
    assert len(said) == 1
    assert "3 members of the products in turn" in str(said[0])
    assert "each(0, 1, 2)" in str(said[0])
