"""Several starts of a forecast: earlier dates, positions with error and age, observed outlines."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Options, build, forecast
from riftberg.ensembles.uncertain import read_starts
from riftberg.ensembles.vary import Draws, list_members, read_varied, vary_with_file
from riftberg.errors import InputError
from riftberg.experiments.changes import parse_settings

SPEED_OF_AGE = 0.12

YAML = """start: 2020-12-09 12:00
days: 0.5
forcing: {kind: formula, uniform: {current: [0.3, 0.0]}}
berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39, -55], thickness: 200 m}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "it.yaml").write_text(YAML)
    return tmp_path / "it.yaml"


def starts(folder: Path, text: str) -> Path:
    (folder / "starts.csv").write_text(text)
    return folder / "starts.csv"


def test_members_take_the_starts_in_turn_with_the_errors_of_each(tmp_path: Path) -> None:
    path = starts(tmp_path, "lon,lat,error_km,age_hours\n-39,-55,2,0\n-38.5,-55.5,0,24\n")
    members = list_members(read_varied(read_starts(path)), Draws(400))
    for k in range(0, 400, 2):
        assert {m["berg.placement"] for m in members[k : k + 2]} == {(-39.0, -55.0), (-38.5, -55.5)}
    for lon, spread in ((-39.0, 2000.0), (-38.5, SPEED_OF_AGE * 86400.0)):
        some = [m for m in members if m["berg.placement"][0] == lon]
        for axis in ("start.east", "start.north"):
            assert np.std([m[axis] * m["start.error"] for m in some]) == pytest.approx(spread, rel=0.1)


@pytest.mark.slow
def test_a_lagged_member_starts_earlier_and_is_told_by_the_dates_of_the_forecast(file: Path, tmp_path: Path) -> None:
    path = starts(tmp_path, "date,lon,lat\n2020-12-09 12:00,-39,-55\n2020-12-09 03:00,-39.1,-55.1\n")
    result = forecast(file, {"starts": path}, members=2, default_errors=False, workers=0, every_hours=6)
    assert result["status"].values.tolist() == [0, 0]
    assert str(result["init"].values)[:16] == "2020-12-09T12:00"
    assert result["time"].values[-1] - result["time"].values[0] == np.timedelta64(12, "h")
    assert "comment" not in result["time"].attrs
    lon, lat = (result[name].isel(fragment=0).values for name in ("lon", "lat"))
    assert np.isfinite(lon).all()
    now, earlier = np.argsort(result["start"].values.astype(str))[::-1]
    assert [lon[now, 0], lat[now, 0]] == pytest.approx([-39.0, -55.0], abs=1e-3)
    # The earlier one has drifted for nine hours when the forecast begins.
    settings = parse_settings(["start=2020-12-09 03:00", "berg.placement=[-39.1, -55.1]"])
    model = build(str(file), Options(changes=settings))[0]
    model.advance(0.375)
    there = model.elements.lon.mean(), model.elements.lat.mean()
    assert (lon[earlier, 0], lat[earlier, 0]) == pytest.approx(there, abs=1e-4)
    born = result["fragment_birth_time"].isel(fragment=0).values
    assert born[earlier] - born[now] == np.timedelta64(-9, "h")
    assert result["control_lon"].values[0, 0] == pytest.approx(-39.0, abs=1e-3)


def test_starts_after_the_forecast_or_long_before_are_refused(file: Path, tmp_path: Path) -> None:
    for date, words in (
        ("2020-12-10", "a member starts on 2020-12-10 00:00, the forecast on"),
        ("2020-10-01", "up to 30 days"),
    ):
        path = starts(tmp_path, f"date\n{date}\n")
        with pytest.raises(InputError, match=words):
            forecast(file, {"starts": path}, members=2, default_errors=False, workers=0)


