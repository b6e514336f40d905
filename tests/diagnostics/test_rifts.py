"""What a run says of its rifts: how near to their toughness they stand, that they are too short to say, or have no toughness."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Forcing, Iceberg, Model, Parameters, explain, open_run
from riftberg.diagnostics.summary import summarize
from riftberg.diagnostics.why import reason_lines
from riftberg.runs.scene import Scene

TOUGHNESS = 1e5


def cracked(rift: Any, pull: float = 0.0, *, broken: bool = True, radius: float = 500.0, **fracture: Any) -> Model:
    """40 x 24 km of ice with a rift (km from its middle) in still water, its ends pulled along x with a mean stress (Pa)."""
    toughness = {"criterion": "toughness", "toughness": TOUGHNESS}
    p = Parameters(
        fracture={"normal_strength": 1e5, "shear_strength": 1e6, **(fracture or toughness)}, earth={"latlon": False},
        stepping={"only_interactions": True, "time_step": 60.0},
    )  # fmt: skip
    berg = Iceberg.rectangle(40e3, 24e3, thickness=200.0, radius=radius, latlon=False, lattice_angle=20.0)
    if rift is not None:
        how = {"broken": True} if broken else {"strength": 0.5}
        berg = berg.with_rifts([1e3 * np.array(rift) + [130.0, 70.0]], **how)
    model = Model(berg, Forcing.uniform(), p)
    el = model.elements
    x = el.lon
    for sign in (-1.0, 1.0):
        end = el.mass * (sign * x > 18e3)
        el.load_x[:] += sign * pull * 24e3 * 200.0 * end / end.sum()
    return model


INSIDE = [(0.0, -4.0), (0.0, 4.0)]
FROM_THE_EDGE = [(0.0, -14.0), (0.0, -6.0)]


def run_to(model: Model, path: Path) -> Any:
    """Run one step into a file, and open it."""
    model.run(steps=1, output=path, every_hours=1.0 / 60.0)
    return open_run(path)


def test_a_rift_stands_at_the_part_of_its_toughness_that_the_handbook_has(tmp_path) -> None:
    """K = s sqrt(pi a) with the factor of its width (Tada), in the model, its summary, the run file, in words and on the map."""
    model = cracked(INSIDE, 500.0)
    run = run_to(model, tmp_path / "run.nc")
    expected = 500.0 * np.sqrt(np.pi * 4e3 / np.cos(np.pi * 4e3 / 24e3)) / TOUGHNESS
    entries = json.loads(json.dumps(summarize(model)["rifts"]))
    assert len(entries) == 2
    for tip, entry in zip(model.rift_tips, entries, strict=True):
        assert tip.hoop / TOUGHNESS == pytest.approx(expected, rel=0.07)
        assert entry["of_toughness"] == pytest.approx(expected, rel=0.07)
        assert entry["largest_of_toughness"] == pytest.approx(entry["of_toughness"])
        assert np.hypot(entry["lon"], abs(entry["lat"]) - 4e3) < 1.5e3
    assert Scene(run).rift_tips == model.rift_tips
    (line, _) = explain(run).rifts
    assert f"stands at {model.rift_tips[0].hoop / TOUGHNESS:.2g} of its toughness" in line
    assert line in reason_lines(explain(run))
    import matplotlib.pyplot as plt

    from riftberg import draw_map

    _, ax = plt.subplots()
    draw_map(run, ax=ax, date=run["time"].values[-1])
    texts = [text.get_text() for text in ax.texts]
    plt.close("all")
    assert sum("of toughness" in text for text in texts) == 2


def test_a_rift_from_the_edge_has_one_tip() -> None:
    model = cracked(FROM_THE_EDGE, 300.0)
    model.advance(steps=1)
    (tip,) = model.rift_tips
    assert tip.hoop > 0.0
    assert abs(tip.lat + 6e3) < 1.5e3


@pytest.mark.parametrize(
    "rift", [[(0.0, -0.9), (0.0, 0.9)], [(0.0, -14.0), (0.0, -9.9)], [(0.0, -14.0), (0.0, 9.5)]],
    ids=["short", "short from the edge", "two cells from the other side"],
)  # fmt: skip
def test_a_rift_too_short_or_too_near_to_the_outline_is_said_to_be(rift, tmp_path) -> None:
    model = cracked(rift, 10.0)
    lines = explain(run_to(model, tmp_path / "run.nc")).rifts
    assert lines
    assert all("too short" in line and "smaller elements" in line for line in lines)
    for entry in summarize(model)["rifts"]:
        assert entry["opening"] is entry["of_toughness"] is entry["largest"] is None


def test_a_rift_without_a_toughness_is_told() -> None:
    """With the strength alone; not with a toughness, not without fracture, not for a weakened line, not without a rift."""
    ice = {"criterion": "ice", "normal_strength": 1e5}
    told = [any("broken from the start" in text for text in model.notices) for model in (
        cracked(INSIDE, **ice), cracked(INSIDE, normal_strength=1e4), cracked(INSIDE),
        cracked(INSIDE, enabled=False), cracked(INSIDE, broken=False, **ice), cracked(None, **ice),
    )]  # fmt: skip
    assert told == [True, True, False, False, False, False]


@pytest.mark.parametrize("way", ["mask", "mask file", "no strength", "by hand", "two lines"])
def test_rifts_however_given_are_told_without_a_toughness(way: str, tmp_path: Path) -> None:
    """And, where they have no line and so no tips, with one too; a cut from edge to edge has no tip."""
    berg = Iceberg.rectangle(40e3, 24e3, thickness=200.0, radius=1000.0, placement=(0.0, 0.0), latlon=False)
    x, y = np.arange(-21e3, 21.5e3, 500.0), np.arange(-13e3, 13.5e3, 500.0)
    mask = xr.DataArray(
        ((np.abs(y)[:, None] < 4e3) & (np.abs(x - 250.0) < 600.0)[None, :]).astype(float), {"lat": y, "lon": x},
        ("lat", "lon"),
    )  # fmt: skip
    line = 1e3 * np.array(INSIDE)
    if way == "mask":
        cut = berg.with_rifts(mask, broken=True)
    elif way == "mask file":
        mask.to_dataset(name="rift").to_netcdf(tmp_path / "rift.nc")
        cut = berg.with_rifts(tmp_path / "rift.nc", broken=True)
    elif way == "no strength":
        cut = berg.with_rifts(line)
    elif way == "by hand":
        cut = berg.with_rifts(line, broken=True)
        cut.bonds.crack[:] = 0
    else:
        cut = berg.with_rifts([line, np.add(line, [5e3, 0.0])], broken=True)
    through = berg.with_rifts(4.0 * line, broken=True)
    for fracture, tipless in (({}, False), ({"criterion": "toughness", "toughness": TOUGHNESS}, True)):
        said, nothing = (
            " ".join(Model(b, Forcing.uniform(), Parameters(earth={"latlon": False}, fracture=fracture)).notices)
            for b in (cut, through)
        )
        assert ("strength alone" in said) is not tipless
        assert ("has no tips" in said) is (tipless and way != "two lines")
        assert "rift" not in nothing
    assert (
        "2 rifts are broken" in " ".join(Model(cut, Forcing.uniform(), Parameters(earth={"latlon": False})).notices)
    ) is (way == "two lines")


def test_pressed_faces_are_said_to_be(tmp_path: Path) -> None:
    model = cracked(INSIDE, -500.0)
    lines = explain(run_to(model, tmp_path / "run.nc")).rifts
    assert all(tip.hoop < 0.02 * TOUGHNESS for tip in model.rift_tips)
    assert len(lines) == 2


def test_a_rift_at_its_toughness_parts_the_berg_and_one_below_it_stands() -> None:
    """It runs to the outline, through the last elements too, whatever the strength."""
    model = cracked(FROM_THE_EDGE, 300.0)
    model.advance(steps=1)
    (tip,) = model.rift_tips
    assert model.bonds.break_time[np.isfinite(model.bonds.break_time)].size == 0
    beyond = 300.0 * TOUGHNESS / tip.hoop
    below, above = (cracked(FROM_THE_EDGE, factor * beyond) for factor in (0.98, 1.02))
    below.advance(steps=1)
    above.advance(steps=1)
    assert not np.isfinite(below.bonds.break_time).any()
    assert np.isfinite(above.bonds.break_time).any()
    assert np.unique(above.elements.berg).size == 2
    assert above.rift_tips == []


def test_intensities_go_on_from_a_restart(tmp_path) -> None:
    run = cracked(INSIDE, 500.0)
    run.advance(steps=1)
    again = Model.resume(run.save(tmp_path / "rift.nc"), Forcing.uniform())
    assert again.rift_tips == run.rift_tips
    run.elements.load_x[:] *= 0.5
    again.elements.load_x[:] *= 0.5
    run.advance(steps=1)
    again.advance(steps=1)
    assert again.rift_tips == run.rift_tips
    # The largest stays.
    assert all(tip.hoop == pytest.approx(0.5 * tip.largest, rel=1e-6) for tip in run.rift_tips)
