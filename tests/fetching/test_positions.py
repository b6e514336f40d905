"""Tables of named bergs: read by column, refused by name, and what ``riftberg new`` makes of them."""

from __future__ import annotations

import re
import zipfile
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from riftberg import read_observed
from riftberg.cli.main import app
from riftberg.diagnostics.observed import find_sighting, read_berg
from riftberg.errors import ForcingError, InputError
from riftberg.experiments.yaml_file import build_berg, read_file
from riftberg.fetching import fetch

TABLE = """date,ascat_1,ascat_2,ascat_3,nic_1,nic_2,nic_3,size_1,size_2
2021001,-60.0,-50.0,1,0,0,0,0,0
2021002,-60.5,-50.5,0,-60.4,-50.2,1,40,20
2021003,-60.6,-50.6,0,0,0,0,0,0
2021040,-61.0,-51.0,1,0,0,0,10,5
2021200,-62.0,-52.0,1,0,0,0,0,0
"""
USNIC = (
    "\ufeffIceberg,Length (NM),Width (NM),Latitude,Longitude,Remarks,Last Update\nX2,20,10,-65.5,40.25,,01/10/2021\n"
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "t").mkdir()
    (tmp_path / "t" / "x1.csv").write_text(TABLE)
    (tmp_path / "t" / "DownloadCurrent?pId=134").write_text(USNIC)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "t"


def call(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments))


def test_a_row_gives_the_best_sensor_that_saw_the_berg_and_keeps_the_flag(folder: Path) -> None:
    first, second, third, *_ = read_berg("X1", folder)
    assert (first.sensor, not first.interpolated, first.lon, first.lat, first.axes) == (
        "ascat",
        True,
        -50.0,
        -60.0,
        None,
    )
    assert (second.sensor, not second.interpolated, second.lat) == (
        "nic",
        True,
        -60.4,
    )  # that of the scatterometer is interpolated
    assert second.axes == (40 * 1852.0, 20 * 1852.0)
    assert (third.sensor, third.interpolated) == ("ascat", True)
    (one,) = read_berg("x2", folder)
    assert (one.when, one.lon, one.lat, one.axes) == (datetime(2021, 1, 10), 40.25, -65.5, (37040.0, 18520.0))


