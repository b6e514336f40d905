"""What each fragment lost by melting: it adds up to the ledger, and summaries, words and pictures tell it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters, draw_map, draw_reasons, explain, open_run
from riftberg.diagnostics.summary import melt_by_fragment, melt_lines, summarize
from riftberg.diagnostics.why import reason_lines
from riftberg.life.ledger import read_melt
from riftberg.viz.replay import write_replay

PROCESSES = ("base", "sides", "waves", "bergy_bits", "footloose_bits", "footloose_bergy_bits")

SEA = Forcing.uniform(current=(0.4, -0.1), wind=(12.0, 2.0), slope=(0.0, 0.0))


def two_bergs() -> Model:
    p = Parameters(
        stepping={"time_step": 1800.0}, fracture={"enabled": False},
        melt={"enabled": True, "temperature": 6.0, "salinity": 34.0, "bits_fraction": 0.2},
    )  # fmt: skip
    thick = Iceberg.rectangle(6e3, 6e3, thickness=150.0, placement=(-37.0, -56.0))
    thin = Iceberg.rectangle(3e3, 3e3, thickness=90.0, placement=(-36.5, -56.0))
    return Model(Iceberg.join([thick, thin], names=["North", "South"]), SEA, p)


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> tuple[Model, Path]:
    folder, model = tmp_path_factory.mktemp("melt"), two_bergs()
    model.run(steps=6, output=folder / "run.nc", every_hours=1.0)
    return model, folder


def test_fragments_add_up_to_the_ledger_and_each_loses_its_own_ice(done) -> None:
    model, folder = done
    with open_run(folder / "run.nc") as run:
        lost = melt_by_fragment(run)
        assert set(lost) == {1, 2}
        for k, name in enumerate(PROCESSES):
            total = float(run["melt_water"].isel(process=k, time=-1))
            assert sum(water[name] for water in lost.values()) == pytest.approx(total, rel=1e-12, abs=1e-6)
    e = two_bergs().elements
    for number in (1, 2):
        now = model.elements.berg == number
        ice = model.elements.mass[now].sum() + model.elements.mass_of_bits[now].sum()
        before = e.mass[e.berg == number].sum()
        assert sum(lost[number].values()) == pytest.approx(before - ice, rel=1e-6)


@pytest.mark.slow
def test_a_fragment_that_has_lost_nothing_has_zeros_and_a_resumed_run_goes_on(done, tmp_path: Path) -> None:
    assert (read_melt({}, np.array([1, 2])) == 0.0).all()
    model = two_bergs()
    model.run(steps=3)
    model.save(tmp_path / "r.nc")
    resumed = Model.resume(tmp_path / "r.nc", SEA)
    resumed.run(steps=3)
    numbers = np.array([1, 2, 99])
    np.testing.assert_array_equal(read_melt(resumed.remembered, numbers), read_melt(done[0].remembered, numbers))
    assert (read_melt(resumed.remembered, numbers)[2] == 0.0).all()


def test_summary_words_map_and_replay_tell_of_it(done) -> None:
    model, folder = done
    rows = summarize(model)["ledger"]["by_fragment"]
    assert [row["name"] for row in rows] == ["North", "South"]
    assert rows[0]["base"] > rows[1]["base"] > 0.0
    with open_run(folder / "run.nc") as run:
        first, second = melt_lines(run)
        assert first.startswith("Melted: ")
        assert "Gt (base " in first
        assert "North" in second
        assert "South" in second
        assert reason_lines(explain(run))[-3:-1] == [first, second]  # before the strength of the ice
        figure = draw_map(run)
        assert any("Melted: " in text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")))
        write_replay(run, folder / "replay.html")
    assert '"melted"' in (folder / "replay.html").read_text()


@pytest.mark.slow
def test_bits_and_children_are_told_in_words_maps_replay_and_reasons(tmp_path: Path) -> None:
    """Bergs by footloose calving belong to no fragment that melts yet, and bits to none at all: both were told nowhere."""
    p = Parameters(
        stepping={"time_step": 1800.0}, footloose={"enabled": True, "style": "bergs"},
        melt={"enabled": True, "temperature": 8.0, "salinity": 34.0, "bits_fraction": 0.5},
    )  # fmt: skip
    berg = Iceberg.rectangle(6e3, 6e3, thickness=150.0, radius=1500.0, placement=(-37.0, -56.0))
    berg.elements.fl_k[:] = 3e5
    model = Model(berg, SEA, p)
    model.run(steps=4, output=tmp_path / "run.nc", every_hours=0.5)
    life = model.elements.life
    children = int((life.fl_k < 0.0).sum())
    assert children > 1
    with open_run(tmp_path / "run.nc") as run:
        bits = float(run["ice_in_bits"].isel(time=-1).sum())
        assert bits == pytest.approx(float((life.mass_of_bits * life.mass_scaling).sum()), rel=1e-12)
        line = melt_lines(run)[0]
        assert f"; {bits / 1e12:.3g} Gt more are afloat as bits; {children} bergs of " in line
        assert line.endswith(" calved or added later.")
        # Each child of the one berg tells where it comes from; it broke no bond, so it has no parent.
        assert run["fragment_calved_from"].values.tolist() == [0] + [1] * children
        assert not run["fragment_parent"].values.any()
        assert run["fragment_calved_from"].attrs["long_name"].startswith("number of the berg from whose edge it calved")
    assert [row.calved_from for row in Model.resume(model.save(tmp_path / "r.nc"), SEA).fragments.rows] == [0] + [
        1
    ] * children
    with open_run(tmp_path / "run.nc") as run:
        reasons = explain(run)
        assert line in reason_lines(reasons)
        draw_reasons(reasons, tmp_path / "why.svg")
        figure = draw_map(run)
        shown = [text.get_text().replace("\u00a0", " ") for text in figure.findobj(lambda a: hasattr(a, "get_text"))]
        titled = line.replace("km2", "km²").rstrip(".")
        assert any(titled in text.replace("\n", " ") for text in shown)
        write_replay(run, tmp_path / "replay.html")
    assert "afloat as bits" in (tmp_path / "replay.html").read_text()


def test_a_run_without_melt_says_nothing(tmp_path: Path) -> None:
    model = Model(Iceberg.rectangle(6e3, 6e3, thickness=150.0), SEA, Parameters(stepping={"time_step": 1800.0}))
    run = model.run(steps=2)
    assert melt_lines(run) == []
    assert summarize(model)["ledger"] is None
