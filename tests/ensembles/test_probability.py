"""Probabilities of forecasts whose members are made by hand, and forecasts from the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from typer.testing import CliRunner

import riftberg
from riftberg import Forcing, Iceberg, Model, Parameters, open_run, open_sweep
from riftberg.cli.main import app
from riftberg.ensembles.forecast import default_errors, errors_line, forecast_errors
from riftberg.ensembles.hazard import approach
from riftberg.ensembles.member import Outcome, broken_off
from riftberg.ensembles.probability import scenarios, sources, told
from riftberg.ensembles.vary import read_varied
from riftberg.errors import InputError
from riftberg.viz.ensemble import draw_forecast

from .made import forecast_of, limits_of, outcome, small_berg, wilson

CONES = (0.5, 0.9)
MOST_LISTED = 64


def drifting() -> Model:
    """Return a model of two elements in a current."""
    berg = Iceberg.rectangle("6 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(
        berg, Forcing.uniform(current=(0.2, 0.0), depth=2000.0, slope=(0.0, 0.0)), Parameters(), start="2020-12-09"
    )


def still(number: int, **options: Any) -> Outcome:
    """Return a member that stays where it is."""
    return outcome(number, [-37.0] * 5, [-56.0] * 5, **options)


def test_members_that_never_break_stay_in_the_denominator() -> None:
    members = [still(0, broken=1), still(1, broken=3), *(still(k) for k in range(2, 8))]
    ds = forecast_of(members, 4)
    assert ds["p_broken"].values == pytest.approx([0.0, 1 / 8, 1 / 8, 2 / 8, 2 / 8])
    assert ds.attrs["effective_members"] == pytest.approx(8.0)
    # Wilson's interval of 2 in 8 at 90 %, from the formula by hand: centre 0.3132, half-width 0.2267.
    assert ds["p_broken_low"].values[-1] == pytest.approx(0.0865, abs=1e-4)
    assert ds["p_broken_high"].values[-1] == pytest.approx(0.5398, abs=1e-4)


def test_a_crumb_is_no_break_up() -> None:
    """Bug: an element that broke off counted as a break-up in `first_breakup` and `p_broken`, and in no scenario."""
    crumb = [outcome(k, [-37.0] * 3, [-56.0] * 3, broken=1, piece=0.9e6) for k in range(2)]
    ds = forecast_of([*crumb, still(2, broken=1)], 4)
    assert ds["p_broken"].values[-1] == pytest.approx(1 / 3)
    assert np.isnat(ds["first_breakup"].values).tolist() == [True, True, False]
    assert ds["scenario"].values.tolist() == [0, 0, 1]
    assert "1 % of its berg" in ds["first_breakup"].attrs["long_name"]
    assert "1 % of its berg" in ds["p_broken"].attrs["long_name"]


def test_pieces_of_pieces_are_measured_by_their_berg() -> None:
    rows = [
        (1, 0, 100.0, 0.0),
        (2, 1, 20.0, 5.0),
        (3, 2, 1.0, 4.0),
        (4, 2, 0.9, 3.0),
        (5, 0, 2.0, 0.0),
        (6, 5, 0.1, 1.0),
    ]
    assert broken_off(rows) == [5, 2, 1]


def test_a_failed_member_counts_in_nothing() -> None:
    ds = forecast_of([still(0, broken=1), Outcome(1, "failed", "no"), still(2)], 4)
    assert ds["p_broken"].values[-1] == pytest.approx(0.5)
    assert ds["scenario"].values.tolist() == [0, -1, 1]


def test_why_members_failed_is_said_once_with_its_count() -> None:
    """A forecast said how many failed; why stood in its file alone."""
    deep = [Outcome(k, "failed", f"element 1 has a draft of {300 + k}.5 m") for k in (0, 1)]
    slow = Outcome(3, "unfinished", "unfinished after 10 min")
    said = ["  2 of 3 failed: element 1 has a draft of 300.5 m", "  1 of 1 unfinished: unfinished after 10 min"]
    assert told(forecast_of([*deep, Outcome(2, "failed", "no"), slow], 4))[1:] == said
    assert told(forecast_of([*deep, Outcome(2, "failed", "no"), slow, still(4)], 4))[-2:] == said


def test_an_unfinished_member_counts_until_it_took_too_long_and_then_both_ways() -> None:
    """One broke before it was left, the other was whole: what it would have done is not known."""
    broke, whole = (outcome(k, [-37.0] * 3, [-56.0] * 3, broken=1.0 if k == 0 else None) for k in range(2))
    for one in (broke, whole):
        one.status, one.message = "unfinished", "unfinished after 10 min"
    ds = forecast_of([broke, whole, *(still(k) for k in range(2, 8)), Outcome(8, "failed", "no")], 4)
    assert ds["p_broken"].values == pytest.approx([0.0, 1 / 8, 1 / 8, 1 / 7, 1 / 7])
    assert ds["p_broken_low"].values[1:] == pytest.approx([wilson(1 / 8, 8.0)[0]] * 4)
    highs = [wilson(share, 8.0)[1] for share in (1 / 8, 1 / 8, 2 / 8, 2 / 8)]
    assert ds["p_broken_high"].values[1:] == pytest.approx(highs)
    # Positions and areas are of the others; the ends of the interval take the two as with and without such a fragment.
    none, all_ = ds["p_area"].values[0, 0], ds["p_area"].values[3, 0]
    assert (none, all_) == (0.0, 1.0)
    assert ds["p_area_high"].values[0, 0] == pytest.approx(wilson(2 / 8, 6.0)[1])
    assert ds["p_area_low"].values[3, 0] == pytest.approx(wilson(6 / 8, 6.0)[0])
    assert ds.attrs["not_covered"].endswith("; 2 unfinished members")
    lines = told(ds)
    assert lines[0].startswith("6 members, 1 failed, 2 unfinished; after 4 days")
    assert any("then both ways" in line for line in lines)
    assert not any("unfinished" in line for line in told(forecast_of([still(0), still(1)], 4)))
    lines = told(forecast_of([broke, still(1)], 4))
    assert any("first break-up in 1 of 2 members, 2020-12-10 00:00" in line for line in lines)


def test_ice_of_unfinished_members_counts_as_far_as_they_came(tmp_path: Path) -> None:
    """Presence, and the limits of ice, left them out from the start: most often those that break up most."""
    members = [outcome(k, [-37.0] * 5, [-56.0] * 5) for k in range(12)]
    members += [outcome(k, [-36.0] * 3, [-56.0] * 3) for k in range(12, 16)]
    for member in members[12:]:
        member.status = "unfinished"
    ds = forecast_of(members, 4)
    at = [ds.sel(cell_lon=lon, cell_lat=-56.0, method="nearest") for lon in (-37.0, -36.0)]
    assert at[0]["presence"].values == pytest.approx([0.75, 0.75, 0.75, 1.0, 1.0])
    assert at[1]["presence"].values == pytest.approx([0.25, 0.25, 0.25, 0.0, 0.0])
    # It passed there; whether it came to the others' place later is not known.
    assert [float(place["passes"]) for place in at] == pytest.approx([1.0, 0.25])
    dates = [str(ds["time"].values[k])[:16] + "Z" for k in (0, 4)]
    east = [limits_of(ds, tmp_path, 99, date)[0].shape.bounds[2] for date in (*dates, "whole time")]
    assert [most > -36.1 for most in east] == [True, False, False]


def test_pieces_beyond_those_that_are_listed_are_said_not_to_be_covered() -> None:
    """Bug: of a member with more than 64 pieces the smallest ones are in no map and no limit, and nothing said so."""
    many = still(0, broken=1)
    many.totals["breakups"] = 1.0
    assert "pieces" not in forecast_of([many, still(1)], 4).attrs["not_covered"]
    for _ in range(MOST_LISTED):
        for name, column in many.fragments.items():
            column.append(3.0 + len(column) if name == "number" else column[1])
    many.totals["breakups"] = 1.0 + MOST_LISTED
    ds = forecast_of([many, still(1)], 4)
    assert ds.attrs["not_covered"].endswith("; pieces beyond the 64 largest in 1 member")
    many.status = "unfinished"  # its ice counts too, near a place
    ds = forecast_of([many, still(1)], 4)
    assert ds.attrs["not_covered"].endswith("; pieces beyond the 64 largest in 1 member")


def test_intervals_of_probabilities_cover_at_the_ends() -> None:
    whole = forecast_of([still(k) for k in range(20)], 4)
    assert whole["p_broken_low"].values[-1] == pytest.approx(0.0, abs=1e-15)
    assert 0.0 < whole["p_broken_high"].values[-1] < 0.15
    broken = forecast_of([still(k, broken=1) for k in range(20)], 4)
    assert broken["p_broken_high"].values[-1] == pytest.approx(1.0, abs=1e-15)
    assert 0.85 < broken["p_broken_low"].values[-1] < 1.0


def test_area_classes_and_ground() -> None:
    ds = forecast_of([still(0, broken=2, piece=30e6), still(1, aground=3.0)], 4)
    lower = ds["area_class_lower"].values.tolist()
    tens, hundreds = lower.index(1e7), lower.index(1e8)
    assert ds["p_area"].values[tens].tolist() == [0.0, 0.0, 0.5, 0.5, 0.5]  # pieces of 30 and 70 km2
    assert ds["p_area"].values[hundreds].tolist() == [1.0, 1.0, 0.5, 0.5, 0.5]
    assert ds["p_aground"].values.tolist() == [0.0, 0.0, 0.0, 0.5, 0.5]


def ashore(days: list[float], weight: list[float] | None = None) -> list[str]:
    """Lines that tell of members that run aground so many days after the start, the k-th k km farther north."""
    members = [outcome(k, [-37.0] * 5, [-56.0 + k / 111.2] * 5, aground=day) for k, day in enumerate(days)]
    return [line for line in told(forecast_of(members, 4, weight=weight)) if "ran aground" in line]


def test_a_forecast_says_when_and_where_members_run_aground() -> None:
    assert ashore([1.0, 3.0, 2.0] * 7 + [np.nan]) == [
        "  of 21 members that ran aground half did by 2020-12-11 00:00, about 55.91 S, 37.00 W, half of them within 5 km of it"
    ]
    assert ashore([np.nan]) == []


def test_of_few_members_that_run_aground_the_range_is_told_and_no_median() -> None:
    """Bug: one of many ran aground, and half of it within 0 km; members of no weight had a say."""
    assert ashore([2.0] + [np.nan] * 19) == ["  1 of 20 members ran aground, 2020-12-11 00:00, 56.00 S, 37.00 W"]
    (line,) = ashore([1.0, 3.0, np.nan] * 8, weight=[1.0] * 3 + [0.0] * 21)
    assert line.startswith("  2 of 3 members ran aground, 2020-12-10 00:00 to 2020-12-12 00:00, ")
    assert "half" not in line
    (weighed,) = ashore([1.0] * 12 + [3.0] * 12, weight=[1.0] * 12 + [1.2] * 12)
    assert "half did by 2020-12-12 00:00" in weighed


def test_members_aground_at_the_start_are_pointed_out() -> None:
    many, few = (forecast_of([still(k, aground=0.0 if k < n else np.nan) for k in range(30)], 4) for n in (10, 1))
    assert any("33 % of the members are aground at the start" in line for line in told(many))
    assert not any("at the start:" in line for line in told(few))


def test_no_scenario_is_shown_by_a_member_without_weight() -> None:
    """Bug: after sightings the representative of one was a member that these ruled out."""
    north = [0.0, 0.1, 0.2, 3.0]
    members = [outcome(k, [-37.0] * 3, [-56.0, -56.0, -56.0 + d]) for k, d in enumerate(north)]
    (found,) = scenarios(forecast_of(members, 2, weight=[0.0, 0.0, 0.0, 1.0]))
    assert (found.probability, found.representative) == (1.0, 3)


def test_one_member_has_a_position_and_no_spread() -> None:
    """Bug: position nan, nan; 90 % within an ellipse of nan by nan km."""
    lines = told(forecast_of([outcome(0, [-37.0, -36.5], [-56.0, -56.2])], 1))
    assert "  position 56.20 S, 36.50 W; one member says nothing of the spread" in lines
    assert not any("nan" in line for line in lines)


def test_plans_for_sensitivity_are_no_forecasts(tmp_path: Path) -> None:
    """Bug: a plan of three draws for a sensitivity ran 24 members, and their shares were called probabilities."""
    for plan in ("morris", "saltelli"):
        with pytest.raises(
            InputError, match=f"plan: '{plan}' draws for a sensitivity.*Use sobol, random, latin-hypercube"
        ):
            riftberg.forecast("a68a", members=3, plan=plan, output=tmp_path / plan)


def test_presence_holds_each_member_once() -> None:
    ds = forecast_of([still(0, broken=2), outcome(1, [-37.0, -36.5, -36.0, -35.5, -35.0], [-56.0] * 5)], 4)
    at = ds["presence"].sel(cell_lon=-37.0, cell_lat=-56.0, method="nearest").values
    assert at.tolist() == [1.0, 0.5, 0.5, 0.5, 0.5]
    end = ds["presence"].sel(cell_lon=-35.0, cell_lat=-56.0, method="nearest").values
    assert end.tolist() == [0.0, 0.0, 0.0, 0.0, 0.5]
    assert ds["passes"].values.max() == 1.0
    # The area under the disc: both members at the start.
    dx = float(ds["cell_lon"].diff("cell_lon")[0]) * np.cos(np.deg2rad(56.0)) * 111.2
    dy = float(ds["cell_lat"].diff("cell_lat")[0]) * 111.2
    assert float((ds["presence"].values[0] > 0).sum()) * dx * dy == pytest.approx(100.0, rel=0.25)


def test_ice_lies_where_a_long_berg_lies(tmp_path: Path) -> None:
    """Bug: of a berg 150 km long the ends lay beyond the presence and the limits of ice, which took discs of its area."""
    ds = forecast_of([outcome(k, [-37.0] * 2, [-56.0] * 2, area=400e6, shape=(30.0, 4.0)) for k in range(2)], 1)
    major, minor = 2.0 * 400.0**0.5 / np.pi**0.5, 0.5 * 400.0**0.5 / np.pi**0.5  # km
    limit = limits_of(ds, tmp_path, None)[0].shape
    for along, across, there in ((0.9, 0.0, 1.0), (-0.9, 0.0, 1.0), (1.2, 0.0, 0.0), (0.0, 0.8, 1.0), (0.0, 1.6, 0.0)):
        azimuth = np.deg2rad(30.0)
        east = along * major * np.sin(azimuth) + across * minor * np.cos(azimuth)
        north = along * major * np.cos(azimuth) - across * minor * np.sin(azimuth)
        lon, lat = -37.0 + east / 111.2 / np.cos(np.deg2rad(56.0)), -56.0 + north / 111.2
        assert float(ds["presence"].isel(time=0).sel(cell_lon=lon, cell_lat=lat, method="nearest")) == there
        assert limit.contains(shapely.Point(lon, lat)) == (there > 0.0)
    near_by = approach(
        ds, "tip", shapely.Point(-37.0 + 1.0 * np.tan(np.deg2rad(30.0)) / np.cos(np.deg2rad(56.0)), -55.0), 1e3
    )
    assert near_by.closest / 1e3 == pytest.approx([111.2 / np.cos(np.deg2rad(30.0)) - major] * 2, rel=0.01)


def test_the_ellipse_holds_its_share_of_the_members() -> None:
    rng = np.random.default_rng(2)
    ends = rng.multivariate_normal([0.0, 0.0], [[0.09, 0.03], [0.03, 0.04]], 800)
    members = [
        outcome(k, [-37.0, -37.0 + x / np.cos(np.deg2rad(56.0))], [-56.0, -56.0 + y]) for k, (x, y) in enumerate(ends)
    ]
    ds = forecast_of(members, 1)
    azimuth = np.deg2rad(float(ds["cone_azimuth"].values[-1]))
    x = (ds["lon"].values[:, 0, -1] - float(ds["cone_lon"].values[-1])) * np.cos(np.deg2rad(56.0)) * 111195.0
    y = (ds["lat"].values[:, 0, -1] - float(ds["cone_lat"].values[-1])) * 111195.0
    along, across = x * np.sin(azimuth) + y * np.cos(azimuth), x * np.cos(azimuth) - y * np.sin(azimuth)
    for part in CONES:
        major, minor = (float(ds[name].sel(cone=part).values[-1]) for name in ("cone_major", "cone_minor"))
        assert major > minor
        assert np.mean((along / major) ** 2 + (across / minor) ** 2 <= 1.0) == pytest.approx(part, abs=0.04)


def test_cracks_of_all_lattices_add_up_in_the_berg() -> None:
    ds = forecast_of([still(0, broken=1), still(1, broken=2), still(2), still(3)], 4)
    at = ds["crack_probability"].sel(own_x=3000.0, own_y=0.0, method="nearest")
    assert float(at) == pytest.approx(0.5)
    cell = float(ds["own_x"].diff("own_x")[0]) ** 2
    assert float(ds["crack_density"].sum()) * cell == pytest.approx(0.5 * 7 * 500.0)
    assert float(ds["crack_probability"].sel(own_x=-3000.0, own_y=0.0, method="nearest")) == 0.0


def test_scenarios_have_their_members_and_what_sets_them_apart() -> None:
    strength = [0.5, 0.6, 0.55, 1.5, 1.4, 1.6, 1.5, 1.45]
    members = [still(k, broken=1 + k) for k in range(3)] + [still(k) for k in range(3, 8)]
    ds = forecast_of(members, 4, {"start.strength": strength})
    assert ds["scenario"].values.tolist() == [1, 1, 1, 0, 0, 0, 0, 0]
    likeliest, other = scenarios(ds)
    assert likeliest.probability == pytest.approx(5 / 8)
    assert likeliest.pieces == ()
    assert other.pieces == (30e6,)
    assert other.representative in (0, 1, 2)
    assert "start strength low" in other.told()


def test_scenario_0_is_the_likeliest_by_weight() -> None:
    """Bug: numbers went by how many members a scenario has; one that weighs nothing was number 0."""
    members = [still(k, broken=2 if k < 3 else None) for k in range(8)]
    ds = forecast_of(members, 4, weight=[8 / 3] * 3 + [0.0] * 5)
    assert ds["scenario"].values.tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    assert [(s.number, s.probability) for s in scenarios(ds)] == [(0, pytest.approx(1.0)), (1, 0.0)]


def test_the_representative_of_a_scenario_is_in_its_middle_across_the_date_line() -> None:
    ends = [179.6, 179.8, -180.0, -179.8, -179.6]
    assert [
        s.representative
        for s in scenarios(forecast_of([outcome(k, [180.0, lon], [-60.0] * 2) for k, lon in enumerate(ends)], 1))
    ] == [2]


def test_the_source_of_the_spread_is_found() -> None:
    rng = np.random.default_rng(4)
    current, wind, east = rng.normal(0.0, 0.1, (60, 2)), rng.normal(0.0, 2.0, (60, 2)), rng.normal(0.0, 3e3, 60)
    members = [
        outcome(k, [-37.0, -37.0 + 5.0 * current[k, 0]], [-56.0, -56.0 + 3.0 * current[k, 1] + 0.005 * wind[k, 1]],
                means={"current_error_east": current[k, 0], "current_error_north": current[k, 1],
                       "wind_error_east": wind[k, 0], "wind_error_north": wind[k, 1]})
        for k in range(60)
    ]  # fmt: skip
    parts = sources(forecast_of(members, 1, {"start.east": east.tolist()}))
    assert next(iter(parts)) == "current"
    assert parts["current"] > 0.95
    assert parts["wind"] < 0.15
    assert parts["start"] < 0.15
    assert any("by itself: current " in line for line in told(forecast_of(members, 1)))
    assert "partly by chance" not in " ".join(told(forecast_of(members, 1)))
    assert "partly by chance" in " ".join(told(forecast_of(members[:20], 1)))
    # Of the few members that count after an update, anything explains the spread.
    weighted = forecast_of(members, 1)
    assert sources(weighted.assign_coords(weight=("member", 0.2 ** np.arange(60.0)))) == {}


def test_the_layout_is_that_of_the_page() -> None:
    ds = forecast_of([still(0, broken=1), still(1)], 4)
    page = (Path(__file__).parents[2] / "docs/explanation/ensemble-file.md").read_text("utf-8")
    for name in ds.data_vars:
        stem = str(name).removesuffix("_low").removesuffix("_high")
        assert f"`{stem}" in page or f"{stem}`" in page, name
    climate = ds.swap_dims(time="lead").expand_dims("init")
    assert {"init", "lead", "member"} <= set(climate.dims)
    assert ds["lead"].values.tolist() == [0.0, 24.0, 48.0, 72.0, 96.0]


@pytest.mark.slow
def test_a_forecast_of_a_function_has_all_default_errors(tmp_path: Path) -> None:
    ds = riftberg.forecast(drifting, days="12 h", every_hours=6, members=4, workers=0, output=tmp_path / "f")
    assert ds["status"].values.tolist() == [0] * 4
    assert len(set(ds["errors_seed"].values.tolist())) == 4
    assert float(ds["lon"].values[:, 0, -1].std()) > 0.01
    assert np.isfinite(ds["current_error_east"].values).all()
    kept = open_sweep(tmp_path / "f")
    assert kept["p_broken"].values.tolist() == ds["p_broken"].values.tolist()
    assert kept["control_lon"].values[0, 0] == pytest.approx(-37.0)
    # The control has no errors: it is the run of the model alone.
    run = drifting().run("12 h", every_hours=6)
    middle = run["lon"].mean("trajectory").values[-1]
    assert ds["control_lon"].values[0, -1] == pytest.approx(float(middle), abs=1e-6)
    assert json.loads((tmp_path / "f" / "sweep.json").read_text())["forecast"] is True


def test_what_is_given_comes_before_the_default_errors() -> None:
    from riftberg import Options
    from riftberg.ensembles.forecast import forecast_plan
    from riftberg.ensembles.vary import Draws

    plan = forecast_plan(
        drifting, ["current_error.speed=0.3 m/s", "start.thickness~normal(1, 0.1)"], Options(days=0.1), None, Draws(2)
    )
    values = plan.members[0]
    assert values["current_error.speed"] == 0.3
    assert values["current_error.length"] == 50e3
    assert next(v for v in plan.varied if v.name == "start.thickness").distribution.name == "normal"  # type: ignore[union-attr]
    bare = forecast_plan(
        drifting, ["start.thickness~normal(1, 0.1)"], Options(days=0.1), None, Draws(2), defaults=False
    )
    assert set(bare.members[0]) == {"start.thickness"}
    with pytest.raises(InputError, match="a standard deviation of 0"):
        forecast_plan(drifting, ["start.thickness~normal(1, 0)"], Options(days=0.1), None, Draws(2))


def test_the_default_errors_stand_in_the_docs() -> None:
    page = (Path(__file__).parents[2] / "docs/howto/ensemble-forecast.md").read_text("utf-8")
    # Of a function and of an experiment with another lattice, between them all errors.
    for error in {*default_errors("a68a"), *default_errors(drifting)}:
        assert error.text in page, error.text
        assert error.source in page, error.source
        assert all(text in page for text in error.vary), error.vary


def test_the_line_of_errors_names_what_is_varied() -> None:
    """Bug: it named the current error of 0.1 m/s where --vary had another."""

    def line(experiment: str, *vary: str) -> str:
        return errors_line(read_varied(forecast_errors(experiment, vary)))

    assert "lattice" in line("a68a")
    assert "lattice" not in line("a68a-oras5")
    assert "floor" not in line("a68a")
    own = line("a68a", "current_error.speed=0.2 m/s", "drag.ocean_scale~lognormal(17.8, 20 %)")
    assert own.startswith("Errors: wind 2 m/s, 300 km, 1 day; thickness 15 %; start 3 km; ")
    for name in ("current_error.speed", "current_error.length", "current_error.time", "drag.ocean_scale"):
        assert name in own


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    members = []
    for k in range(12):
        lon, lat = (np.cumsum([first, *rng.normal(step, 0.02, 6)]) for first, step in ((-37.0, 0.1), (-56.0, -0.05)))
        members.append(outcome(k, lon.tolist(), lat.tolist(), broken=3 if k % 3 else None))
    path = draw_forecast(forecast_of(members, 6), tmp_path / "f.png", dpi=60)
    assert path.stat().st_size > 10_000
    with pytest.raises(InputError, match="no forecast"):
        draw_forecast(xr.Dataset(), tmp_path / "g.png")


@pytest.mark.compiled
def test_the_command_forecasts(tmp_path: Path) -> None:
    out = tmp_path / "f"
    said = CliRunner().invoke(
        app, ["forecast", str(small_berg(tmp_path)), "--members", "2", "-o", str(out), "--workers", "0"]
    )
    assert said.exit_code == 0, said.output
    assert "Errors: current 0.1 m/s, 50 km, 3 days; wind 2 m/s" in said.output
    assert "2 members, 0 failed" in said.output
    assert (out / "forecast.png").exists()
    found = open_sweep(out)
    assert found.sizes["member"] == 2
    with open_run(out / "control.nc") as control:  # the run in which nothing is varied, whole
        ends = found["control_lon"].values[0, [0, -1]], control["lon"].values[:, [0, -1]].mean(axis=0)
        assert ends[0] == pytest.approx(ends[1], abs=0.02)
    page = CliRunner().invoke(app, ["replay", str(out)])
    assert page.exit_code == 0, page.output
    (out / "control.nc").unlink()
    none = CliRunner().invoke(app, ["replay", str(out)])
    assert none.exit_code == 2
    assert "holds no control.nc" in none.output
    more = CliRunner().invoke(app, ["forecast", "--resume", str(out), "--members", "3", "--no-map", "--workers", "0"])
    assert more.exit_code == 0, more.output
    assert open_sweep(out).sizes["member"] == 3


@pytest.mark.parametrize("bergs", [1, 3])
def test_of_several_bergs_the_position_is_called_that_of_the_first(bergs: int) -> None:
    said = "\n".join(told(forecast_of([still(k) for k in range(12)], 4).isel(fragment=[0] * bergs)))
    assert ("of the first of 3 bergs" in said) == (bergs == 3)
    assert "position" in said
