"""How well Riftberg drifts on observed bergs: the suite of docs/explanation/skill.md, and its tables in docs/evidence/skill.md.

The data stand in a folder of their own (``juliette/forcing.nc`` and ``observed.csv``, ``b09f/track.csv``, ``sih2026/tracks.csv``)
beside ``samples`` with a day of altimetry and a coarse sea floor; they are not part of the project. From the root:

    python benchmarks/skill.py suite DATA/skill SUITE      # writes the suite, for `riftberg verify-tracks --suite SUITE`
    python benchmarks/skill.py tables SUITE                # runs it and writes the tables beside those measured before
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from riftberg.ocean.balance import balancing_slope
from riftberg.verification.scores import distance
from riftberg.verification.suite import read_suite, tables

PAGE = Path(__file__).resolve().parent.parent / "docs" / "evidence" / "skill.md"

SERIES = ("uo", "vo", "ua", "va", "ice_fraction", "ice_thickness", "ui", "vi")
PAIRS = {
    "juliette": ("topaz4", 1000.0), "juliette-500": ("topaz4", 500.0), "juliette-2000": ("topaz4", 2000.0),
    "juliette-205": ("topaz4_small", 205.0), "juliette-glorys": ("glorys", 205.0),
    "juliette-global": ("global_analysis", 205.0),
}  # fmt: skip
"""Ocean and size (m) of each case of the berg Juliette."""

LEADS = {"juliette": (24, 48, 71), "b09f": (24, 48, 72, 120, 168), "sih2026": (48, 96, 144, 240, 336)}  # hours
TERMS = {
    "juliette": "github.com/lia-f-h/openberg_custom_juliette at aa21a951; positions of ACCIBERG; fields generated using E.U. "
    "Copernicus Marine Service information",
    "b09f": "BYU/NIC, doi:10.1109/JSTARS.2017.2784186, from github.com/movingpandas/movingpandas-examples at 76ef15d4; DUACS",
    "sih2026": "github.com/adi230306/SIH-iceberg-tracking-and-navigation at a1b0b53b; BYU/NIC; fields generated using E.U. "
    "Copernicus Marine Service information, contains modified Copernicus Climate Change Service information",
}
LICENCE = "none stated by the repository: numbers alone are published"


def former_slope(lat: float, u: np.ndarray, v: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the slope that balances the running mean over 24 hours, as it was before; ``width``: 24 hours in records."""

    def mean(a: np.ndarray) -> np.ndarray:
        total, n = np.concatenate([[0.0], np.cumsum((a[1:] + a[:-1]) / 2.0)]), a.size
        low = np.clip(np.arange(n) - width // 2, 0, max(n - 1 - width, 0))
        high = np.minimum(low + width, n - 1)
        return (total[high] - total[low]) / np.maximum(high - low, 1)

    return balancing_slope(np.full(u.size, lat), mean(u), mean(v))


def write(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table."""
    with path.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(columns)
        table.writerows(rows)


STARTS = ("berg", "date", "lon", "lat", "length", "width", "thickness", "date_before", "lon_before", "lat_before")


def write_series(
    folder: Path, name: str, rows: Iterable[tuple[str, datetime, float, float, dict[str, np.ndarray]]]
) -> None:
    """Write the series of all starts twice: as given, and with the slope as it was before."""
    plain, sloping = [], []
    for berg, start, lat, hours, values in rows:
        times = 3600.0 * hours * np.arange(values["uo"].size)
        slopes = former_slope(lat, values["uo"], values["vo"], round(24.0 / hours))
        for k, time in enumerate(times):
            row = [berg, start.isoformat(), time, *(f"{v[k]:.8g}" for v in values.values())]
            plain.append(row)
            sloping.append([*row, *(f"{slope[k]:.8g}" for slope in slopes)])
    names = ("berg", "start", "time", *values)
    write(folder / name, names, plain)
    write(folder / "former.csv", (*names, "ssh_slope_x", "ssh_slope_y"), sloping)


def write_case(folder: Path, kind: str, sentence: str, more: str) -> None:
    """Write what a case is."""
    leads = ", ".join(f"{lead} h" for lead in LEADS[kind])
    (folder / "case.yaml").write_text(
        f"sentence: {sentence}\nsource: {TERMS[kind]}\nlicence: '{LICENCE}'\nleads: [{leads}]\n{more}", encoding="utf-8"
    )


def juliette(data: Path, folder: Path, ocean: str, size: float) -> None:
    """Write a case of the tagged berg in one ocean, with one size."""
    folder.mkdir(parents=True)
    ds = xr.open_dataset(data / "juliette" / "forcing.nc")
    seen = pd.read_csv(data / "juliette" / "observed.csv", parse_dates=["time"])
    when = seen.time.values.astype("datetime64[s]").astype(float)
    write(
        folder / "observed.csv", ("berg", "date", "lon", "lat"), (("Juliette", t, x, y) for t, y, x, _ in seen.values)
    )

    def at(date: np.datetime64) -> tuple[float, float] | None:
        time = date.astype("datetime64[s]").astype(float)
        after = int(np.searchsorted(when, time))
        for k in (after - 1, after):
            if 0 <= k < when.size and abs(when[k] - time) < 60.0:
                return float(seen.lon[k]), float(seen.lat[k])
        if not 0 < after < when.size or when[after] - when[after - 1] > 7.5 * 3600.0:
            return None
        return tuple(float(np.interp(time, when, seen[name])) for name in ("lon", "lat"))

    chosen = [
        k
        for k in range(ds.sizes["case"])
        if str(ds.ocean[k].values) == ocean and abs(float(ds.length[k]) - size) < 0.2 * size
    ]
    starts, series, stored = [], [], []
    for k in chosen:
        one, date = ds.isel(case=k), ds.start.values[k]
        place, before = at(date), at(date - np.timedelta64(24, "h"))
        if place is None:
            continue
        start, side = pd.Timestamp(date).to_pydatetime(), float(np.sqrt(one.length * one.width))
        earlier = ("", "", "") if before is None else ((start - timedelta(days=1)).isoformat(), *before)
        starts.append(("Juliette", start.isoformat(), *place, side, side, float(one.sail + one.draft), *earlier,
                       float(one.depth[0]), float(one.draft)))  # fmt: skip
        values = {name: pd.Series(one[name].values.astype(float)).ffill().fillna(0.0).values for name in SERIES}
        series.append(("Juliette", start, place[1], 1.0, values))
        stored += [("Juliette", start.isoformat(), h / 24.0, float(one.openberg_lon[h]), float(one.openberg_lat[h]))
                   for h in LEADS["juliette"] if int(one.hours) > h]  # fmt: skip
    write(folder / "starts.csv", (*STARTS, "depth", "draft"), starts)
    write(folder / "openberg.csv", ("berg", "start", "lead_days", "lon", "lat"), stored)
    write_series(folder, "forcing.csv", series)
    write_case(folder, "juliette", f"One tagged berg in Baffin Bay, {size:g} m long, in the ocean {ocean}.", """unit: start
within: 7.5 h
forcing: {along: forcing.csv, hold: 1 h}
subsets: {afloat: draft <= depth}
hindcast: true
entrants:
  OpenBerg 1.14.9: forecasts openberg.csv
  no slope: riftberg forcing.sea_level=none
  no floor: riftberg grounding.law=none
  neither: riftberg forcing.sea_level=none grounding.law=none
  no wind: riftberg forcing.wind=none
  water drag x 3: riftberg drag.ocean_scale=3
  water drag x 5: riftberg drag.ocean_scale=5
  0.29 times the current: current x 0.29
  no capture by ice: riftberg sea_ice.capture=none
  former slope: riftberg forcing.along=former.csv
""")  # fmt: skip


def b09f(data: Path, folder: Path) -> None:
    """Write the case of two giant bergs in one day of altimetry, held."""
    folder.mkdir(parents=True)
    track = pd.read_csv(data / "b09f" / "track.csv", parse_dates=["date"])
    track["date"] += pd.Timedelta("12 h")
    write(folder / "observed.csv", ("berg", "date", "lon", "lat"), track[["berg", "date", "lon", "lat"]].values)
    starts = []
    for berg, (length, width) in {"B09F": (33e3, 13e3), "A57A": (20e3, 9e3)}.items():
        own = track[track.berg == berg].set_index("date")
        for date in pd.date_range("2019-02-21 12:00", "2019-02-26 12:00"):
            before = date - pd.Timedelta(days=3)
            if date in own.index and before in own.index:
                place = own.lon[date], own.lat[date]
                earlier = before, own.lon[before], own.lat[before]
                starts.append((berg, date, *place, length, width, 200.0, *earlier, 1500.0))
    write(folder / "starts.csv", (*STARTS, "radius"), starts)
    day = xr.open_dataset(data.parent / "samples" / "nrt_global_allsat_phy_l4_20190223_20190226.nc")
    box = day.sel(latitude=slice(-64, -50), longitude=slice(295, 345)).isel(time=0)
    fields = xr.concat([box[["ugos", "vgos", "adt"]]] * 2, pd.DatetimeIndex(["2019-02-20", "2019-03-10"], name="time"))
    fields.to_netcdf(folder / "field.nc")
    sentence = "Two giant bergs in one day of altimetry, held for eight days, without wind."
    write_case(folder, "b09f", sentence, """forcing:
  files: [{file: field.nc, names: {uo: ugos, vo: vgos, ssh: adt}}]
  max_gap: 30 d
  wind: none
subsets: {B09F: berg == B09F, A57A: berg == A57A}
entrants:
  slope from the current: riftberg forcing.sea_level=geostrophic
  no slope: riftberg forcing.sea_level=none
""")  # fmt: skip


def sih2026(data: Path, folder: Path) -> None:
    """Write the case of giant bergs driven along their tracks."""
    folder.mkdir(parents=True)
    table = pd.read_csv(data / "sih2026" / "tracks.csv", parse_dates=["date"])
    counted = table[table.counts == 1]
    write(folder / "observed.csv", ("berg", "date", "lon", "lat"), counted[["berg", "date", "lon", "lat"]].values)
    floor = xr.open_dataset(data.parent / "samples" / "srtm15_coarsened.nc").z
    starts, series = [], []
    for berg, own in table.groupby("berg"):
        own = own.reset_index(drop=True)
        for k in range(len(own)):
            days = (own.date[k] - own.date[:k]).dt.days
            before = [j for j in range(k) if own.counts[j] and 2 <= days[j] <= 6]
            if not own.counts[k] or not before:
                continue
            earlier = max([j for j in before if days[j] >= 4] or before)
            chain = []
            for j in range(k + 1, len(own)):
                if not own.whole[j] or (own.date[j] - own.date[k]).days > 14:
                    break
                chain.append(j)
            if not any(own.counts[j] and 24 * (own.date[j] - own.date[k]).days in LEADS["sih2026"] for j in chain):
                continue
            hours = np.arange(0.0, 14 * 24 + 1, 6.0)
            values = {name: np.full(hours.size, own[name][chain[-1]], float) for name in SERIES[:4]}
            for j in chain:
                end = 24.0 * (own.date[j] - own.date[k]).days
                inside = (hours > end - own.segment_hours[j]) & (hours <= end)
                for name, column in values.items():
                    column[inside] = own[name][j]
            for name, column in values.items():
                column[0] = own[name][chain[0]]
            side = 1e3 * float(np.sqrt(own.length_km[k] * own.width_km[k]))
            sea = -float(floor.interp(lon=own.lon[k], lat=own.lat[k]))
            moved = float(distance(own.lon[earlier], own.lat[earlier], own.lon[k], own.lat[k])) / days[earlier]
            starts.append((berg, own.date[k], own.lon[k], own.lat[k], side, side, 250.0, own.date[earlier], own.lon[earlier],
                           own.lat[earlier], f"{sea:.0f}", f"{moved:.6g}"))  # fmt: skip
            series.append((berg, own.date[k].to_pydatetime(), own.lat[k], 6.0, values))
    write(folder / "starts.csv", (*STARTS, "sea", "moved"), starts)
    write_series(folder, "forcing.csv", series)
    write_case(folder, "sih2026", "Giant bergs of the Southern Ocean, the open half.", """unit: berg
forcing: {along: forcing.csv}
subsets: {deep: sea >= 2000, shelf: sea < 1000, moving: moved >= 3}
hindcast: true
entrants:
  no slope: riftberg forcing.sea_level=none
  no wind: riftberg forcing.wind=none
  water drag x 5: riftberg drag.ocean_scale=5
  0.29 times the current: current x 0.29
""")  # fmt: skip


def write_suite(data: Path, folder: Path) -> None:
    """Write all cases."""
    for name, pair in PAIRS.items():
        juliette(data, folder / name, *pair)
    b09f(data, folder / "b09f")
    sih2026(data, folder / "sih2026")


# ---- tables -----------------------------------------------------------------------------------------------------------------

THEN = "forcing.along=former.csv sea_ice.capture=none drag.water_base=0.0012 drag.air_top=0.0055"
"""As Riftberg was at 1d8dca15: the slope from a mean over 24 hours, no pack that holds, KID's drag. The floor was a drag."""

NOT_OURS = ("OpenBerg 1.14.9", "current", "current x 0.29", "constant velocity", "staying put")

MEASURED = {
    ("juliette", "all"): {
        "riftberg": "8.9 / 16.2 / 20.9", "OpenBerg 1.14.9": "10.1 / 18.7 / 23.3",
        "riftberg forcing.sea_level=none": "13.4 / 23.1 / 30.0", "riftberg grounding.law=none": "11.3 / 18.9 / 26.9",
        "riftberg forcing.sea_level=none grounding.law=none": "15.4 / 25.7 / 34.8",
        "riftberg forcing.wind=none": "10.4 / 18.9 / 23.0", "riftberg drag.ocean_scale=3": "8.9 / 15.6 / 19.2",
        "riftberg drag.ocean_scale=5": "9.0 / 15.9 / 19.3", "current": "11.7 / 19.1 / 25.2",
        "current x 0.29": "15.4 / 25.3 / 33.3", "constant velocity": "10.3 / 22.5 / 28.7", "staying put": "17.1 / 28.6 / 37.5",
    },
    ("juliette", "afloat"): {
        "riftberg": "13.3 / 21.4 / 30.7", "OpenBerg 1.14.9": "15.2 / 25.3 / 34.5",
        "riftberg forcing.sea_level=none": "20.4 / 32.3 / 45.0", "staying put": "26.1 / 40.7 / 56.7",
    },
    ("juliette-500", "all"): {"riftberg": "10.8 / 18.7 / 21.2", "OpenBerg 1.14.9": "11.9 / 22.1 / 25.0"},
    ("juliette-2000", "all"): {"riftberg": "9.3 / 17.4 / 22.6", "OpenBerg 1.14.9": "10.2 / 18.8 / 23.5"},
    ("juliette-205", "all"): {"riftberg": "10.0 / 14.7 / 21.0", "OpenBerg 1.14.9": "11.1 / 17.6 / 21.8"},
    ("juliette-glorys", "all"): {"riftberg": "12.1 / 19.8 / 24.8", "OpenBerg 1.14.9": "12.2 / 20.6 / 24.7"},
    ("juliette-global", "all"): {"riftberg": "9.8 / 19.6 / 22.2", "OpenBerg 1.14.9": "11.1 / 21.2 / 19.6"},
    ("b09f", "B09F"): {
        "riftberg": "7.7 / 9.0 / 15.2 / 21.3 / 9.4", "riftberg forcing.sea_level=geostrophic": "8.2 / 10.1 / 14.9 / 16.9 / 13.3",
        "riftberg forcing.sea_level=none": "7.7 / 10.6 / 17.2 / 34.5 / 44.6", "current": "8.0 / 10.1 / 15.0 / 14.2 / 19.0",
        "constant velocity": "9.5 / 14.1 / 26.3 / 50.8 / 68.9", "staying put": "7.7 / 10.7 / 17.3 / 34.6 / 44.6",
    },
    ("b09f", "A57A"): {
        "riftberg": "2.9 / 9.4 / 16.4 / 7.7 / 9.7", "riftberg forcing.sea_level=geostrophic": "2.5 / 10.4 / 11.3 / 12.5 / 13.5",
        "riftberg forcing.sea_level=none": "0.3 / 8.2 / 8.2 / 11.2 / 13.6", "current": "2.2 / 10.3 / 11.3 / 12.2 / 13.1",
        "constant velocity": "8.8 / 16.9 / 21.5 / 28.8 / 40.0", "staying put": "0.0 / 8.1 / 8.1 / 11.2 / 13.7",
    },
    ("sih2026", "all"): {
        "riftberg": "23.8 / 40.0 / 55.1 / 83.0 / 108.7", "riftberg forcing.sea_level=none": "15.8 / 22.6 / 32.4 / 49.0 / 60.3",
        "riftberg forcing.wind=none": "22.5 / 37.1 / 51.6 / 78.1 / 102.3", "current": "22.5 / 37.3 / 51.5 / 78.0 / 102.4",
        "current x 0.29": "15.1 / 22.1 / 30.9 / 45.3 / 52.2", "constant velocity": "17.8 / 26.0 / 36.8 / 64.4 / 94.0",
        "staying put": "15.4 / 22.3 / 32.5 / 49.4 / 59.7",
    },
    ("sih2026", "deep"): {
        "riftberg": "19.3 / 27.2 / 36.5 / 57.5 / 73.6", "riftberg forcing.sea_level=none": "16.8 / 23.7 / 36.0 / 54.0 / 62.7",
        "riftberg forcing.wind=none": "18.6 / 25.8 / 34.0 / 51.9 / 65.1", "current": "18.6 / 25.9 / 33.8 / 52.0 / 65.8",
        "current x 0.29": "16.6 / 22.8 / 32.7 / 46.3 / 49.3", "constant velocity": "23.2 / 33.7 / 47.4 / 85.5 / 124.4",
        "staying put": "18.0 / 25.4 / 38.5 / 58.2 / 67.1",
    },
    ("sih2026", "shelf"): {
        "riftberg": "29.8 / 61.2 / 86.9 / 125.0 / 169.5", "riftberg forcing.sea_level=none": "12.6 / 21.3 / 26.0 / 44.9 / 70.6",
        "riftberg forcing.wind=none": "27.9 / 56.9 / 82.9 / 121.3 / 162.7", "current": "28.0 / 57.3 / 82.7 / 120.4 / 161.0",
        "current x 0.29": "10.7 / 18.8 / 24.0 / 39.1 / 54.0", "constant velocity": "9.7 / 13.5 / 17.3 / 31.9 / 49.9",
        "staying put": "8.4 / 14.7 / 18.5 / 35.9 / 58.5",
    },
}  # fmt: skip
"""Mean errors (km) by lead at 1d8dca15, by case and subset."""


def page_of(suite: Path) -> str:
    """Return tables of all cases: errors as measured, with the settings of then, and with the defaults of now."""
    lines = []
    cases = {case.file.name: case for case in read_suite(suite)}
    for (name, subset), rows in MEASURED.items():
        case, juliette = cases[name], name.startswith("juliette")
        ours = [row for row in rows if row not in NOT_OURS]
        then = {row: row.replace("riftberg", f"riftberg {THEN}" if juliette else "riftberg", 1) for row in ours}
        wanted = [*rows, *(f"then, {row}: {definition}" for row, definition in then.items() if juliette)]
        if juliette:  # the table holds the starts that all of these answer, whatever is in its rows
            wanted += [row for row in ("constant velocity", "staying put") if row not in rows]
        (result,) = tables([case], wanted)
        found = [row for row in result["rows"] if row["subset"] == subset]
        starts = " / ".join(str(row["starts"]) for row in found)
        leads = " / ".join(f"{24 * row['lead_days']:.0f} h" if juliette else f"{row['lead_days']:g} d" for row in found)
        lines += [
            f"**{name}, {subset}**: {starts} starts at {leads}", "",
            "| entrant | at 1d8dca15 | its settings now | defaults now | riftberg minus this, 90 % |", "|---|---|---|---|---|",
        ]  # fmt: skip
        for row, measured in rows.items():
            again = f"then, {row}" if juliette and row in ours else row
            mean = {key: " / ".join(f"{one['entrants'][key]['mean_km']:.1f}" for one in found) for key in (again, row)}
            lines.append(
                f"| {row} | {measured} | {mean[again]} | {mean[row] if row in ours else ''} | {paired(found, row)} |"
            )
        lines.append("")
    return "\n".join(lines)


def paired(found: Sequence[dict], row: str) -> str:
    """Return how far the reference is from an entrant, by lead."""
    cells = []
    for one in (one["entrants"][row] for one in found):
        if "reference_minus_this_km" in one:
            interval = one["difference_interval_km"]
            cells.append(
                f"{one['reference_minus_this_km']:.1f}"
                + (f" ({interval[0]:.1f}..{interval[1]:.1f})" if interval else "")
            )
    return ", ".join(cells)


BEGIN, END = "<!-- skill: begin -->", "<!-- skill: end -->"

if __name__ == "__main__":
    task, *paths = sys.argv[1:]
    if task == "suite":
        write_suite(*map(Path, paths))
    else:
        text = PAGE.read_text(encoding="utf-8")
        before, after = text.partition(BEGIN)[0], text.partition(END)[2]
        PAGE.write_text(f"{before}{BEGIN}\n\n{page_of(Path(paths[0]))}\n{END}{after}", encoding="utf-8")
