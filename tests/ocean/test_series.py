"""Forcing along a track: a series in time, the same everywhere."""

from __future__ import annotations

import pickle
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import riftberg
from riftberg import DatasetForcing, Forcing, Iceberg, Model, Options, Parameters, build
from riftberg.constants import DEGREE, EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.grid import haversine
from riftberg.state import Elements, new_elements

START = np.datetime64("2025-10-01T00:00", "us")
HOURS = np.arange(73.0)
SHARE = {"uo": 0.15 + 0.1 * np.sin(HOURS / 1.9), "vo": -0.05 + 0.1 * np.cos(HOURS / 1.9), "ua": 6.0 * np.cos(HOURS / 9.0),
         "va": 3.0 + 0.02 * HOURS}  # fmt: skip


def dates(hours: Any = HOURS) -> Any:
    return START + (np.asarray(hours) * 3600e6).astype("timedelta64[us]")


def made(**changes: Any) -> Any:
    return Forcing.along(dates(), **{**SHARE, **changes})


def sampled(forcing: Any, hours: float, lat: float = -60.0, count: int = 1) -> Elements:
    e = new_elements(count)
    e.place.lon[:], e.place.lat[:], e.body.thickness[:], e.body.id[:] = -36.0, lat, 200.0, np.arange(count) + 1
    forcing.sample(e, 3600.0 * hours)
    return e


def lone(size: float = 1000.0, lat: float = -60.0, **options: Any) -> Iceberg:
    return Iceberg.from_points(
        [-36.0], lat, length=size, width=size, thickness=options.pop("thickness", 200.0), **options
    )


def drifted(
    forcing: Any, hours: float, berg: Iceberg | None = None, parameters: Parameters | None = None
) -> tuple[float, float]:
    """Return how far (km) a berg goes east and north."""
    model = Model(berg or lone(), forcing, parameters)
    lon, lat = float(model.elements.lon[0]), float(model.elements.lat[0])
    model.advance(f"{hours} h")
    place = model.elements.place
    east = np.sign(place.lon[0] - lon) * haversine(lon, lat, place.lon[0], lat, 6.371e6)
    return float(east) / 1e3, float(np.radians(place.lat[0] - lat) * 6371.0)


def test_a_series_drives_a_berg_as_a_grid_of_its_values_does() -> None:
    axes = {"time": dates().astype("datetime64[ns]"), "lat": [-62.0, -60.0, -58.0], "lon": [-40.0, -36.0, -32.0]}
    names = {
        "uo": "eastward_sea_water_velocity",
        "vo": "northward_sea_water_velocity",
        "ua": "eastward_wind",
        "va": "northward_wind",
    }
    grid = xr.Dataset(
        {k: (("time", "lat", "lon"), np.broadcast_to(SHARE[k][:, None, None], (73, 3, 3)).copy(),
             {"standard_name": name, "units": "m s-1"}) for k, name in names.items()}, axes,
    )  # fmt: skip
    assert drifted(made(), 70) == pytest.approx(drifted(DatasetForcing.from_xarray(grid), 70), abs=0.01)
    assert np.hypot(*drifted(made(), 70)) > 20.0


def test_a_mean_holds_over_the_interval_that_ends_at_its_time() -> None:
    day = [0.0, 24.0, 36.0, 60.0]
    forcing = Forcing.along(dates(day), uo=[0.05, 0.1, 0.3, -0.2], vo=0.0, means=True)
    assert [float(sampled(forcing, h).uo[0]) for h in (0.0, 0.1, 23.9, 24.0, 35.9, 36.1, 60.0)] == pytest.approx(
        [0.05, 0.1, 0.1, 0.3, 0.3, -0.2, -0.2]
    )
    forcing = Forcing.along(dates(day), uo=[0.1, 0.1, 0.3, -0.2], vo=0.0, means=True)
    # Water that drags without end carries the berg along: the exact way of its steps.
    frozen = Parameters(drag={"ocean_scale": 1e4})
    assert drifted(forcing, 60, parameters=frozen)[0] == pytest.approx(3.6 * (0.1 * 24 + 0.3 * 12 - 0.2 * 24), rel=0.01)


def test_values_are_linear_between_their_times() -> None:
    e = sampled(Forcing.along(dates([0, 6, 12]), uo=[0.0, 0.6, 0.0], vo=0.1, sst=[1.0, 2.0, 3.0], sss=34.0), 9.0)
    assert (e.uo[0], e.vo[0], e.sst[0], e.sss[0]) == pytest.approx((0.3, 0.1, 2.5, 34.0))


