"""The table of namelist entries is complete, and every entry is classified."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from riftberg.config.parameter_groups import NORTHERN_CLASSES, SOUTHERN_CLASSES, ClassTable
from riftberg.kid.entries import GROUPS, ICEBERGS, Entry, convert
from riftberg.kid.parameters import read_namelist
from scripts import ROOT

from .conftest import namelist_text

DRIVER = GROUPS["icebergs_driver_nml"]
KID = ROOT / "src" / "riftberg" / "kid"
HONOURED = "honoured"
REFUSED = "refused"
REPORTED = "reported"

KINDS = {"L": "logical", "I": "integer", "I8": "integer", "R": "real", "R10": "reals"}


def spec_rows(shared: Path, begin: str, end: str) -> list[list[str]]:
    text = (shared / "spec" / "thermodynamics_calving_coupling_io.md").read_text()
    part = text.split(begin)[1].split(end)[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line.startswith("|")]
    return [row for row in rows if row[0] not in ("name",) and not row[0].startswith("---")]


def test_counts() -> None:
    assert len(ICEBERGS) == 163
    assert len(DRIVER) == 25
    for entries in GROUPS.values():
        assert len({e.name.lower() for e in entries}) == len(entries)


@pytest.mark.quick(23)
@pytest.mark.parametrize("entry", [*ICEBERGS, *DRIVER], ids=lambda e: e.name)
def test_every_entry_is_classified(entry: Entry) -> None:
    assert entry.treatment in (HONOURED, REFUSED, REPORTED)
    assert entry.meaning
    if entry.treatment == REPORTED:
        assert entry.note
    if entry.treatment == REFUSED:
        assert entry.note
        assert entry.remedy
        assert entry.accepted is not None
    assert convert(entry, list(entry.default) if isinstance(entry.default, tuple) else entry.default) == entry.default


def test_names_types_and_defaults_are_those_of_the_specification(shared: Path) -> None:
    for entries, begin, end in ((ICEBERGS, "### 7.1", "### 7.2"), (DRIVER, "### 7.2", "## 8.")):
        rows = spec_rows(shared, begin, end)
        wanted = [(name.strip(), row[1], row[2]) for row in rows for name in row[0].split(",")]
        assert [w[0] for w in wanted] == [e.name for e in entries]
        for (_, kind, default), entry in zip(wanted, entries, strict=True):
            assert entry.kind == KINDS.get(kind, "text")
            if kind == "L":
                assert entry.default is (default == "T")
            elif kind in ("I", "I8", "R") and not default.startswith("largest"):
                assert entry.default == float(default.replace("\u2212", "-"))
            elif entry.kind == "text":
                assert entry.default == default.strip("'")


def test_no_entry_that_the_mapping_reads_is_called_without_effect() -> None:
    """Every name read by the mapping of parameters and by the trajectories is honoured, and the other way round."""
    source = (KID / "parameters.py").read_text() + (KID / "trajectories.py").read_text()
    read = set(re.findall(r'(?:flag|number|whole|text)\("(\w+)"\)', source))
    by_name = {e.name: e for e in (*ICEBERGS, *DRIVER)}
    assert len(read) > 60
    for name in read:
        assert by_name[name].treatment == HONOURED, name


def test_honoured_entries_are_read_somewhere() -> None:
    source = "".join(p.read_text() for p in KID.glob("*.py") if p.name != "entry_table.py")
    for entry in (*ICEBERGS, *DRIVER):
        if entry.treatment == HONOURED:
            assert f'"{entry.name}"' in source, entry.name


def test_lookup_ignores_case(tmp_path: Path) -> None:
    (tmp_path / "input.nml").write_text(namelist_text({}, {"lOw_RATIO": 1.25}))
    assert read_namelist(tmp_path / "input.nml").icebergs.number("LoW_ratio") == 1.25


@pytest.mark.parametrize(("end", "classes"), [("", SOUTHERN_CLASSES), ("_n", NORTHERN_CLASSES)])
def test_size_classes_of_own_runs_are_those_of_the_namelist(end: str, classes: ClassTable) -> None:
    names = ("initial_mass", "distribution", "mass_scaling", "initial_thickness")
    default = {entry.name: entry.default for entry in ICEBERGS}
    table = [default[f"{name}{end}"] for name in names]
    assert table == [classes.mass, classes.fraction, classes.scaling, classes.thickness]