def test_a_date_without_a_fix_or_a_size_is_answered_with_the_nearest(folder: Path) -> None:
    rows = read_berg("X1", folder)
    known = find_sighting("X1", rows, datetime(2021, 1, 4))
    assert (known.fix.when, known.size.when) == (datetime(2021, 1, 2),) * 2
    # Before it became smaller: the last size before the date counts.
    assert find_sighting("X1", rows, datetime(2021, 2, 8)).size.axes[0] == 40 * 1852.0
    with pytest.raises(
        InputError, match=r"not seen within 3 days of 2021-01-20.*nearest dates are 2021-01-02 and 2021-02-09"
    ):
        find_sighting("X1", rows, datetime(2021, 1, 20))
    with pytest.raises(
        InputError, match="no size of X1 within 60 days of 2021-07-19; the nearest is of 2021-02-09: 19 km x 9 km"
    ):
        find_sighting("X1", rows, datetime(2021, 7, 19))
    assert find_sighting("X1", rows, datetime(2021, 7, 19), sized=False).fix.lat == -62.0


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("x1", "date,north,east\n2021001,-60,-50\n", "no columns of latitude and longitude"),
        ("x1", "date,nic_1,nic_2\n2021001,-60,fifty\n", "'fifty' is not a number"),
        ("list", "iceberg,lat,lon\nx1,-60,-50\n", "no column of dates"),
        ("x11", "date,nic_1,nic_2\n2021001,-60,-50\n", "no berg 'X1' in 1 tables.*Did you mean 'x11'"),
    ],
)
def test_tables_with_other_columns_are_refused_by_name(name: str, text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / f"{name}.csv").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_berg("X1", tmp_path)
    assert name in str(caught.value)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("2021400,-60.0,-50.0,1,0,0,0,40,20", "line 3, date: '2021400': 2021 has no day 400"),
        ("2021000,-60.0,-50.0,1,0,0,0,40,20", "line 3, date: '2021000': 2021 has no day 0"),
        ("2021003,-160.0,-50.0,1,0,0,0,40,20", "line 3: latitude -160, longitude -50 are no place on Earth"),
        ("2021003,-60.0,1050.0,1,0,0,0,40,20", "longitude 1050 are no place"),
        (
            "2021003,-60.0,-50.0,1,0,0,0,3000,2500",
            "line 3: axes of 3000 and 2500 nautical miles: no berg is that large",
        ),
        ("2021003,-60.0,-50.0,1,0,0,0,74080,37040", "Give them in nautical miles"),
    ],
)
def test_rows_that_no_berg_can_have_are_refused_by_line(row: str, words: str, tmp_path: Path) -> None:
    """Bug: all but the first were taken as they stood, day 400 as February of the next year; so were they by ``score``."""
    (tmp_path / "x1.csv").write_text("\n".join([*TABLE.splitlines()[:2], row]))
    for read in (lambda: read_berg("x1", tmp_path), lambda: read_observed(tmp_path / "x1.csv")):
        with pytest.raises(InputError, match=re.escape(words)):
            read()


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("X2,20,10,-65.5,40.25,,13/45/2021", "'13/45/2021' is no date of the form month/day/year"),
        ("X2,20,10,-655,40.25,,01/10/2021", "latitude -655, longitude 40.25 are no place on Earth"),
        ("X2,20000,10,-65.5,40.25,,01/10/2021", "axes of 20000 and 10 nautical miles"),
    ],
)
def test_rows_of_the_ice_center_too(row: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "DownloadCurrent?pId=134").write_text(f"{USNIC.splitlines()[0]}\n{row}\n", encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(words)):
        read_berg("x2", tmp_path)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--size", "60,30"], "--size: '60' has no unit"),
        (["--size", "60 km, 30"], "--size: '30' has no unit"),
        (["--size", "6000 km,3000 km"], "no berg is that large"),
        (["--azimuth", "nan"], "--azimuth: nan is not possible"),
        (["--outline", "absent.geojson"], "absent.geojson: file not found"),
        (["--outline", "two.csv"], "two.csv"),
    ],
)
def test_a_shape_that_cannot_be_is_refused_before_a_file_is_written(
    options: list[str], words: str, folder: Path
) -> None:
    """Bug: 60,30 without a unit made a berg of 60 by 30 metres, NaN an outline of NaN, and no file was looked for."""
    Path("two.csv").write_text("lon,lat\n-50,-60\n-49,-60\n")
    done = call("new", "X1", "--date", "2021-01-03", "--tables", str(folder), "-o", "x.yaml", *options)
    assert done.exit_code == 2
    assert words in done.output
    assert not Path("x.yaml").exists()


def test_fetched_tables_are_unpacked_into_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fetched(name: str, digest: Any, folder: Path, base: str, *more: Any, **options: Any) -> Path:
        with zipfile.ZipFile(folder / name, "w") as archive:
            archive.writestr("updated7_consol/X1.csv", TABLE)
            archive.writestr("updated7_consol/README.TXT", "words")
            archive.writestr("../../outside.csv", TABLE)
        return folder / name

    monkeypatch.setattr(fetch, "fetch_one", fetched)
    result = call("fetch", "byu", "-o", str(tmp_path / "byu"), "-q")
    assert result.exit_code == 0, result.output
    assert "2 tables" in result.output
    assert sorted(path.name for path in (tmp_path / "byu").glob("*.csv")) == ["outside.csv", "x1.csv"]
    assert len(read_berg("X1", tmp_path / "byu")) == 5