def test_the_slope_of_a_steady_current_has_the_coriolis_parameter_of_each_element() -> None:
    for lat in (-60.0, 75.0):
        e = sampled(Forcing.along(dates(), uo=0.2, vo=-0.1), 30.0, lat)
        f = 2.0 * EARTH_ROTATION * np.sin(lat * DEGREE)
        assert (e.slope_x[0], e.slope_y[0]) == pytest.approx((-0.1 * f / GRAVITY, -0.2 * f / GRAVITY))
    assert not sampled(Forcing.along(dates(), uo=0.2, vo=0.0, sea_level="none"), 30.0).slope_y.any()
    given = sampled(Forcing.along(dates(), uo=0.2, vo=0.0, ssh_slope=(1e-6, np.linspace(0.0, 2e-6, 73))), 36.0)
    assert (given.slope_x[0], given.slope_y[0]) == pytest.approx((1e-6, 1e-6))


@pytest.mark.parametrize(("size", "choice", "way"), [(20e3, "auto", 34.3), (20e3, "none", 0.2), (100.0, "none", 29.8)])
def test_a_square_in_steady_water_goes_as_the_balance_has_it(size: float, choice: Any, way: float) -> None:
    thickness = 250.0 if size > 1e3 else 100.0
    forcing = Forcing.along(dates(), uo=0.2, vo=0.0, sea_level=choice)
    assert drifted(forcing, 48, lone(size, thickness=thickness))[0] == pytest.approx(way, abs=0.6)