@pytest.mark.slow
def test_observed_outlines_are_starts(file: Path, tmp_path: Path) -> None:
    for name, half in (("small", 0.05), ("large", 0.1)):
        corners = [[-39 + i * half, -55 + j * half] for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
        (tmp_path / f"{name}.geojson").write_text(
            '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": '
            f'{{"type": "Polygon", "coordinates": [{corners}]}}}}]}}'
        )
    file.write_text(
        YAML.replace("rectangle: {length: 9 km, width: 6 km}, placement: [-39, -55]", "outline: {file: small.geojson}")
    )
    path = starts(tmp_path, "outline\nsmall.geojson\nlarge.geojson\n")
    result = forecast(file, {"starts": path}, members=3, default_errors=False, workers=0, every_hours=6)
    area = np.unique(result["fragment_area"].isel(fragment=0).values)
    assert area.size == 2
    assert area[1] / area[0] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("place\n3\n", "a column 'place'. Columns are date, lon, lat, error_km, age_hours, outline"),
        ("lon\n3\n", "lon without lat"),
        ("lon,lat\n3,-95\n", "line 2: lat: -95. Give -90 to 90"),
        ("lon,lat,error_km\n3,-55,\n", "line 2: error_km: no number"),
        ("date\nyesterday\n", "line 2"),
    ],
)
def test_a_table_that_cannot_be_read_is_refused(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        read_starts(starts(tmp_path, text))


def test_a_table_of_starts_is_named_among_what_is_varied(file: Path, tmp_path: Path) -> None:
    path = starts(tmp_path, "lon,lat\n-39,-55\n-38.5,-55.5\n")
    found = {"berg.placement": "~each([-39, -55], [-38.5, -55.5])"}
    assert vary_with_file(file, [f"starts={path}"]) == found
    assert vary_with_file(file, {"starts": path}) == found
    file.write_text(YAML + "vary: {starts: starts.csv}\n")  # beside the file
    assert vary_with_file(file, ["start.turn~normal(0, 5)"]) == {**found, "start.turn": "~normal(0, 5)"}


@pytest.mark.quick(1)
@pytest.mark.parametrize(("date", "lattice"), [("2020-12-09", ""), ("2020-12-10", "packing: hexagonal, ")])
def test_lattices_of_observed_outlines_have_ice_at_every_bond(
    date: str, lattice: str, shared: Path, tmp_path: Path
) -> None:
    """Forecasts turn and shift the lattice: of A68a's outlines 8 of 18 were refused, "no ice joins the elements"."""
    outlines = shared / "data" / "observed" / "a68a_daily_outlines.geojson"
    file = tmp_path / "it.yaml"
    file.write_text(
        f"start: {date}\ndays: 1\nforcing: {{uniform: {{current: [0.1, 0], slope: [0, 0]}}}}\n"
        f"berg: {{outline: {{file: {outlines}, date: {date}}}, {lattice}thickness: 232 m}}\n"
    )
    model = build(str(file))[0]
    assert model.elements.size > 300


def required(start: str) -> Model:
    """Return a model of one element; without a start there is no control."""
    berg = Iceberg.rectangle("3 km", "3 km", thickness=200.0, placement=(-39.0, -55.0))
    return Model(berg, Forcing.uniform(current=(0.3, 0.0), slope=(0.0, 0.0)), start=datetime.fromisoformat(start))


def usual(start: str = "2020-12-10 00:00") -> Model:
    return required(start)


@pytest.mark.slow
def test_members_of_a_function_do_not_start_after_the_forecast_either() -> None:
    """Bug: only those of a file were refused; of a function they had no position at the start, and lost the end."""
    common: dict[str, Any] = {"days": 0.5, "every_hours": 6, "members": 1, "default_errors": False, "workers": 0}

    def varied(*starts: str) -> dict[str, Any]:
        return {"start": list(starts), "start.thickness": "lognormal(1, 1 %)"}

    words = "a member starts on 2020-12-10 00:00, the forecast on 2020-12-09 12:00"
    with pytest.raises(InputError, match=words):
        forecast(required, varied("2020-12-09 12:00", "2020-12-10 00:00"), **common)
    with pytest.raises(InputError, match="a member starts on 2020-12-11 00:00, the forecast on 2020-12-10 00:00"):
        forecast(usual, varied("2020-12-11 00:00", "2020-12-09 12:00"), **common)
    # The forecast starts with its control, the function without arguments.
    result = forecast(usual, varied("2020-12-09 12:00", "2020-12-10 00:00"), **common)
    assert str(result["init"].values)[:16] == "2020-12-10T00:00"
    assert np.isfinite(result["lon"].values[:, 0]).all()
    assert result["control_lon"].values[0, 0] == pytest.approx(-39.0, abs=1e-3)
