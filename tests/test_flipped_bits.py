"""A bit that flips on a disk is noticed: in a restart, wherever it is, and in all that a sweep goes on from."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import open_sweep
from riftberg.cli.main import app
from riftberg.ensembles.member import Outcome
from riftberg.ensembles.sweep import Store, write_record
from riftberg.errors import InputError, RiftbergError
from riftberg.runs.restart import load_state, save
from riftberg.verification.sightings import read_pieces


def held(state: Any) -> dict[str, Any]:
    """Return all that a run goes on from."""
    tables = {**state.elements.arrays(), **{f"bond_{name}": array for name, array in state.bonds.arrays().items()}}
    return {**tables, **state.extra, "rest": (state.time, state.step_number, state.start, state.forcing, state.bergs,
            state.fragments, state.contacts.rows, state.parameters.model_dump_json())}  # fmt: skip


def same(one: dict[str, Any], two: dict[str, Any]) -> bool:
    return one.keys() == two.keys() and all(
        one[name] == two[name]
        if name == "rest"
        else np.array_equal(one[name], two[name], equal_nan=two[name].dtype.kind == "f")
        for name in one
    )


@pytest.mark.parametrize("count", [25, pytest.param(300, marks=pytest.mark.slow)])
def test_no_restart_with_a_flipped_bit_is_taken_with_another_result(tmp_path: Path, count: int) -> None:
    """Of 150 there were 34."""
    model, draw = FakeModel(), random.Random(1)
    model.advance(0.2)
    path = save(
        model, tmp_path / "a.restart.nc", extra={"next_element": model.elements.size + 1, "own": np.arange(40.0)}
    )
    raw, sound = path.read_bytes(), held(load_state(path))
    refused = 0
    for _ in range(count):
        flipped = bytearray(raw)
        flipped[draw.randrange(len(raw))] ^= 1 << draw.randrange(8)
        path.write_bytes(flipped)
        try:
            state = load_state(path)
        except RiftbergError:
            refused += 1
        else:
            assert same(held(state), sound)
    assert refused > count // 10


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", ["element_lon", "bond_damage", "extra/own", "element_mass", "time"])
def test_a_number_that_could_be_is_refused_where_it_was_not_written(tmp_path: Path, name: str) -> None:
    import netCDF4

    model = FakeModel()
    model.advance(0.2)
    path = save(model, tmp_path / "a.restart.nc", extra={"own": np.arange(40.0)})
    with netCDF4.Dataset(path, "a") as file:
        values = np.array(file[name][...])
        values.view(np.uint64).flat[-1] ^= 1
        file[name][...] = values
    with pytest.raises(RiftbergError, match="its values are not those that were written"):
        load_state(path)


def test_a_member_whose_numbers_changed_on_the_disk_is_done_again(tmp_path: Path) -> None:
    store = Store.__new__(Store)
    store.members, store.done, store._fragments, store._means, store._message = tmp_path, {}, 0, set(), 1
    store.keep(Outcome(3, "done", totals={"pieces": 2.0, "largest_area": 5e7}, track=[[0.0, 1.0, -38.0, -55.0]]))
    file = tmp_path / "00003.json"
    assert store.outcome(3) is not None
    text = file.read_text()
    for old, new in (("50000000.0", "50000001.0"), ("-38.0", "-39.0"), ('"done"', '"dooe"')):
        assert old in text
        file.write_text(text.replace(old, new))
        assert store.outcome(3) is None
    kept = json.loads(text)
    del kept["checksum"]
    file.write_text(json.dumps(kept))
    assert store.outcome(3) is None


def flipped_digits(text: str) -> list[str]:
    """Return texts of JSON in which one bit of a digit has flipped, so that it is another one."""
    return [
        text[:k] + chr(ord(digit) ^ 1) + text[k + 1 :]
        for k, digit in enumerate(text)
        if digit in "02468" and text[k - 1 : k] not in "xu\\"
    ]


def test_the_plan_of_a_sweep_whose_numbers_changed_on_the_disk_is_not_gone_on_with(tmp_path: Path) -> None:
    """The other members were drawn from other numbers, or ran for another time, without a word."""
    out = tmp_path / "out"
    words = ["sweep", "a68a", "--vary", "fracture.normal_strength=~normal(18 kPa, 2 kPa)", "--members", "2",
             "--days", "0.02", "--workers", "0", "--no-map", "-q", "-o", str(out)]  # fmt: skip
    made = CliRunner().invoke(app, words)
    assert made.exit_code == 0, made.output
    text = (out / "sweep.json").read_text()
    flips = flipped_digits(text)
    assert len(flips) > 8
    again = ["sweep", "--resume", str(out), "--members", "4", "--no-map", "-q", "--workers", "0"]
    for flipped in flips:
        (out / "sweep.json").write_text(flipped)
        said = CliRunner().invoke(app, again)
        assert said.exit_code == 2
        told = " ".join(said.output.split())
        assert "not the plan of a sweep, or a damaged one" in told
        assert "its values are not those that were written" in told
    (out / "sweep.json").write_text(text)
    assert CliRunner().invoke(app, again).exit_code == 0
    assert open_sweep(out).sizes["member"] == 4


def test_weights_and_pieces_that_changed_on_the_disk_are_refused(tmp_path: Path) -> None:
    """After new sightings each weight, and what a forecast draws anew from, is read back from the folder."""
    store = Store.__new__(Store)
    store.folder = tmp_path
    store.set_base([0.5, -2.0])
    text = (tmp_path / "weights.json").read_text()
    for flipped in flipped_digits(text):
        (tmp_path / "weights.json").write_text(flipped)
        with pytest.raises(InputError, match=r"weights\.json: damaged weights of members \(its values are not"):
            store.weights()
    (tmp_path / "members").mkdir()
    write_record(tmp_path / "members" / "00000.json", {"shapes": [[1, [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]]]]})
    assert read_pieces(tmp_path, 0)[0][1][2] == [4.0, 2.0]
    file = tmp_path / "members" / "00000.json"
    file.write_text(file.read_text().replace("4.0", "5.0"))
    with pytest.raises(InputError, match=r"00000\.json: a damaged member .*--resume"):
        read_pieces(tmp_path, 0)
