"""Gridded output of a run: cells hold what the bergs gave, to round-off, by month and by moment, as CF."""

from __future__ import annotations

import netCDF4
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import Forcing, GridRecorder, Iceberg, Model, OceanForcing, Parameters, ocean_grid
from riftberg.cli.main import app
from riftberg.errors import InputError
from riftberg.life.ledger import scaled_mass

ALONE = Parameters(
    bonds={"law": "none"}, fracture={"enabled": False}, contact={"iterate": False},
    stepping={"scheme": "verlet", "time_step": 3600.0, "interactions": False, "explicit_substeps": True},
    melt={"enabled": True, "mode": "berg", "base": "turbulent", "bits_fraction": 0.3}, rolling={"enabled": True},
)  # fmt: skip
SEA = {"current": (0.4, -0.1), "slope": (0.0, 0.0), "wind": (8.0, 3.0), "temperature": 3.0, "salinity": 34.0}
LON, LAT = np.array([179.7, -170.0, 60.2]), np.array([-56.1, -61.0, -57.5])


def model(rows=slice(None), parameters=ALONE, start="2020-01-31 06:00") -> Model:
    berg = Iceberg.from_points(LON[rows], LAT[rows], thickness=200.0, radius=9000.0)
    return Model(berg, Forcing.uniform(**SEA), parameters, start=start)


def run(tmp_path, name="f", days=2.0, every_hours=12.0, grid=1.0, **more) -> tuple[Model, GridRecorder]:
    m = model(**more)
    recorder = GridRecorder(tmp_path / name, grid, every_hours=every_hours)
    m.advance(days, recorders=[recorder])
    return m, recorder


def test_cells_hold_what_all_bergs_gave(tmp_path) -> None:
    m, recorder = run(tmp_path)
    balance = m.life.balance(m)
    for dataset in (recorder.monthly(), recorder.moments()):
        seconds = (dataset["time_bnds"].diff("bnds").squeeze("bnds") / np.timedelta64(1, "s")).astype(float)
        total = lambda name, d=dataset, s=seconds: (d[name] * d["areacello"] * s).sum(("time", "j", "i"))  # noqa: E731
        for process, water in balance.water.items():
            assert float(total("ficeberg_process").sel(process=process)) == pytest.approx(water, rel=1e-12, abs=1e-3)
        assert float(total("ficeberg")) == pytest.approx(sum(balance.water.values()), rel=1e-12)
        assert float(total("hfibthermds2d")) == pytest.approx(sum(balance.heat.values()), rel=1e-12)
    assert balance.water["waves"] > 0.0
    last = recorder.moments().isel(time=-1)
    mass = scaled_mass(m.elements.life, m.elements.body.mass).sum()
    assert float((last["ibmass"] * last["areacello"]).sum()) == pytest.approx(mass, rel=1e-12)


def dense(recorder: GridRecorder) -> np.ndarray:
    """Sums of all months on all cells."""
    total = np.zeros((9, recorder.grid.arrays.area.size))
    for span in recorder._months:
        total[:, span.sums.cells] += span.sums.rows
    return total


def test_each_cell_is_the_sum_over_bergs_that_run_alone(tmp_path) -> None:
    together = run(tmp_path, grid=0.5)[1]
    whole = dense(together)
    alone = sum(dense(run(tmp_path, name=f"b{k}", rows=slice(k, k + 1), grid=0.5)[1]) for k in range(3))
    np.testing.assert_allclose(whole, alone, rtol=1e-12, atol=1e-12 * np.abs(whole).max())
    assert (whole[0] > 0).sum() > 6  # several cells each


@pytest.mark.parametrize("width", [1.0, 7.5])
def test_cells_go_round_the_earth_from_the_date_line_to_near_the_poles(width: float) -> None:
    g = GridRecorder("cells", width).grid.arrays
    first = g.halo - 1
    last = first + g.nj, first + g.ni
    most = width * np.floor(88.0 / width)
    assert (g.lon[first, first], g.lat[first, first]) == (-180.0, -most)
    assert (g.lon[last], g.lat[last]) == (180.0, most)


