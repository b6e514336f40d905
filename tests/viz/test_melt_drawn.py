"""The picture of melt: the colours are the thickness lost, the upper edge of the curves is all melt water."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import PolyCollection
from typer.testing import CliRunner

from riftberg import (
    Forcing,
    Iceberg,
    Model,
    Parameters,
    draw_fragments,
    draw_map,
    draw_melt,
    open_run,
    read_observed,
    score_run,
)
from riftberg.cli.main import app
from riftberg.cli.pictures import usual_kinds
from riftberg.errors import InputError
from riftberg.viz.replay import ReplayContent
from viz.browser import unpack


def melting(path: Path, enabled: bool = True) -> xr.Dataset:
    berg = Iceberg.rectangle("6 km", "4 km", thickness="200 m", radius="1 km", placement=(-40.0, -55.0))
    melt = {"enabled": enabled, "temperature": 3.0, "salinity": 34.0}
    model = Model(
        berg, Forcing.uniform((0.2, 0.0), wind=(8.0, 0.0)), Parameters(melt=melt, stepping={"time_step": "1 h"})
    )
    return model.run(days=1, output=path, every_hours=3)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    return melting(tmp_path_factory.mktemp("melt") / "run.nc")


@pytest.mark.slow
def test_colours_are_the_thickness_lost(run: xr.Dataset) -> None:
    ax, _, _ = draw_melt(run).axes
    (ice,) = [c for c in ax.collections if isinstance(c, PolyCollection) and c.get_array() is not None]
    thickness = run["thickness"].transpose("time", "trajectory").values
    np.testing.assert_allclose(ice.get_array(), thickness[0] - thickness[-1])
    assert ice.get_array().min() > 0.0
    half = draw_melt(run, date=run["time"].values[4])
    (ice,) = [c for c in half.axes[0].collections if isinstance(c, PolyCollection) and c.get_array() is not None]
    np.testing.assert_allclose(ice.get_array(), thickness[0] - thickness[4])


@pytest.mark.slow
def test_the_map_of_a_single_berg_shows_what_it_has_lost(run: xr.Dataset, tmp_path: Path) -> None:
    """Bug: the map of a run with melt showed none; the colours of one fragment said nothing."""
    thickness = run["thickness"].transpose("time", "trajectory").values
    figure = draw_map(run, dates=2)
    shown = [ice.get_array() for ax in figure.axes for ice in ax.collections if isinstance(ice, PolyCollection)]
    lost = [values for values in shown if values is not None]
    np.testing.assert_allclose(lost[0], 0.0)
    np.testing.assert_allclose(lost[-1], thickness[0] - thickness[-1])
    assert any("thickness lost" in ax.get_xlabel() for ax in figure.axes)
    cold = draw_map(melting(tmp_path / "cold.nc", enabled=False), dates=2)
    assert not any("thickness lost" in ax.get_xlabel() for ax in cold.axes)


def test_curves_stand_on_each_other(run: xr.Dataset) -> None:
    curves = draw_melt(run).axes[1]
    top = max(path.vertices[:, 1].max() for area in curves.collections for path in area.get_paths())
    assert top == pytest.approx(float(run["melt_water"].isel(time=-1).sum()) / 1e12)
    assert {t.get_text().split(":")[0] for t in curves.get_legend().get_texts()} == {"base", "sides", "waves"}


@pytest.mark.slow
def test_areas_are_those_of_the_record(run: xr.Dataset, tmp_path: Path) -> None:
    """Bug: the curves, the replay page and the score of a berg that melts had its area of the first record."""
    areas = (run["length"] * run["width"]).transpose("time", "trajectory").values
    assert areas[-1].sum() < 0.999 * areas[0].sum()
    (line, *_) = draw_fragments(run).axes[0].lines
    np.testing.assert_allclose(line.get_ydata(), areas.sum(axis=1) / 1e6)
    content = ReplayContent(run, "", {}).data()["elements"]
    np.testing.assert_allclose(unpack(content["side"]) ** 2, areas, rtol=1e-6)
    lon, lat = (float(run[name].isel(time=-1).mean()) for name in ("lon", "lat"))
    table = tmp_path / "seen.csv"
    table.write_text(f"date,lon,lat,name,area_km2\n{str(run['time'].values[-1])[:16]},{lon},{lat},A1,20\n")
    match = score_run(run, read_observed(table)).days[0].matches[0]
    assert match.area_km2 == pytest.approx(areas[-1].sum() / 1e6)


def test_kind_of_the_command_line(run: xr.Dataset, tmp_path: Path) -> None:
    assert "melt" in usual_kinds(run)
    path = run.encoding["source"]
    assert CliRunner().invoke(app, ["plot", str(path), "-k", "melt", "--dpi", "40", "-o", str(tmp_path)]).exit_code == 0
    assert (tmp_path / "melt.png").stat().st_size > 5_000


def test_run_without_melt_is_refused(tmp_path: Path) -> None:
    cold = melting(tmp_path / "cold.nc", enabled=False)
    assert "melt" not in usual_kinds(open_run(tmp_path / "cold.nc"))
    with pytest.raises(InputError, match="melts"):
        draw_melt(cold)
