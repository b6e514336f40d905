"""Records of forcing files: gaps between them, records without values, and what an experiment file says about both."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from riftberg import Model, Options, build
from riftberg.errors import ForcingError

EXPERIMENT = """\
start: 2020-12-09 12:00
days: 4
berg:
  rectangle: {length: 12 km, width: 6 km}
  placement: [-37, -56]
forcing:
  kind: files
  files: ["*.nc"]
  longitude: [-39, -35]
  latitude: [-57.5, -54.5]
"""
STANDARD = {
    "uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity", "ssh": "sea_surface_height_above_geoid",
    "ua": "eastward_wind", "va": "northward_wind",
}  # fmt: skip
UNITS = {"ssh": "m"}
HOUR = np.timedelta64(1, "h")


def day(number: float) -> np.datetime64:
    """Return a moment of December 2020, ns."""
    return np.datetime64("2020-12-01", "ns") + round(24 * (number - 1)) * HOUR


def records(
    days: Sequence[float],
    empty: Sequence[float] = (),
    fields: Sequence[str] = tuple(STANDARD),
    lack: Sequence[str] = (),
) -> xr.Dataset:
    """Return fields that equal 0.01 times the day of December; at the days ``empty`` those in ``lack`` are missing."""
    lon, lat = np.arange(-42.0, -31.9, 0.25), np.arange(-59.0, -52.9, 0.25)
    coords = {
        "time": ("time", [day(d) for d in days], {"standard_name": "time"}),
        "lat": ("lat", lat, {"units": "degrees_north", "standard_name": "latitude"}),
        "lon": ("lon", lon, {"units": "degrees_east", "standard_name": "longitude"}),
    }
    ds = xr.Dataset(coords=coords)
    for name in fields:
        series = np.array([np.nan if d in empty and (name in lack or not lack) else 0.01 * d for d in days])
        values = np.broadcast_to(series[:, None, None], (len(days), lat.size, lon.size))
        attributes = {"units": UNITS.get(name, "m s-1"), "standard_name": STANDARD[name]}
        ds[name] = (("time", "lat", "lon"), values.copy(), attributes)
    return ds


def experiment(folder: Path, ds: xr.Dataset | None = None, more: str = "", text: str = EXPERIMENT) -> Path:
    """Write an experiment, and its file of forcing."""
    if ds is not None:
        (folder / "forcing.nc").unlink(missing_ok=True)  # it may still be open
        ds.to_netcdf(folder / "forcing.nc")
    path = folder / "own.yaml"
    path.write_text(text + more)
    return path


def current(path: Path, hours: float, **options: object) -> float:
    """Return the mean current of the elements some hours after the start."""
    model, _ = build(str(path), Options(**options))  # type: ignore[arg-type]
    return _sampled(model, hours)


def _sampled(model: Model, hours: float) -> float:
    if model.forcing.grid is not None:
        model.forcing.grid.locate(model.elements)
    model.forcing.sample(model.elements, 3600.0 * hours)
    return float(model.elements.uo.mean())


def test_a_gap_is_refused_by_the_interval_of_all_records_not_of_the_window(tmp_path: Path) -> None:
    """Only the records around 9 to 13 December were looked at: two, three days apart, which seemed the usual interval."""
    ds = records([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 14, 15, 16])
    words = r"cf \(forcing.nc\): .*gap of 4 days between 2020-12-10T00:00 and 2020-12-14T00:00 .*the limit is 2.5 days"
    for more in ("", "  spacing: 0.25\n"):
        with pytest.raises(ForcingError, match=words) as refused:
            build(str(experiment(tmp_path, ds, more)))
        assert "forcing.max_gap" in str(refused.value)
    # A run that does not touch the gap is served.
    before = EXPERIMENT.replace("12-09 12:00", "12-02 12:00")
    assert current(experiment(tmp_path, text=before), 12) == pytest.approx(0.03)


def test_a_gap_between_files_is_refused(tmp_path: Path) -> None:
    for number in (7, 8, 9, 13, 14, 15):
        records([number]).to_netcdf(tmp_path / f"day_{number}.nc")
    with pytest.raises(ForcingError, match=r"day_7.nc and 5 more.*gap of 4 days between 2020-12-09T00:00"):
        build(str(experiment(tmp_path)))


def test_a_gap_is_refused_by_the_interval_that_files_state(tmp_path: Path) -> None:
    """Of two records alone nobody can tell; the file does."""
    ds = records([9, 14])
    assert current(experiment(tmp_path, ds), 12) == pytest.approx(0.10)
    ds.attrs["time_coverage_resolution"] = "P1D"
    with pytest.raises(ForcingError, match=r"the limit is 2\.5 days"):
        build(str(experiment(tmp_path, ds)))


def test_levels_have_no_gaps_either(tmp_path: Path) -> None:
    """Currents on levels were not looked at before the first step."""
    ds = records([7, 8, 9, 13, 14, 15], fields=("uo", "vo"))
    depth = xr.DataArray([10.0, 400.0], dims="depth", attrs={"units": "m", "standard_name": "depth", "axis": "Z"})
    layered = ds.expand_dims(depth=depth).transpose("time", "depth", "lat", "lon")
    with pytest.raises(ForcingError, match="gap of 4 days"):
        build(str(experiment(tmp_path, layered)))


def test_max_gap_allows_a_longer_gap_and_hold_ends_beyond_the_records(tmp_path: Path) -> None:
    ds = records([7, 8, 9, 13])
    with pytest.raises(ForcingError, match="lie outside the records"):
        build(str(experiment(tmp_path, ds, "  max_gap: 4 days\n")))
    both = "  max_gap: 4 days\n  hold: 12 h\n"
    assert current(experiment(tmp_path, more=both), 36) == pytest.approx(0.11)
    assert current(experiment(tmp_path, more=both), 96) == pytest.approx(0.13)
    with pytest.raises(ForcingError, match="gap of 4 days"):
        build(str(experiment(tmp_path, more="  max_gap: 95\n  hold: 12\n")))


@pytest.mark.quick(2)
@pytest.mark.parametrize("spacing", ["", "  spacing: 0.25\n  every_hours: 6\n"])
@pytest.mark.parametrize("lack", [(), ("uo", "vo"), ("vo",)])
def test_a_record_without_values_is_bridged_like_a_missing_one(
    tmp_path: Path, spacing: str, lack: tuple[str, ...]
) -> None:
    """A day of NaN was a day without current."""
    path = experiment(tmp_path, records(range(7, 17), empty=[11], lack=lack), spacing)
    for hours in (12, 24, 36, 48, 60):
        assert current(path, hours) == pytest.approx(0.01 * (9.5 + hours / 24.0), abs=1e-6)
    (notice,) = build(str(path))[1].notices
    assert notice.startswith("cf (forcing.nc): 1 record(s) without any value of uo, vo")


@pytest.mark.parametrize("spacing", ["", "  spacing: 0.25\n"])
def test_records_without_values_are_refused_beyond_the_limit(tmp_path: Path, spacing: str) -> None:
    ds = records(range(5, 17), empty=[11, 12], lack=("ssh",))
    words = r"gap of 3 days between 2020-12-10T00:00 and 2020-12-13T00:00 without values of ssh"
    with pytest.raises(ForcingError, match=words):
        build(str(experiment(tmp_path, ds, spacing)))
    assert current(experiment(tmp_path, more=f"{spacing}  max_gap: 72\n"), 36) == pytest.approx(0.11)


def test_a_record_without_values_at_the_start_takes_the_one_before_it(tmp_path: Path) -> None:
    """The record needed then lies outside the window of the run."""
    path = experiment(tmp_path, records(range(5, 17), empty=[9]))
    assert current(path, 0) == pytest.approx(0.095)


def test_a_field_without_any_value_is_refused(tmp_path: Path) -> None:
    ds = records(range(5, 17), empty=range(5, 17), lack=("ua", "va"))
    with pytest.raises(ForcingError, match=r"no value of ua, va in the box and at the dates of the run"):
        build(str(experiment(tmp_path, ds)))


def test_fields_without_time_beside_others_are_kept(tmp_path: Path) -> None:
    ds = records(range(5, 17), empty=[11])
    floor = xr.full_like(ds["uo"].isel(time=0, drop=True), 300.0)
    ds["depth"] = floor.assign_attrs(units="m", standard_name="sea_floor_depth_below_geoid")
    model, _ = build(str(experiment(tmp_path, ds)))
    assert _sampled(model, 36) == pytest.approx(0.11)
    np.testing.assert_allclose(model.elements.depth, 300.11, atol=1e-6)  # and the sea level


def test_water_without_ice_is_no_gap(tmp_path: Path) -> None:
    """Products write no value where there is no ice."""
    ds = records(range(5, 17))
    ice = xr.full_like(ds["uo"], 0.5).where(ds["time"] < day(10))
    ds["siconc"] = ice.assign_attrs(units="1", standard_name="sea_ice_area_fraction")
    model, _ = build(str(experiment(tmp_path, ds)))
    assert _sampled(model, 6) == pytest.approx(0.0975)
    # Three quarters of the way from 0.5 to none; the start was a record of its own, with the whole 0.5.
    assert model.elements.ice_fraction.mean() == pytest.approx(0.125)
    assert _sampled(model, 60) == pytest.approx(0.12)
    assert model.elements.ice_fraction.mean() == 0.0


def test_the_product_of_files_can_be_named(tmp_path: Path) -> None:
    """Only the doctor could be told what a file is."""
    ds = records(range(5, 17), fields=("uo", "vo", "ssh")).rename(uo="ugos", vo="vgos", ssh="adt")
    ds["adt"].attrs["standard_name"] = "sea_surface_height_above_geoid"
    with pytest.raises(ForcingError, match="no ocean current"):
        build(str(experiment(tmp_path, ds)))
    named = EXPERIMENT.replace('["*.nc"]', "[{file: forcing.nc, product: duacs-geostrophic}]")
    path = experiment(tmp_path, text=named)
    assert current(path, 12) == pytest.approx(0.10)
    assert "duacs-geostrophic" in build(str(path))[0].forcing.describe()
    plain = EXPERIMENT.replace('["*.nc"]', "[{file: forcing.nc}]")
    with pytest.raises(ForcingError, match="no ocean current"):
        build(str(experiment(tmp_path, text=plain)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('["*.nc"]', "[{file: a.nc, product: duac}]", r"forcing.files.0.*no product 'duac'; choose one of .*duacs"),
        ('["*.nc"]', "[{fil: a.nc}]", r"line 8, forcing.files.0.fil: there is no such key"),
        ("kind: files", "kind: files\n  max_gap: 0", r"forcing.max_gap.*Allowed: a number > 0, in h"),
        ("kind: files", "kind: files\n  hold: -1 h", r"forcing.hold.*Allowed: a number >= 0, in h"),
        ("kind: files", "kind: files\n  max_gap: 3 m", r"forcing.max_gap"),
    ],
)
def test_mistakes_in_the_new_keys_are_told_with_their_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    from riftberg.errors import InputError

    with pytest.raises(InputError, match=words):
        build(str(experiment(tmp_path, text=EXPERIMENT.replace(old, new))))


@pytest.mark.parametrize("spacing", ["", "  spacing: 0.25\n"])
def test_missing_sea_level_and_wind_are_noticed_unless_left_out_on_purpose(tmp_path: Path, spacing: str) -> None:
    ds = records(range(5, 17), fields=("uo", "vo"))
    model, info = build(str(experiment(tmp_path, ds, spacing)))
    assert len(info.notices) == 1
    assert "wind (ua, va): the air is calm" in info.notices[0]
    assert info.notices[0] in model.forcing.describe()  # and so in run.nc and summary.json
    assert model.notices[0].startswith("no sea level is given: its slope balances the current")
    model, info = build(str(experiment(tmp_path, more=f"{spacing}  sea_level: none\n")))
    assert [notice[:23] for notice in info.notices] == ["no file gives the wind "]
    assert model.sea_level_notice == ""
    _, info = build(str(experiment(tmp_path, more=f"{spacing}  sea_level: none\n  wind: none\n")))
    assert info.notices == ()


def test_none_leaves_out_what_the_files_give(tmp_path: Path) -> None:
    model, info = build(str(experiment(tmp_path, records(range(5, 17)), "  wind: none\n")))
    _sampled(model, 12)
    assert info.notices == ()
    assert np.all(model.elements.ua == 0.0)
    assert np.all(model.elements.uo > 0.09)


def test_half_a_vector_is_refused(tmp_path: Path) -> None:
    """Currents without their northward component were taken as eastward."""
    with pytest.raises(ForcingError, match="gives uo and no file gives vo"):
        build(str(experiment(tmp_path, records(range(5, 17), fields=("uo", "ssh")))))


def test_a_single_row_of_points_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="only one point along lat"):
        build(str(experiment(tmp_path, records(range(5, 17)).isel(lat=[12]))))


def glorys(folder: Path, name: str, number: float, **attributes: str) -> None:
    """Write one record like those of the toolbox."""
    ds = records([number], fields=("uo", "vo", "ssh")).rename(ssh="zos")
    ds.assign_attrs(source="MERCATOR GLORYS12V1", **attributes).to_netcdf(folder / name)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        ("a.nc", {"title": "Monthly mean fields for product GLOBAL_MULTIYEAR_PHY_001_030"}),
        ("cmems_mod_glo_phy_my_0.083deg_P1M-m_uo.nc", {}),
        ("mercatorglorys12v1_gl12_mean_202012.nc", {}),
        ("a.nc", {"time_coverage_resolution": "P1M"}),
    ],
)
def test_a_month_of_glorys_in_one_record_is_a_month(tmp_path: Path, name: str, attributes: dict[str, str]) -> None:
    """It was taken as the mean of the first of December."""
    glorys(tmp_path, name, 1, **attributes)
    _, info = build(str(experiment(tmp_path, more="  wind: none\n")))
    assert info.notices == ()


def test_months_of_glorys_in_a_file_each_are_told_by_their_distance(tmp_path: Path) -> None:
    for number, start in (("11", -29), ("12", 1), ("01", 32)):
        glorys(tmp_path, f"own_{number}.nc", start)
    path = experiment(tmp_path, more="  wind: none\n")
    # The middle of December is 12:00 of the 16th; stamps of daily means would give values from 1 December.
    at_middle = EXPERIMENT.replace("12-09 12:00", "12-15 12:00") + "  wind: none\n"
    assert current(experiment(tmp_path, text=at_middle), 24) == pytest.approx(0.01)
    assert build(str(path))[1].notices == ()


def test_a_record_of_glorys_that_tells_nothing_is_doubted(tmp_path: Path) -> None:
    glorys(tmp_path, "own.nc", 9)
    text = EXPERIMENT.replace("days: 4", "days: 0.4") + "  wind: none\n"
    _, info = build(str(experiment(tmp_path, text=text)))
    assert len(info.notices) == 1
    assert "taken as a day" in info.notices[0]