def test_a_giant_berg_does_not_resonate_with_inertial_motion() -> None:
    hours = np.arange(0.0, 193.0)
    turn = 2.0 * EARTH_ROTATION * np.sin(60.0 * DEGREE) * 3600.0 * hours
    forcing = Forcing.along(dates(hours), uo=0.05 + 0.1 * np.cos(turn), vo=0.1 * np.sin(turn))
    model, fastest = Model(lone(20e3), forcing), 0.0
    model.after_step.append(lambda m: None)
    for _ in range(192 // 6 - 1):
        model.advance("6 h")
        fastest = max(fastest, float(np.hypot(*model.velocity())[0]))
    assert fastest < 0.2


def test_what_a_series_is_stands_in_its_description_and_the_notice_of_a_run() -> None:
    forcing = made(depth=300.0)
    assert repr(forcing).startswith(
        "<Series: series at 73 times from 2025-10-01 00:00 to 2025-10-04 00:00, uniform in space: uo, vo"
    )
    assert "depth 300 m" in repr(forcing)
    assert forcing.start == datetime(2025, 10, 1)
    assert not forcing.land(np.zeros(2), np.zeros(2)).any()
    (notice,) = Model(lone(), forcing).notices
    assert notice.startswith("no sea level is given")


def test_a_series_adds_with_formulas_and_files_and_takes_one_slope() -> None:
    mount = Forcing.seamount((-36.0, -60.0), 350.0, 5e3, depth=500.0)
    assert sampled(made(depth=300.0) + mount, 0.0).depth[0] == pytest.approx(150.0)
    axes = {"time": dates([0, 72]).astype("datetime64[ns]"), "lat": [-62.0, -60.0, -58.0], "lon": [-40.0, -36.0, -32.0]}
    ramp = np.broadcast_to(np.array([0.0, 0.1, 0.2])[None, :, None], (2, 3, 3)).copy()
    level = xr.Dataset(
        {"zos": (tuple(axes), ramp, {"standard_name": "sea_surface_height_above_geoid", "units": "m"})}, axes
    )
    files = DatasetForcing.from_xarray(level, "2025-10-01", max_gap="4 d")
    alone, both = sampled(files, 10.0), sampled(files + made(), 10.0)
    assert both.slope_y[0] == alone.slope_y[0] != 0.0
    assert both.uo[0] == pytest.approx(SHARE["uo"][10])


def test_waves_go_with_the_wind_and_ice_is_the_densest() -> None:
    e = sampled(made(wave_height=2.0, ice_fraction=0.8, ice_thickness=1.5, ui=0.1, vi=0.0), 0.0)
    assert (e.wave_height[0], e.wave_x[0], e.wave_y[0]) == (2.0, e.ua[0], e.va[0])
    assert (e.ice_fraction[0], e.ice_thickness[0], e.ui[0]) == (0.8, 1.5, 0.1)


def test_series_may_stand_side_by_side_each_with_a_floor_in_its_sector() -> None:
    several = Forcing.along.side_by_side(
        [made(uo=0.1, depth=90.0), Forcing.along([0.0, 7200.0], **dict.fromkeys(SHARE, 0.0))]
    )
    e = sampled(several, 1.0, count=2)
    assert e.uo.tolist() == [0.1, 0.0]
    assert e.depth.tolist() == [90.0, 1e4]
    assert several.depth(np.array([-179.0, -1.0, 1.0, 179.0]), np.zeros(4)).tolist() == [90.0, 90.0, np.inf, np.inf]
    assert e.slope_y[0] != 0.0 == e.slope_y[1]


def test_missing_values_at_the_end_are_no_more_and_may_be_held() -> None:
    short = np.where(HOURS > 40.0, np.nan, 0.1)
    with pytest.raises(
        ForcingError, match=r"2025-10-03 00:00 lies outside the series, which goes from .* to 2025-10-02 16:00"
    ):
        Model(lone(), made(uo=short)).advance("48 h")
    forcing = made(uo=short, hold="8 h")
    forcing.check(new_elements(0), 0.0, 48 * 3600.0)
    assert sampled(forcing, 47.0).uo[0] == 0.1
    with pytest.raises(ForcingError, match="outside"):
        forcing.check(new_elements(0), 0.0, 49 * 3600.0)


def test_dates_a_few_seconds_off_the_start_do() -> None:
    forcing = Forcing.along(dates() + np.timedelta64(31, "s"), uo=0.1, vo=0.0, start="2025-10-01")
    forcing.check(new_elements(0), 0.0, 72 * 3600.0)


ZONED = [f"2025-10-01T0{h}:00+02:00" for h in range(3)]
BAD: list[tuple[Any, dict[str, Any], str]] = [
    ([0.0, 3600.0, 3600.0], {}, "3600.* stands twice.*Sort"),
    (dates([0, 2, 1]), {}, "2025-10-01T01:00:00.* comes after"),
    (ZONED, {}, "another time zone than UTC"),
    ([datetime(2025, 10, 1, h, tzinfo=timezone(timedelta(hours=-3))) for h in range(3)], {}, "another time zone"),
    ([], {}, "no times"),
    (["2025-10-01", "yesterday", "2025-10-03"], {}, "yesterday.*not a date"),
    ([0.0, np.nan, 7200.0], {}, "no number"),
    (dates([0, 1, 2]), {"uo": [0.1, np.nan, 0.2]}, "uo is missing at 2025-10-01 01:00, and given later"),
    (dates([0, 1, 2]), {"va": [np.nan, 1.0, 2.0], "ua": 0.0}, "va is missing at 2025-10-01 00:00"),
    (dates([0, 1, 2]), {"uo": [0.1, 0.2]}, "shape .2,. for 3 times"),
    (dates([0, 1, 2]), {"uo": 20.0}, "uo = 20 is not possible.*-5 to 5"),
    (dates([0, 1, 2]), {"ice_fraction": 80.0}, "ice_fraction = 80"),
    (dates([0, 1, 2]), {"ua": 1.0}, "ua without va"),
    (dates([0, 1, 2]), {"depth": [100.0, 120.0, 90.0]}, "depth of a series is one number, that at the start; a varying"),
    (dates([0, 1, 2]), {"depth": -5.0}, "depth = -5"),
    (dates([0, 1, 2]), {"sea_level": "files"}, "no.*sea level.*ssh_slope"),
    (dates([0, 1, 2]), {"ssh_slope": 1e-6}, "no pair"),
    (["2025-10-01T00+03", "2025-10-01T01+03", "2025-10-01T02+03"], {}, "'2025-10-01T00.03' has another time zone"),
    (["2025-10-01 00:00:00 -0330", "2025-10-01 01:00:00 -0330", "2025-10-02"], {}, "-0330' has another time zone"),
    (pd.date_range("2025-10-01", periods=3, tz="America/Santiago"), {}, "'2025-10-01 00:00:00-03:00' has another time zone"),
    (dates([0, 1, 2]), {"uo": np.ma.masked_less([0.1, -9.0, 0.2], -5.0)}, "uo is missing at 2025-10-01 01:00"),
    (dates([0, 1, 2]), {"uo": [0.1, [0.2, 0.3], 0.4]}, "uo: .0.1, .0.2, 0.3., 0.4. is no array of numbers. Allowed"),
    (dates([0, 1, 2]), {"hold": "-3 h"}, "hold: '-3 h' is no length of time"),
    (dates([0, 1, 2]), {"max_gap": -60.0}, "max_gap: -60.0 is no length of time"),
    (dates([0, 1, 2]), {"latitude": 120.0}, "120.0 is no latitude"),
    (dates([0, 1, 2]), {"ssh_slope": (0.5, 0.0)}, "ssh_slope_x = 0.5"),
]  # fmt: skip


@pytest.mark.parametrize(("times", "values", "said"), BAD)
def test_a_series_that_cannot_be_is_refused_in_a_sentence(times: Any, values: dict[str, Any], said: str) -> None:
    with pytest.raises(ForcingError, match=f"(?s){said}"):
        Forcing.along(times, **{"uo": 0.0, "vo": 0.0, **values})


def test_times_in_utc_may_say_so() -> None:
    forcing = Forcing.along(["2025-10-01T00:00Z", datetime(2025, 10, 1, 6, tzinfo=UTC)], uo=0.0, vo=0.0)
    assert forcing.cover == (0.0, 6 * 3600.0)


def test_a_long_gap_between_times_is_refused_where_a_run_meets_it() -> None:
    hours = [0, 1, 2, 3, 12, 13]
    forcing = Forcing.along(dates(hours), uo=0.0, vo=0.0)
    forcing.check(new_elements(0), 0.0, 3 * 3600.0)
    with pytest.raises(
        ForcingError, match=r"no value between 2025-10-01 03:00 and 2025-10-01 12:00: a gap of 0.375 days.*max_gap"
    ):
        forcing.check(new_elements(0), 0.0, 4 * 3600.0)
    Forcing.along(dates(hours), uo=0.0, vo=0.0, max_gap="9 h").check(new_elements(0), 0.0, 4 * 3600.0)


TABLE = """time,uo,vo,ua,va,depth
2025-10-01 00:00,0.1,0.0,5,0,400
2025-10-01 12:00,0.2,0.0,5,0,
2025-10-02 00:00,0.3,0.0,5,0,
2025-10-02 12:00,,,,,
"""

FILE = """start: 2025-10-01
days: 1
output_every_hours: 6
berg: {rectangle: {length: 800 m, width: 500 m}, thickness: 150 m, placement: [-36, -60]}
forcing: {along: sea.csv}
"""


@pytest.fixture
def experiment(tmp_path: Path) -> Path:
    (tmp_path / "sea.csv").write_text(TABLE)
    (tmp_path / "e.yaml").write_text(FILE)
    return tmp_path / "e.yaml"


@pytest.mark.slow
def test_a_table_is_the_forcing_of_an_experiment_and_of_its_forecast(experiment: Path) -> None:
    model, _ = build(str(experiment), Options())
    assert "12:00" in model.forcing.describe()
    assert "depth 400 m" in model.forcing.describe()
    assert sampled(model.forcing, 6.0).uo[0] == pytest.approx(0.15)
    ds = riftberg.forecast(str(experiment), members=2, workers=0)
    assert np.isfinite(ds["track_lon" if "track_lon" in ds else "lon"].values).any()


def test_a_table_with_a_column_that_is_not_known_is_refused(experiment: Path) -> None:
    for text, said in (("time,uo,vo,u10\n0,0,0,1\n", "a column 'u10'"), ("time,uo\n0,1\n", "no column 'vo'"),
                       ("time,uo,vo\n0,x,0\n", "line 2, uo.*'x' is no number"),
                       ("time,uo,vo\n0,0,1,0\n", "line 2: '0' has no name: 3 columns are named.*decimal comma")):  # fmt: skip
        experiment.with_name("sea.csv").write_text(text)
        with pytest.raises(ForcingError, match=said):
            build(str(experiment))


def test_a_run_that_is_resumed_ends_where_a_whole_one_does(tmp_path: Path) -> None:
    whole = Model(lone(), made())
    whole.advance("24 h")
    first = Model(lone(), made())
    first.advance("12 h")
    again = Model.resume(first.save(tmp_path / "r.nc"), pickle.loads(pickle.dumps(made())))
    again.advance("12 h")
    assert again.elements.lon[0] == whole.elements.lon[0]


def test_a_start_that_is_not_that_of_the_series_is_given_to_both() -> None:
    with pytest.raises(InputError, match="counts its time"):
        Model(lone(), made(), start="2025-10-02")
    model = Model(lone(), made(start="2025-10-02"), start="2025-10-02")
    assert sampled(model.forcing, 0.0).uo[0] == pytest.approx(SHARE["uo"][24])
