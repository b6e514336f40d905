"""A run as one web page that works without a network: play, scrub, zoom, and see why it broke.

Everything the page needs is in the page: quantised arrays in base64, the script and the style of
``replay_template.html``. Positions are projected here (`riftberg.plane`), so that the page draws plain metres.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.diagnostics.summary import melt_lines, melted_words
from riftberg.errors import InputError
from riftberg.plane import ConformalPlane, ellipses, ranges
from riftberg.runs.background import StoredWater, interpolate_evenly, stored_water
from riftberg.runs.layout import run_heading
from riftberg.runs.scene import Scene
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import write_text
from riftberg.version import __version__
from riftberg.viz.coast import clip_coast
from riftberg.viz.colours import FRAGMENTS, SMALL
from riftberg.viz.ensemble import choose_tracks
from riftberg.viz.style import degree_label

_MISSING: Final = {"int16": -32768, "uint16": 65535, "uint8": 255}
_LIMITS: Final = {"int16": (-32767, 32767), "uint16": (0, 65534), "uint8": (0, 254)}


def quantise(values: NDArray[Any], kind: str = "int16", *, step: float | None = None) -> dict[str, Any]:
    """Quantise an array."""
    low, high = _LIMITS[kind]
    values = np.asarray(values, np.float64)
    finite = np.isfinite(values)
    # Whole numbers must come back as they were; others use the whole range of the integers.
    if step is not None:
        scale, offset = step, 0.0
    else:
        least, most = (float(values[finite].min()), float(values[finite].max())) if finite.any() else (0.0, 0.0)
        scale = (most - least) / (high - low) or 1.0
        offset = least - scale * low
    numbers = np.clip(np.rint((np.where(finite, values, 0.0) - offset) / scale), low, high)
    stored = np.where(finite, numbers, _MISSING[kind]).astype(np.dtype(kind).newbyteorder("<"))
    return {
        "kind": kind,
        "shape": list(values.shape),
        "scale": scale,
        "offset": offset,
        "missing": _MISSING[kind],
        "data": base64.b64encode(stored.tobytes()).decode("ascii"),
    }


LARGEST: Final = 10e6
"""Size of the page (bytes) above which records are left out."""

_ELEMENT_BYTES = 2 * 6 * 4 / 3  # six integers of two bytes for an element at a record, in base64
_ISOBATHS = (50, 100, 150, 200, 300, 400, 500, 1000, 2000, 3000, 4000, 5000)
_THIN = 300.0  # m between the points of an observed outline

MOST_VALUES: Final = 1_500_000
"""Values of the probability of ice on cells in the page; times are left out evenly above it."""


@dataclass(frozen=True)
class ForecastMembers:
    """A forecast around the run, which `riftberg replay` shows with the control."""

    result: xr.Dataset  # From `riftberg.open_sweep`
    scenarios: Sequence[tuple[int, float, str]]  # Number, probability and words, the likeliest first
    words: str  # The likeliest outcome, in a line


def write_replay(
    run: xr.Dataset,
    path: str | Path,
    *,
    title: str = "",
    observed: Mapping[str, Sequence[Floats]] | None = None,
    largest: float = LARGEST,
    members: ForecastMembers | None = None,
) -> Path:
    """Write the replay of a run.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.runs.run_file.open_run`.
    path : path
        The page.
    title : str, optional
        Heading; by default the experiment.
    observed : mapping, optional
        Observed outlines: ISO day to rings of longitude and latitude.
    largest : float, optional
        Size in bytes above which records are left out evenly.
    members : Members, optional
        The forecast of which the run is the control.

    Returns
    -------
    pathlib.Path
    """
    if run.sizes["time"] < 1:
        raise InputError("the run has no records yet", where=str(run.encoding.get("source", "run")))
    content = ReplayContent(run, title=title, observed=observed or {}, largest=largest, members=members)
    template = files("riftberg.viz").joinpath("replay_template.html").read_text(encoding="utf-8")
    data = json.dumps(content.data(), separators=(",", ":"), allow_nan=False)
    # A closing tag within the data would end the script.
    page = template.replace("__TITLE__", html.escape(content.title), 1)
    page = page.replace("__DATA__", data.replace("<", "\\u003c"), 1)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, page)
    return path


@dataclass
class ReplayContent:
    """Data of the page."""

    run: xr.Dataset
    title: str  # Heading
    observed: Mapping[str, Sequence[Floats]]  # Outlines by ISO day
    largest: float = LARGEST  # Size in bytes
    members: ForecastMembers | None = None  # The forecast of which the run is the control

    def __post_init__(self) -> None:
        """Read the geometry of the run and choose the records."""
        self.scene = Scene(self.run)
        self.water: StoredWater | None = stored_water(self.run)
        self.title = self.title or run_heading(self.run) + " replay"
        self.records: Ints = chosen_records(self.run.sizes["time"], self.run.sizes["trajectory"], self.largest)

    @cached_property
    def plane(self) -> ConformalPlane:
        """Plane through the middle of the path."""
        x, y = self.scene.x[self.records], self.scene.y[self.records]
        if not self.scene.latlon:
            return ConformalPlane(float(x.mean()), float(y.mean()), self.scene.radius, latlon=False)
        return ConformalPlane(0.5 * float(x.min() + x.max()), 0.5 * float(y.min() + y.max()), self.scene.radius)

    def data(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        run, scene = self.run, self.scene
        lowest = scene.bonds.lowest_strength()
        tension = scene.bonds.tension()[self.records]
        return {
            "title": self.title,
            "note": str(run.attrs.get("forcing_title", "")).strip(),
            "melt": "".join(melt_lines(run)[:1]),
            "about": f"Riftberg {__version__}; {run.attrs.get('date_created', '')}",
            "start": f"{np.datetime_as_string(scene.times[self.records[0]], unit='s')}Z",
            "seconds": (scene.seconds[self.records] - scene.seconds[self.records[0]]).tolist(),
            "skipped": int(run.sizes["time"] - len(self.records)),
            "packing": scene.parameters.bonds.packing,
            "sides": scene.sides.tolist(),
            "draft": scene.draft(),
            "strength": scene.bonds.strength if scene.parameters.fracture.enabled else None,
            "lowest": None if lowest is None else quantise(lowest[self.records], "uint16"),
            "colours": list(FRAGMENTS),
            "small": SMALL,
            "elements": self._elements(tension),
            "bonds": self._bonds(),
            "fragments": self._fragments(),
            "stays": self._stays(),
            "peak": quantise(tension.max(axis=1, initial=0.0), "uint16"),
            "water": self._currents(),
            "floor": self._floor(),
            "coast": self._coast(),
            "graticule": self._graticule(),
            "observed": self._observed(),
            "members": None if self.members is None else self._members(self.members),
        }

    # --- ice -------------------------------------------------------------------------------------------------------

    def _elements(self, tension: Floats) -> dict[str, Any]:
        """Return place, turn and state of the elements at the records; stress is tension, for compression breaks no bond."""
        scene, chosen = self.scene, self.records
        lon, lat = scene.x[chosen], scene.y[chosen]
        x, y = self.plane.forward(lon, lat)
        rotation = np.stack([scene.rotation(int(k)) for k in chosen])
        angle = rotation + scene.lattice_angle + self.plane.eastward(lon, lat)
        side, thickness = (
            table[:1] if (table == table[:1]).all() else table
            for table in (np.sqrt(scene.areas[chosen]), self._table("thickness"))
        )
        damage = scene.bonds.damage()
        return {
            "count": lon.shape[1],
            "x": quantise(x),
            "y": quantise(y),
            "angle": quantise(np.mod(angle, 2.0 * np.pi / scene.sides)),
            "scale": float(self.plane.scale(lon, lat).mean()),
            "speed": quantise(np.hypot(self._table("u"), self._table("v")), "uint16"),
            "stress": quantise(self._largest_bond_value(tension), "uint16"),
            "damage": None if damage is None else quantise(self._largest_bond_value(damage[chosen]), "uint8"),
            "berg": quantise(scene.berg[chosen], "uint16", step=1.0),
            "thickness": quantise(thickness, "uint16"),
            "side": quantise(side, "uint16"),
            "aground": quantise(scene.aground(chosen.tolist()).sum(axis=1), "uint16", step=1.0),
        }

    def _table(self, name: str) -> Floats:
        return np.nan_to_num(self.run[name].transpose("time", "trajectory").values[self.records].astype(np.float64))

    def _largest_bond_value(self, values: Floats) -> Floats:
        """Return the largest value over the bonds of each element, from values (record, bond) of at least 0."""
        first, second = self.run["bond_first"].values, self.run["bond_second"].values
        largest = np.zeros((len(self.records), self.run.sizes["trajectory"]))
        for row, value in zip(largest, values, strict=True):
            np.maximum.at(row, first, value)
            np.maximum.at(row, second, value)
        return largest

    def _bonds(self) -> dict[str, Any]:
        """Return the bonds that break: their ends, and when (s since the first record shown)."""
        at = self.run["break_time"].values
        rows = np.flatnonzero(~np.isnat(at))
        zero = self.scene.times[self.records[0]]
        return {
            "first": self.run["bond_first"].values[rows].tolist(),
            "second": self.run["bond_second"].values[rows].tolist(),
            "time": ((at[rows] - zero) / np.timedelta64(1, "s")).tolist(),
            "total": int(self.run.sizes["bond"]),
        }

    def _stays(self) -> list[dict[str, Any]]:
        """Return when bergs touched the sea floor and came free (s since the first record shown), in words."""
        zero, events = self.scene.times[self.records[0]], []
        for stay in self.scene.stays:
            whom = f"{stay.name} " if stay.name else ""
            events.append((stay.began, f"{whom}touches the sea floor"))
            if not stay.lasts:
                events.append((stay.ended, f"{whom}comes free of the sea floor"))
        return [
            {"time": float((np.datetime64(date) - zero) / np.timedelta64(1, "s")), "text": text}
            for date, text in events
        ]

    def _fragments(self) -> list[dict[str, Any]]:
        """Return the family tree, largest first at the end."""
        run, scene, zero = self.run, self.scene, self.scene.times[self.records[0]]
        has_names = "fragment_name" in run and any(str(name) for name in run["fragment_name"].values)
        melted = melted_words(run)
        rows = []
        for k, number in enumerate(run["fragment_number"].values.tolist()):
            parent = int(run["fragment_parent"].values[k])
            rows.append(
                {
                    "number": number,
                    "name": scene.name(number),
                    "of": f"{scene.name(parent)} " if has_names and parent > 0 else "",
                    "named": number in scene.numbers,
                    "parent": parent,
                    "birth": float((run["fragment_birth_time"].values[k] - zero) / np.timedelta64(1, "s")),
                    "grounded": bool(run["fragment_grounded"].values[k] == 1),
                    "bonds": int(run["fragment_bonds_broken"].values[k]),
                    "area": float(run["fragment_area"].values[k]),
                    "end": scene.final_area(number),
                    **({"melted": melted[number]} if number in melted else {}),
                }
            )
        return sorted(rows, key=lambda row: (-row["end"], row["number"]))

    # --- members ---------------------------------------------------------------------------------------------------

    def _members(self, members: ForecastMembers) -> dict[str, Any]:
        """Return tracks, probabilities and ellipses of a forecast; times are seconds since the first record shown."""
        ds = members.result
        chosen = choose_tracks(ds)
        tracks = ds[["lon", "lat"]].isel(member=chosen, fragment=0).transpose("member", "time")
        x, y = self.plane.forward(tracks["lon"].values, tracks["lat"].values)
        lines = [ellipses(ds, float(level)) for level in ds["cone"].values]
        few = not any(np.isfinite(line).all() for line in lines[-1]) and "members_west" in ds
        lines = [[], ranges(ds)] if few else lines
        share = {name: ds[name].values.round(4).tolist()
                 for quantity in ("p_broken", "p_aground")
                 for name in (quantity, f"{quantity}_low", f"{quantity}_high")}  # fmt: skip
        return {
            "words": members.words,
            "scenarios": [{"number": n, "share": p, "text": text} for n, p, text in members.scenarios],
            "seconds": self._since_first(ds["time"].values),
            "x": quantise(x),
            "y": quantise(y),
            "scenario": ds["scenario"].values[chosen].tolist(),
            "all": int((ds["status"].values == 0).sum()),
            **share,
            "presence": self._presence(ds),
            "few": few,
            "ellipses": [[_flat_list(*self.plane.forward(*line.T)) if np.isfinite(line).all() else [] for line in group]
                         for group in lines],
        }  # fmt: skip

    def _presence(self, ds: xr.Dataset) -> dict[str, Any]:
        """Return the probability of ice (%) on an even mesh of the plane."""
        lon, lat = ds["cell_lon"].values, ds["cell_lat"].values
        px, py = self.plane.forward(*np.meshgrid(lon, lat))
        step = float(np.diff(py, axis=0).mean())
        xs, ys = (np.arange(p.min(), p.max() + step, step) for p in (px, py))
        at_lon, at_lat = self.plane.inverse(*np.meshgrid(xs, ys))
        i, j = (np.rint((at - a[0]) / (a[1] - a[0])).astype(int) for at, a in ((at_lon, lon), (at_lat, lat)))
        inside = (i >= 0) & (i < lon.size) & (j >= 0) & (j < lat.size)
        every = -(-ds.sizes["time"] * inside.size // MOST_VALUES)
        values = ds["presence"].isel(time=slice(None, None, every)).transpose("time", "cell_lat", "cell_lon").values
        presence = np.where(inside, values[:, np.where(inside, j, 0), np.where(inside, i, 0)], 0.0)
        return {
            "x": [float(xs[0]), float(xs[-1])], "y": [float(ys[0]), float(ys[-1])],
            "seconds": self._since_first(ds["time"].values[::every]), "share": quantise(100.0 * presence, "uint8", step=0.5),
        }  # fmt: skip

    def _since_first(self, times: NDArray[Any]) -> list[float]:
        since: list[float] = ((times - self.scene.times[self.records[0]]) / np.timedelta64(1, "s")).tolist()
        return since

    # --- water -----------------------------------------------------------------------------------------------------

    def _mesh(self, points: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Return axes of an even mesh on the plane over the stored box, and lon and lat of its points."""
        assert self.water is not None
        edges = np.meshgrid(
            np.linspace(self.water.x[0], self.water.x[-1], 9), np.linspace(self.water.y[0], self.water.y[-1], 9)
        )
        px, py = self.plane.forward(*edges)
        # The upright rectangle around the projected box; its corners stay without water.
        step = max(float(np.ptp(px)), float(np.ptp(py))) / (points - 1)
        xs, ys = (np.linspace(p.min(), p.max(), max(2, round(float(np.ptp(p)) / step) + 1)) for p in (px, py))
        lon, lat = self.plane.inverse(*np.meshgrid(xs, ys))
        return xs, ys, lon, lat

    def _currents(self) -> dict[str, Any] | None:
        if self.water is None or not np.isfinite(self.water.u).any():
            return None
        xs, ys, lon, lat = self._mesh(len(max(self.water.x, self.water.y, key=len)))
        zero = float(self.scene.seconds[self.records[0]])
        u, v = (np.stack(a) for a in zip(*(self.water.currents(lon, lat, t) for t in self.water.times), strict=True))
        turn = self.plane.eastward(lon, lat)
        return {
            "x": [float(xs[0]), float(xs[-1])],
            "y": [float(ys[0]), float(ys[-1])],
            "seconds": (self.water.times - zero).tolist(),
            "u": quantise(u * np.cos(turn) - v * np.sin(turn)),
            "v": quantise(u * np.sin(turn) + v * np.cos(turn)),
        }

    def _floor(self) -> dict[str, Any] | None:
        """Return depth on a mesh, isobaths, and rings around the floor that the keel would touch."""
        if self.water is None or not np.isfinite(self.water.floor).any():
            return None
        water, draft = self.water, self.scene.draft()
        xs, ys, lon, lat = self._mesh(min(160, max(water.floor.shape)))
        depth = water.depth(lon, lat)
        if float(np.nanmin(depth)) == float(np.nanmax(depth)) or float(np.nanmax(depth)) <= draft:
            return None  # a flat floor has nothing to show, and a depth of 0 everywhere is none
        shallow: list[list[float]] = []
        if self.scene.has_floor:
            fine_x, fine_y, lon, lat = self._mesh(max(water.floor.shape))
            fine = interpolate_evenly(water.floor_x, water.floor_y, water.floor, lon, lat)
            # Outside of the box it is deep, so that rings close at its edge.
            fine = np.pad(np.where(np.isfinite(fine), fine, 1e5), 1, constant_values=1e5)
            fine_x, fine_y = (np.r_[2.0 * a[0] - a[1], a, 2.0 * a[-1] - a[-2]] for a in (fine_x, fine_y))
            shallow = _contours(fine_x, fine_y, fine, draft)
        return {
            "x": [float(xs[0]), float(xs[-1])],
            "y": [float(ys[0]), float(ys[-1])],
            "depth": quantise(depth, "uint16"),
            "lines": [
                {"depth": level, "lines": lines} for level in _ISOBATHS if (lines := _contours(xs, ys, depth, level))
            ],
            "shallow": shallow,
        }

    def _coast(self) -> list[dict[str, Any]]:
        """Return land and ice shelves around the run as rings on the plane."""
        if not self.scene.latlon:
            return []
        areas, _ = clip_coast(self.scene.box().grown(0.8, latlon=self.scene.latlon))
        coast = []
        for area, colour in areas:
            rings = (np.asarray(ring.coords)[:, :2] for ring in (area.exterior, *area.interiors))
            coast.append({"colour": colour, "rings": [_thin(*self.plane.forward(*ring.T)) for ring in rings]})
        return coast

    def _graticule(self) -> list[dict[str, Any]]:
        """Return meridians and parallels as lines on the plane."""
        if not self.scene.latlon:
            return []
        box = self.scene.box().grown(0.8, latlon=self.scene.latlon)
        lines = []
        step_x, step_y = nice_step((box.east - box.west) / 6.0), nice_step((box.north - box.south) / 6.0)
        south, north = max(box.south, -90.0), min(box.north, 90.0)
        for lon in np.arange(np.ceil(box.west / step_x), np.floor(box.east / step_x) + 1) * step_x:
            x, y = self.plane.forward(np.full(25, lon), np.linspace(south, north, 25))
            lines.append(
                {"label": degree_label(float(lon), "E", "W", int(step_x < 1.0)), "axis": "x", "line": _flat_list(x, y)}
            )
        for lat in np.arange(np.ceil(south / step_y), np.floor(north / step_y) + 1) * step_y:
            x, y = self.plane.forward(np.linspace(box.west, box.east, 33), np.full(33, lat))
            lines.append(
                {"label": degree_label(float(lat), "N", "S", int(step_y < 1.0)), "axis": "y", "line": _flat_list(x, y)}
            )
        return lines

    def _observed(self) -> list[dict[str, Any]]:
        """Return outlines of the days of the run: seconds of the day's noon, and rings on the plane."""
        zero = self.scene.times[self.records[0]]
        entries = []
        for day, rings in sorted(self.observed.items()):
            begin = float((np.datetime64(day) - zero) / np.timedelta64(1, "s"))
            span = float(self.scene.seconds[self.records[-1]] - self.scene.seconds[self.records[0]])
            if begin + 86_400.0 > 0.0 and begin < span:
                drawn = [_thin(*self.plane.forward(ring[:, 0], ring[:, 1])) for ring in rings]
                entries.append({"day": day, "begin": begin, "rings": drawn})
        return entries


def chosen_records(records: int, elements: int, largest: float) -> Ints:
    """Return the records to show: all, or an even choice with the last one where the page would be too large."""
    room = max(2.0, 0.8 * largest / (_ELEMENT_BYTES * max(elements, 1)))
    every = max(1, int(np.ceil(records / room)))
    return np.unique(np.r_[np.arange(0, records, every), records - 1])


def nice_step(rough: float) -> float:
    """Return the step of a graticule near ``rough`` degrees."""
    steps = np.array([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0])
    return float(steps[np.argmin(np.abs(np.log(steps / max(rough, 1e-9))))])


def _flat_list(x: Floats, y: Floats) -> list[float]:
    return np.column_stack([x, y]).round(0).astype(int).ravel().tolist()


def _thin(x: Floats, y: Floats) -> list[float]:
    """Return a ring without points that are closer than `_THIN` to the one kept before."""
    rows = [0]
    for k in range(1, len(x)):
        if np.hypot(x[k] - x[rows[-1]], y[k] - y[rows[-1]]) >= _THIN:
            rows.append(k)
    return _flat_list(x[rows], y[rows])


def _contours(xs: Floats, ys: Floats, field: Floats, level: float) -> list[list[float]]:
    from contourpy import contour_generator

    lines = contour_generator(xs, ys, np.ma.masked_invalid(field)).lines(level)
    return [_flat_list(*np.asarray(line).T) for line in lines if len(line) > 2]