def test_months_end_where_the_calendar_says(tmp_path) -> None:
    m, _ = run(tmp_path)
    with xr.open_dataset(tmp_path / "f-monthly.nc") as monthly:
        bounds = monthly["time_bnds"].values
        assert bounds[0, 0] == np.datetime64("2020-01-31T06:00")
        assert bounds[0, 1] == bounds[1, 0] == np.datetime64("2020-02-01T00:00")
        assert bounds[1, 1] == np.datetime64(m.date)
        assert monthly["ficeberg"].attrs["standard_name"] == "water_flux_into_sea_water_from_icebergs"
        assert monthly["hfibthermds2d"].attrs["units"] == "W m-2"
        assert float(monthly["hfibthermds2d"].max()) <= 0.0
        assert monthly["ibmass"].attrs["cell_methods"] == "area: mean time: mean"
        assert monthly.attrs["Conventions"].startswith("CF-")
    with xr.open_dataset(tmp_path / "f-instantaneous.nc") as moments:
        assert moments.sizes["time"] == 4
        assert moments["ibmass"].attrs["cell_methods"] == "area: mean time: point"


def test_bergs_that_only_drift_have_mass_and_no_melt(tmp_path) -> None:
    _, recorder = run(tmp_path, parameters=ALONE.changed(melt={"enabled": False}, rolling={"enabled": False}))
    monthly = recorder.monthly()
    assert float(monthly["ficeberg"].max()) == 0.0
    assert float(monthly["ibmass"].max()) > 0.0


@pytest.mark.slow
def test_a_resumed_run_goes_on_with_month_and_moment_bit_for_bit(tmp_path) -> None:
    whole, full = run(tmp_path, days=3.0)
    first, _ = run(tmp_path, days=0.7)  # in the middle of both; the month ends at 0.75 days
    first.save(tmp_path / "stopped.nc")
    for steps in (1, 7):  # stopped again right after, and once more across the end of the month
        model = Model.resume(tmp_path / "stopped.nc", Forcing.uniform(**SEA))
        model.advance(steps=steps, recorders=[GridRecorder(tmp_path / "part", 1.0, every_hours=12.0)])
        model.save(tmp_path / "stopped.nc")
    model = Model.resume(tmp_path / "stopped.nc", Forcing.uniform(**SEA))
    rest = GridRecorder(tmp_path / "rest", 1.0, every_hours=12.0)
    model.advance(steps=whole.step_number - model.step_number, recorders=[rest])
    for here, there in ((rest._months, full._months), (rest._moments, full._moments)):
        assert 1 <= len(here) < len(there)
        for one, other in zip(here, there[-len(here) :], strict=True):
            assert (one.since, one.end) == (other.since, other.end)
            for a, b in ((one.sums, other.sums), (one.state, other.state)):
                np.testing.assert_array_equal(a.cells, b.cells)
                np.testing.assert_array_equal(a.rows, b.rows)
    xr.testing.assert_identical(rest.moments().isel(time=-1), _like(full.moments(), rest.moments()))


def _like(full: xr.Dataset, part: xr.Dataset) -> xr.Dataset:
    """Return the last time of a dataset on the cells of another."""
    j, i = (
        int(np.argmin(np.abs(full[name].isel({other: 0}).values - float(part[name][0, 0]))))
        for name, other in (("lat", "i"), ("lon", "j"))
    )
    return full.isel(time=-1, j=slice(j, j + part.sizes["j"]), i=slice(i, i + part.sizes["i"]))


def test_other_cells_or_another_moment_begin_anew(tmp_path) -> None:
    first, _ = run(tmp_path, days=0.5)
    first.save(tmp_path / "stopped.nc")
    for cells, hours in ((2.0, 12.0), (1.0, 6.0)):
        model = Model.resume(tmp_path / "stopped.nc", Forcing.uniform(**SEA))
        began = model.date
        recorder = GridRecorder(tmp_path / "other", cells, every_hours=hours)
        model.advance(steps=2, recorders=[recorder])
        assert recorder._months[0].since == began