def zipped(path: Path, members: dict[str, str]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return path


def test_a_file_of_the_user_is_not_overwritten_by_a_table_of_its_name(tmp_path: Path) -> None:
    """Bug: it was, and through a link a file in another folder."""
    (tmp_path / "mine.csv").write_text("PRECIOUS")
    (tmp_path / "victim.txt").write_text("PRECIOUS")
    (tmp_path / "link.csv").symlink_to(tmp_path / "victim.txt")
    (tmp_path / "nowhere.csv").symlink_to(tmp_path / "made.txt")
    for name in ("mine", "MINE", "link", "nowhere"):
        archive = zipped(tmp_path / "d.zip", {"a/new.csv": "new", f"a/{name}.csv": "other"})
        with pytest.raises(ForcingError, match=rf"{name.lower()}\.csv: is there already.*Move it away"):
            fetch.unpack_tables(archive, tmp_path)
        assert not (tmp_path / "new.csv").exists()
    assert (tmp_path / "mine.csv").read_text() == (tmp_path / "victim.txt").read_text() == "PRECIOUS"
    assert not (tmp_path / "made.txt").exists()


def test_tables_of_a_newer_database_take_the_place_of_the_older_ones_but_not_of_edited_ones(tmp_path: Path) -> None:
    for text in ("first", "second", "second"):
        (table,) = fetch.unpack_tables(zipped(tmp_path / "d.zip", {"a/x.csv": text}), tmp_path)
        assert table.read_text() == text
    table.write_text("edited")
    with pytest.raises(ForcingError, match=r"x\.csv: is there already"):
        fetch.unpack_tables(zipped(tmp_path / "d.zip", {"a/x.csv": "third"}), tmp_path)
    assert table.read_text() == "edited"


@pytest.mark.parametrize("fault", ["flipped", "cut", "lies of its size", "not of this kind"])
def test_a_damaged_database_is_removed_and_told(fault: str, tmp_path: Path) -> None:
    """Bug: a bare BadZipFile, or a cut archive taken for a table."""
    archive = zipped(tmp_path / "d.zip", {"a.csv": "hello world" * 1000})
    raw = bytearray(archive.read_bytes())
    if fault == "flipped":
        raw[50] ^= 0xFF
    elif fault == "cut":
        del raw[-10:]
    elif fault == "lies of its size":
        place = raw.rfind(b"PK\x01\x02")
        raw[place + 24 : place + 28] = (10).to_bytes(4, "little")
    else:
        raw[8] = raw[raw.rfind(b"PK\x01\x02") + 10] = 77  # a method of compression that nobody has
    archive.write_bytes(raw)
    with pytest.raises(
        ForcingError, match=r"d\.zip: a damaged zip archive.*It was removed: run the same command again"
    ):
        fetch.unpack_tables(archive, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"a/b.csv": "one", "c/B.CSV": "two"}, r"holds b\.csv twice"),
        ({"readme.txt": "words"}, r"holds no \.csv files"),
        ({"__MACOSX/a.csv": "fork", "b/._c.csv": "fork"}, r"holds no \.csv files"),
        ({"\x1b[2Ja.csv": "one"}, r"which is no name for a file"),
        ({"a\nb.csv": "one"}, r"which is no name for a file"),
        ({".hidden.csv": "one"}, r"which is no name for a file"),
        ({f"{'a' * 300}.csv": "one"}, r"which is no name for a file"),
        ({"C:a.csv": "one"}, r"which is no name for a file"),
        ({"-rf.csv": "one"}, r"which is no name for a file"),
        ({"a.csv": "0" * 250_000_000}, r"holds 250 MB of \.csv files"),
    ],
)
def test_a_database_that_cannot_be_unpacked_is_refused(members: dict[str, str], words: str, tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match=words):
        fetch.unpack_tables(zipped(tmp_path / "d.zip", members), tmp_path)
    assert not list(tmp_path.glob("*.csv"))


