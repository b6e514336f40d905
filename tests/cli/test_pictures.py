"""``riftberg plot``, ``animate``, ``replay``, ``score``, ``why``, ``doctor`` and ``fetch`` from the outside."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread
from PIL import Image
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import Options, open_run
from riftberg.cli.main import app
from riftberg.errors import ForcingError
from riftberg.experiments import BuiltIn, Info
from riftberg.runs.run_file import RunWriter

RING = [[-39.1, -55.05], [-38.6, -55.05], [-38.6, -54.95], [-39.1, -54.95], [-39.1, -55.05]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a run of two days and an observed outline."""
    path = tmp_path_factory.mktemp("pictures")
    kept = {"command": "riftberg run fake --every 3"}
    FakeModel().advance(2, recorders=[RunWriter(path / "run.nc", every_hours=3, experiment="fake", origin=kept)])
    feature = {
        "type": "Feature",
        "properties": {"date": "2020-12-10"},
        "geometry": {"type": "Polygon", "coordinates": [RING]},
    }
    (path / "seen.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    (path / "track.csv").write_text("date,lat,lon\n2020-12-10,-55.0,-38.8\n")
    return path


def call(*arguments: object) -> Any:
    """Run the command line."""
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.slow
def test_plot_draws_three_figures_beside_the_run(folder: Path) -> None:
    result = call("plot", folder / "run.nc", "--observed", folder / "seen.geojson", "--dpi", 50)
    assert result.exit_code == 0, result.output
    for name in ("dates", "stress", "timeline"):
        assert imread(folder / f"{name}.png")[..., :3].std() > 0.03, name


def test_plot_draws_what_was_asked_for(folder: Path, tmp_path: Path) -> None:
    result = call(
        "plot", folder, "-k", "dates", "-d", "2020-12-10", "-d", "2020-12-11T01:00", "-o", tmp_path / "new", "--dpi", 40
    )
    assert result.exit_code == 0, result.output
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["dates.png"]
    assert call("plot", folder, "-k", "chart").exit_code == 2
    assert call("plot", folder, "-d", "tomorrow").exit_code == 2


def test_observed_positions_are_no_outlines(folder: Path) -> None:
    result = call("plot", folder, "--observed", folder / "track.csv")
    assert result.exit_code == 2
    assert "no outlines, only positions" in result.stderr


@pytest.mark.slow
def test_animate_writes_a_gif_of_its_frames(folder: Path, tmp_path: Path) -> None:
    result = call("animate", folder, "-o", tmp_path / "film.gif", "--hours", 12, "--dpi", 40, "-q")
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 5  # type: ignore[attr-defined]
        assert np.asarray(film.convert("RGB")).std() > 5.0


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_animate_writes_an_mp4(folder: Path, tmp_path: Path) -> None:
    assert call("animate", folder, "-o", tmp_path / "film.mp4", "--hours", 24, "--dpi", 41, "-q").exit_code == 0
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"


def test_animate_refuses_what_it_cannot_write(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "Use .mp4 or .gif" in call("animate", folder, "-o", tmp_path / "film.avi").stderr
    assert "0 hours" in call("animate", folder, "-o", tmp_path / "film.gif", "--hours", 0).stderr
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert "ffmpeg is not installed" in call("animate", folder, "-o", tmp_path / "film.mp4").stderr


def test_replay_writes_one_page(folder: Path) -> None:
    result = call("replay", folder, "--title", "A <berg>", "--observed", folder / "seen.geojson")
    assert result.exit_code == 0, result.output
    assert "<title>A &lt;berg&gt;</title>" in (folder / "replay.html").read_text()
    assert "replay.html (0." in result.output


@pytest.mark.slow
def test_score_prints_a_table_and_writes_files(folder: Path, tmp_path: Path) -> None:
    result = call("score", folder, folder / "seen.geojson", "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert "2020-12-10 13:00" in result.output
    assert "1 time: centroid" in result.output
    content = json.loads((tmp_path / "score.json").read_text())
    assert content["days"][0]["matches"][0]["iou"] > 0.3
    assert (tmp_path / "score.png").exists()


def test_score_prints_json_of_a_track_between_dates(folder: Path, tmp_path: Path) -> None:
    options = ("-o", tmp_path, "--json", "--no-figure", "--between", "2020-12-10,2020-12-10", "--together", "1,2")
    result = call("score", folder, folder / "track.csv", *options)
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["days"][0]["matches"][0]["fragments"] == [1, 2]
    assert call("score", folder, folder / "track.csv", "--between", "2020-12-11,2020-12-12").exit_code == 2
    assert call("score", folder, folder / "track.csv", "--together", "all").exit_code == 2


def test_score_takes_kml_and_masks_and_is_told_their_date(folder: Path, tmp_path: Path) -> None:
    points = " ".join(f"{lon},{lat}" for lon, lat in RING)
    (tmp_path / "seen.kml").write_text(
        "<kml><Placemark><name>A</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{points}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
    )
    lon, lat = np.arange(-39.3, -38.3, 0.01), np.arange(-55.1, -54.9, 0.005)
    ice = (abs(lon + 38.85) < 0.25)[None, :] & (abs(lat + 55.0) < 0.05)[:, None]
    coords = {"lat": lat, "lon": lon}
    grids = {name: xr.DataArray(ice.astype(float), coords) for name in ("seen", "sure")}
    xr.Dataset(grids).to_netcdf(tmp_path / "seen.nc")
    overlaps = []
    for options in (
        ("seen.geojson",),
        ("seen.kml", "--date", "2020-12-10"),
        ("seen.nc", "-d", "20201210", "--variable", "sure"),
    ):
        place = folder if options[0] == "seen.geojson" else tmp_path
        result = call("score", folder, place / options[0], *options[1:], "-o", tmp_path, "--no-figure")
        assert result.exit_code == 0, result.output
        content = json.loads((tmp_path / "score.json").read_text())
        overlaps.append(content["days"][0]["matches"][0]["iou"])
    assert overlaps == pytest.approx([overlaps[0]] * 3, abs=0.02)
    refused = call("score", folder, tmp_path / "seen.kml")
    assert refused.exit_code == 2
    assert "no date. Looked for an attribute " in refused.stderr


@pytest.mark.slow
def test_why_tells_words_and_a_table(folder: Path) -> None:
    result = call("why", folder)
    assert result.exit_code == 0, result.output
    assert "fragment 2 (54 km2, 6 elements) broke off berg 1, aground" in result.output
    assert "through the cut" in result.output
    assert json.loads((folder / "why.json").read_text())["breakups"][0]["fragment"] == 2
    assert (folder / "why.png").exists()


@pytest.fixture
def registry(monkeypatch: pytest.MonkeyPatch) -> list[Options]:
    """Let the experiment ``fake`` have a part without which nothing breaks; returns what was asked for."""
    asked: list[Options] = []

    def build(name: str, options: Options | None = None) -> tuple[FakeModel, Info]:
        assert options is not None
        asked.append(options)
        return FakeModel(break_time=math.inf if "shoal" in options.without else 86_400.0), Info("fake")

    monkeypatch.setattr("riftberg.experiments.EXPERIMENTS", (BuiltIn("fake", "fake:build", "", ("shoal", "shear")),))
    monkeypatch.setattr("riftberg.experiments.build", build)
    return asked


@pytest.mark.slow
def test_why_runs_the_controls(folder: Path, tmp_path: Path, registry: list[Options]) -> None:
    result = call("why", folder, "--controls", "--no-figure", "-q", "-o", tmp_path)
    assert result.exit_code == 0, result.output
    words = " ".join(result.output.split())
    assert "Without shoal it does not break off." in words
    assert "Without shear it still breaks off at 2020-12-10 13:00." in words
    assert "With half the long step it still breaks off" in words
    assert [sorted(o.without) for o in registry] == [["shoal"], ["shear"], []]
    assert [dict(o.changes) for o in registry] == [{}, {}, {"stepping": {"time_step": 900.0, "substeps": 45}}]
    assert [o.days for o in registry] == [2.0] * 3


def test_doctor_says_what_is_missing(shared: Path) -> None:
    file = shared / "data/samples/nrt_global_allsat_phy_l4_20190223_20190226.nc"
    result = call("doctor", file, "--lon", "-43,-33", "--lat", "-59,-53", "--time", "2019-02-23,2019-02-24")
    assert result.exit_code == 1, result.output  # no wind
    assert "wind" in result.output
    assert json.loads(call("doctor", file, "--json").output)["ready"] is False


def test_doctor_takes_the_path_of_a_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    class Report:
        ready = True

        def text(self) -> str:
            return "all is well"

    def examine(files: Any, **how: Any) -> Report:
        asked.update(how, files=files)
        return Report()

    monkeypatch.setattr("riftberg.ocean.doctor.doctor", examine)
    result = call("doctor", "a.nc", "b.nc", "--along", folder / "run.nc", "--need", "depth_below_surface")
    assert (result.exit_code, result.output) == (0, "all is well\n")
    assert asked["files"] == ["a.nc", "b.nc"]
    assert "depth_below_surface" in asked["needed"]
    # The ends of the berg, where it looked at its middle alone.
    with open_run(folder / "run.nc") as run:
        for axis, name in enumerate(("lon", "lat")):
            first, all_ = run[name].isel(time=0), [place[axis] for place in asked["path"]]
            assert [f(all_[:4]) for f in (min, max)] == [float(first.min()), float(first.max())]
            assert max(all_) == float(run[name].max())
    assert call("doctor", "a.nc", "--lon", "west,east").exit_code == 2
    assert call("doctor", "a.nc", "--time", "2020-12-09").exit_code == 2


def test_fetch_calls_what_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def fetched(*arguments: Any, **how: Any) -> list[Path]:
        asked.append((arguments, how))
        return [tmp_path / "a.nc"]

    monkeypatch.setattr("riftberg.fetching.fetch.fetch_a68a", fetched)
    monkeypatch.setattr("riftberg.fetching.services.fetch_product", fetched)
    assert call("fetch", "a68a", "-o", tmp_path, "--small").output.strip().endswith("a.nc")
    assert asked[-1][0] == (tmp_path,)
    assert asked[-1][1]["hourly"] == ()
    result = call(
        "fetch",
        "duacs",
        "-o",
        tmp_path,
        "--lon",
        "-43,-33",
        "--lat",
        "-59,-53",
        "--time",
        "2020-12-09,2020-12-10",
        "-q",
    )
    assert result.exit_code == 0, result.output
    assert asked[-1][0][:4] == ("duacs", tmp_path, (-43.0, -33.0), (-59.0, -53.0))
    assert asked[-1][1]["progress"] is False
    assert asked[-1][1]["fields"] == ()
    place = ("-o", tmp_path, "--lon", "-43,-33", "--lat", "-59,-53")
    assert call("fetch", "era5", *place, "--time", "2020-12-09,2020-12-10", "--fields", "wind, ice").exit_code == 0
    assert asked[-1][1]["fields"] == ("wind", "ice")
    assert call("fetch", "gebco", *place).exit_code == 0
    assert asked[-1][0] == ("gebco", tmp_path, (-43.0, -33.0), (-59.0, -53.0), None)


def test_fetch_refuses_what_it_does_not_know(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "'b15' is not known" in call("fetch", "b15").stderr
    assert "a box is needed" in call("fetch", "oscar", "--lon", "1,2").stderr
    assert "days are needed" in call("fetch", "oscar", "--lon", "1,2", "--lat", "1,2").stderr
    assert (
        "Choose from: wind, waves, ice"
        in call(
            "fetch", "era5", "--lon", "1,2", "--lat", "1,2", "--time", "2020-12-09,2020-12-10", "--fields", "snow"
        ).stderr
    )

    def refused(*arguments: Any, **how: Any) -> list[Path]:
        raise ForcingError("no login", remedy="Log in")

    monkeypatch.setattr("riftberg.fetching.fetch.fetch_a68a", refused)
    result = call("fetch", "a68a")
    assert (result.exit_code, result.stderr) == (2, "Error: no login. Log in\n")