def test_a_berg_beyond_the_cells_and_cells_that_do_not_close_are_refused(tmp_path) -> None:
    lon, lat = np.meshgrid(np.linspace(50.0, 70.0, 21), np.linspace(-60.0, -50.0, 11))
    with pytest.raises(InputError, match=r"element 1 at .* is outside the cells"):
        run(tmp_path, grid=ocean_grid(lon, lat))
    x, y = np.meshgrid(np.arange(11.0) * 1e4, np.arange(11.0) * 1e4)
    with pytest.raises(InputError, match="not both in degrees"):
        run(tmp_path, grid=ocean_grid(x, y, latlon=False))
    for width in (0.7, 0.0, 20.0, float("nan")):
        with pytest.raises(InputError, match="cells"):
            GridRecorder(tmp_path / "x", width)
    with pytest.raises(InputError, match="every"):
        GridRecorder(tmp_path / "x", 1.0, every_hours=0.0)


@pytest.mark.slow
def test_the_command_line_writes_both_files(tmp_path) -> None:
    (tmp_path / "e.yaml").write_text(
        "name: small\nstart: 2020-12-15\ndays: 0.1\n"
        "berg: {rectangle: {length: 6 km, width: 3 km}, thickness: 200 m, radius: 1500 m, placement: [-37, -56]}\n"
        "forcing: {uniform: {}}\nparameters: {melt: {enabled: true, temperature: 2, salinity: 34}}\n"
    )
    words = ["run", str(tmp_path / "e.yaml"), "--no-map", "--quiet", "--output", str(tmp_path / "out"), "--every", "1"]
    done = CliRunner().invoke(app, [*words, "--cells", "0.5"])
    assert done.exit_code == 0, done.output
    with xr.open_dataset(tmp_path / "out" / "bergs-monthly.nc") as monthly:
        assert float(monthly["ibmass"].max()) > 0.0
    assert "bergs-monthly.nc" in done.output
    assert "bergs-instantaneous.nc" not in done.output  # the run is shorter than a day
    (tmp_path / "e.yaml").write_text((tmp_path / "e.yaml").read_text() + "output_cells: 2\n")
    for more, width in (([], 2.0), (["--cells", "0.5"], 0.5)):
        done = CliRunner().invoke(app, [*words, *more])
        assert "bergs-monthly.nc" in done.output
        with xr.open_dataset(tmp_path / "out" / "bergs-monthly.nc") as monthly:
            assert float(np.diff(monthly["lon"][0])[0]) == pytest.approx(width)
    refused = CliRunner().invoke(app, [*words, "--cells", "0.7"])
    assert refused.exit_code == 2
    assert "divides 360" in refused.output


def test_cells_of_the_forcing_itself_are_known_without_a_search(tmp_path) -> None:
    """The same grid as the forcing's, and one equal to it whose cells are looked for: the same fields bit for bit."""
    lon, lat = np.meshgrid(np.arange(-180.0, 180.5, 2.0), np.arange(-64.0, -51.5, 1.0))
    here = ocean_grid(lon, lat)
    fields = {"uo": 0.4, "vo": -0.1, "ua": 8.0, "va": 3.0, "sst": 3.0, "sss": 34.0}
    around = {name: np.full((lon.shape[0] - 1, lon.shape[1] - 1), value) for name, value in fields.items()}
    forcing = OceanForcing(here, here.fields(**around))
    m = Model(Iceberg.from_points(LON, LAT, thickness=200.0, radius=9000.0), forcing, ALONE)
    assert m.forcing.grid is here
    recorders = [
        GridRecorder(tmp_path / f"g{k}", g, every_hours=12.0) for k, g in enumerate((here, ocean_grid(lon, lat)))
    ]
    m.advance(2.0, recorders=recorders)
    assert float(recorders[0].monthly()["ficeberg"].max()) > 0.0
    xr.testing.assert_identical(*(recorder.monthly() for recorder in recorders))
    xr.testing.assert_identical(*(recorder.moments() for recorder in recorders))


@pytest.mark.parametrize("year", ["0101", "2600"])
def test_model_years_come_back_as_they_are(tmp_path, year: str) -> None:
    """Coupled models count years of their own; to the nanosecond 2600 is 2015."""
    run(tmp_path, start=f"{year}-01-31 06:00")
    for name in ("f-monthly.nc", "f-instantaneous.nc"):
        with netCDF4.Dataset(tmp_path / name) as file:
            bounds = netCDF4.num2date(file["time_bnds"][:], file["time"].units, file["time"].calendar)
            assert bounds[0, 0].isoformat() == f"{year}-01-31T06:00:00"
            assert bounds[-1, 1].isoformat() == f"{year}-02-02T06:00:00"