def test_what_macos_packs_beside_a_table_is_no_table(tmp_path: Path) -> None:
    """Bug: "holds a.csv twice"; and others of its files were unpacked as tables."""
    archive = zipped(tmp_path / "d.zip", {"a.csv": "one", "__MACOSX/a.csv": "fork", "__MACOSX/._a.csv": "fork"})
    assert [table.read_text() for table in fetch.unpack_tables(archive, tmp_path)] == ["one"]


@pytest.mark.parametrize("record", ["[]", "{", "null", "\xff"])
def test_with_a_damaged_record_of_what_was_unpacked_all_tables_are_the_users(record: str, tmp_path: Path) -> None:
    """Bug: a bare JSONDecodeError or AttributeError."""
    archive = zipped(tmp_path / "d.zip", {"a.csv": "theirs"})
    (tmp_path / ".d.zip.json").write_text(record, encoding="latin-1")
    (tmp_path / "a.csv").write_text("mine")
    with pytest.raises(ForcingError, match=r"a\.csv: is there already"):
        fetch.unpack_tables(archive, tmp_path)
    (tmp_path / "a.csv").unlink()
    (tmp_path / "a.csv").mkdir()
    with pytest.raises(ForcingError, match=r"a\.csv: is there already"):
        fetch.unpack_tables(archive, tmp_path)
    (tmp_path / "a.csv").rmdir()
    assert [table.read_text() for table in fetch.unpack_tables(archive, tmp_path)] == ["theirs"]


def test_an_experiment_is_written_that_reads_and_has_the_listed_size(folder: Path) -> None:
    for shape, area in (("ellipse", 0.7854), ("rectangle", 1.0)):
        result = call(
            "new",
            "X1",
            "--date",
            "2021-01-03",
            "--tables",
            "t",
            "--shape",
            shape,
            "--azimuth",
            "0",
            "-o",
            f"{shape}.yaml",
        )
        assert result.exit_code == 0, result.output
        experiment, parameters, _ = read_file(Path(f"{shape}.yaml"))
        made = build_berg(experiment, parameters, Path())
        assert made.area == pytest.approx(area * 40 * 20 * 1852.0**2, rel=0.02)
        assert made.centroid == pytest.approx((-50.2, -60.4), abs=0.02)
        stretch = (made.elements.lat.max() - made.elements.lat.min()) * 111.2e3
        assert stretch == pytest.approx(40 * 1852.0, rel=0.05)  # towards the north
        assert experiment.forcing.latitude[0] < -65.0
    assert "riftberg fetch glorys --lon -65,-35 --lat -67,-54 --time 2021-01-02,2021-01-15" in result.output
    assert "Axes of 74 km and 37 km, listed by NIC on 2021-01-02, as a rectangle" in result.output


def test_what_is_wrong_is_said(folder: Path) -> None:
    for words, more in (
        ("is no shape", ("--shape", "star")), ("is not two lengths", ("--size", "3 km")), ("no such folder", ("--tables", "no")),
    ):  # fmt: skip
        result = call("new", "X1", "--date", "2021-01-03", "--tables", "t", *more)
        assert result.exit_code == 2
        assert words in result.output
    assert "'riftberg fetch byu'" in call("new", "X1", "--date", "2021-01-03").output


@pytest.mark.parametrize(("berg", "date", "axes"), [("A68a", "2020-12-09", None), ("A76a", "2021-08-01", (73, 14))])
def test_bergs_of_version_5(berg: str, date: str, axes: Any, shared: Path, tmp_path: Path) -> None:
    file = tmp_path / "it.yaml"
    result = call("new", berg, "--date", date, "--tables", str(shared / "data" / "tracks"), "-o", str(file))
    assert result.exit_code == 0, result.output
    experiment, parameters, _ = read_file(file)
    made = build_berg(experiment, parameters, tmp_path)
    if axes:
        assert made.area == pytest.approx(0.7854 * axes[0] * axes[1] * 1852.0**2, rel=0.02)
        assert made.centroid == pytest.approx((-59.3449, -74.5542), abs=0.1)
    else:
        assert made.centroid == pytest.approx((-39.3782, -55.0105), abs=0.05)
