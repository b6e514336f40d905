"""Clouds whose bergs come into being during the run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters, build
from riftberg.errors import BergError, ForcingError, InputError

SEA = Forcing.uniform((0.2, 0.0))
START, SIZES = "2020-12-09 00:00", {"length": 200.0, "width": 100.0, "thickness": 80.0}
FOUR_AND_ONE = np.array(["2020-12-09"] * 4 + ["2020-12-10"], "M8[h]")
ALONE = Parameters(stepping={"interactions": False, "time_step": "30 min"}, grounding={"law": "none"})


def cloud(dates: Any, n: int = 5, radius: float = 20e3, **options: Any) -> Iceberg:
    return Iceberg.cloud(n, (-37.0, -56.0), radius, dates=dates, seed=2, **{**SIZES, **options})


def counts(model: Model, hours: int) -> list[int]:
    """Bergs that are there after each hour."""
    found = []
    for _ in range(hours):
        model.advance("1 h")
        found.append(model.elements.size)
    return found


def test_bergs_come_evenly_between_the_first_and_the_last_date() -> None:
    berg = cloud(("2020-12-09", "2020-12-09 08:00"))
    model = Model(berg, SEA, ALONE, start=START)
    assert model.elements.size == 1
    assert "4 more bergs until 2020-12-09 08:00" in model.describe()
    assert counts(model, 9) == [1, 2, 2, 3, 3, 4, 4, 5, 5]
    assert "more berg" not in model.describe()
    # Each begins at its own place, at rest, and the water has had it for as long as it is there.
    places = {round(float(lat), 9) for lat in berg.elements.lat}
    assert {round(float(lat), 9) for lat in Model(berg, SEA, ALONE, start=START).elements.lat} <= places
    gone = np.sort(model.elements.lon)[:, None] - berg.elements.lon[None, :]
    assert (gone.max(axis=1) > 0.0).all()


@pytest.mark.parametrize(
    ("dates", "at_start"),
    [("2020-12-09", 5), (["2020-12-08", "2020-12-09"], 5), (["2020-12-08", "2020-12-10"], 3), (FOUR_AND_ONE, 4)],
)  # fmt: skip
def test_those_whose_date_has_passed_are_there_at_the_start(dates: Any, at_start: int) -> None:
    assert Model(cloud(dates), SEA, ALONE, start=START).elements.size == at_start


def test_a_berg_drifts_as_one_of_the_same_place_and_date() -> None:
    """Born at six hours, it goes the way of a berg that another run has from then on."""
    both = cloud((START, "2020-12-09 06:00"), n=2)
    model = Model(both, SEA, ALONE, start=START)
    model.advance("12 h")
    alone = Model(
        Iceberg.from_points(both.elements.lon[1:], both.elements.lat[1:], **SIZES), SEA, ALONE, start="2020-12-09 06:00"
    )
    alone.advance("6 h")
    np.testing.assert_allclose(model.elements.lon[1], alone.elements.lon[0], atol=1e-9)
    np.testing.assert_allclose(model.elements.lat[1], alone.elements.lat[0], atol=1e-9)


def test_a_run_that_was_saved_bears_those_still_to_come(tmp_path: Path) -> None:
    dates = (START, "2020-12-09 10:00")
    whole, model = (Model(cloud(dates), SEA, ALONE, start=START) for _ in range(2))
    model.advance("5 h")
    again = Model.resume(model.save(tmp_path / "half.restart.nc"), SEA)
    assert "more bergs until 2020-12-09 10:00" in again.describe()
    again.advance("7 h")
    whole.advance("12 h")
    assert again.elements.size == 5
    for name in ("id", "lon", "lat", "u", "v", "berg"):
        np.testing.assert_array_equal(getattr(again.elements, name), getattr(whole.elements, name))


def test_the_run_file_has_a_trajectory_for_each() -> None:
    run = Model(cloud((START, "2020-12-09 04:00")), SEA, ALONE, start=START).run("6 h")
    there = run["lon"].notnull().sum("trajectory").values.tolist()
    assert run.sizes["trajectory"] == 5
    assert there == [1, 2, 3, 4, 5, 5, 5]


def test_where_bergs_act_on_each_other_one_waits_until_its_place_is_free() -> None:
    """Two at one place: the second comes when the first has drifted off."""
    berg = cloud((START, "2020-12-09 00:30"), n=2, overlap=True)
    berg.elements.lon[1] = berg.elements.lon_pair[1] = berg.elements.lon[0]
    berg.elements.lat[1] = berg.elements.lat_pair[1] = berg.elements.lat[0]
    pushed = Parameters(stepping={"time_step": "10 min"}, grounding={"law": "none"})
    model = Model(berg, Forcing.uniform((0.05, 0.0)), pushed, start=START)
    found = counts(model, 4)
    assert found[0] == 1
    assert found[-1] == 2
    assert Model(berg, SEA, ALONE, start=START).run("1 h").sizes["trajectory"] == 2


def test_ice_that_melts_closes_its_budget_with_those_that_come() -> None:
    p = ALONE.changed(melt={"enabled": True, "temperature": 3.0, "salinity": 34.0})
    model = Model(cloud((START, "2020-12-09 05:00")), SEA, p, start=START)
    model.advance("8 h")
    assert model.elements.size == 5
    assert model.life is not None
    assert abs(model.life.balance(model).error) < 1e-12


@pytest.mark.parametrize(
    ("dates", "said"),
    [
        (["2020-12-10", "2020-12-09"], "do not rise"), (["2020-12-09"] * 3, "3 dates for 5 bergs"),
        ("tomorrow", "tomorrow"), ([], "0 dates"),
    ],
)  # fmt: skip
def test_dates_that_cannot_be_are_refused(dates: Any, said: str) -> None:
    with pytest.raises(BergError, match=said):
        cloud(dates)


def test_a_run_needs_a_berg_at_its_start_and_a_forcing_for_all_that_come() -> None:
    with pytest.raises(InputError, match=r"no berg is there at the start.*2020-12-09 06:00"):
        Model(cloud("2020-12-09 06:00"), SEA, ALONE, start=START)
    with pytest.raises(BergError, match="dates"):
        Iceberg.join([cloud(START), Iceberg.rectangle("2 km", "1 km", thickness=100.0, placement=(-30.0, -56.0))])
    series = Forcing.along(["2020-12-09", "2020-12-10"], uo=0.1, vo=0.0)
    with pytest.raises(ForcingError, match="outside the series"):
        Model(cloud((START, "2020-12-12")), series, ALONE).advance(days=4)


def test_an_experiment_file_says_it_too(tmp_path: Path) -> None:
    text = """
start: 2020-12-09
days: 1
berg:
  placement: [-37.0, -56.0]
  thickness: 80 m
  seed: {number: 5, radius: 20 km, length: 200 m, width: 100 m, dates: [2020-12-09, 2020-12-09 12:00]}
forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}
parameters: {stepping: {interactions: false}}
"""
    path = tmp_path / "cloud.yaml"
    path.write_text(text)
    model, _ = build(str(path))
    assert model.elements.size == 1
    assert "4 more bergs until 2020-12-09 12:00" in model.describe()
    path.write_text(text.replace("[2020-12-09, 2020-12-09 12:00]", "[2020-12-09, 12]"))
    with pytest.raises(InputError, match=r"line 7, berg.seed.dates.*12 is not a date"):
        build(str(path))
