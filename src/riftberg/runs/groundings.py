"""Stays of bergs on the sea floor in words: as they happen, at the end of a run, and from its file.

`riftberg.engines.common.fragments.grounding_log` defines the contents of a stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.config.units import POINTS, duration_text, minute_text, place_text
from riftberg.engines.common.bed import make_bed
from riftberg.engines.common.forces.media import on_the_floor
from riftberg.engines.common.fragments.grounding_log import AFLOAT_TIME, GroundingEvent
from riftberg.parameters import Parameters, QuasiStaticParameters, Seabed
from riftberg.physics.floating import draft_of
from riftberg.runs.layout import label_fragment
from riftberg.system.process import say

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.model import BareModel

MOST_TOLD: Final = 10
"""Touches that are told while a run goes on; of a field of bergs the others stand in its summary."""

DEEP_KEEL: Final = 5.0
"""Depth (m) of a keel below the sea floor from which on a law of drag is told to hold nothing."""

OTHER_BEDS: Final = ("clay", "rock")
"""Beds for which a run reports how much the same load could hold."""

USUAL_FLEXURAL_STRENGTH: Final = 0.3e6
"""Bending stress (Pa) that glacier ice bears at most (Vaughan 1993: 90 to 320 kPa)."""

NEARBY: Final = 20e3
"""Distance (m) about the berg at the start in which the least depth is told."""

AROUND_POINTS: Final = 41
"""Points along each side of that, by which it is found."""

NO_FLOOR: Final = 5000.0
"""Depth (m) from which on nothing is said of the sea floor."""

DOUBTFUL_CLEARANCE: Final = 50.0
"""Clearance (m) below which a run says how good charts are."""


LEAST_LEVEL: Final = 0.05
"""Sea level (m) from which on it is told that a file's adds to the depth of a chart."""


@dataclass(frozen=True)
class Stay:
    """One stay on the sea floor, with dates in place of seconds."""

    name: str  # Of the berg or fragment; empty where there is but one, without a name
    began: str  # ISO 8601
    ended: str
    lasts: bool  # Whether it was aground at the last date
    event: GroundingEvent
    held: str = ""  # Since when it has stood still; empty while it slides

    def as_dict(self) -> dict[str, Any]:
        """Return it as the summary has it."""
        row = self.event
        return {
            "number": row.number, "name": self.name, "first": self.began, "last": self.ended, "lasts": self.lasts,
            "lon": row.lon, "lat": row.lat, "towards": None if row.towards < 0.0 else row.towards,
            "hours": row.seconds / 3600.0, "times": row.times, "elements": row.carried, "load": row.load,
            "capacity": row.capacity, "pressing": row.pressing, "lift": row.lift, "bending_stress": row.stress,
            "gouge": row.gouge, "way_aground": row.way,
            "stopped_within": None if row.stopped < 0.0 else row.stopped, "held_since": self.held or None, "sea_level": row.level,
        }  # fmt: skip


def list_stays(model: BareModel) -> list[Stay]:
    """Return the stays of a run so far, in order of time."""
    rows = {row.number: row for row in model.fragments.rows}
    several_bergs = sum(row.parent <= 0 for row in rows.values()) > 1

    def fragment_name(number: int) -> str:
        row = rows.get(number)
        if row is None:
            return ""
        return label_fragment(number, row.parent, row.name) if row.parent > 0 or row.name or several_bergs else ""

    def date(seconds: float) -> str:
        return (model.start + timedelta(seconds=seconds)).isoformat()

    return [
        Stay(
            fragment_name(row.number),
            date(row.time),
            date(row.end),
            row.end >= model.time - 1e-6,
            row,
            date(row.held) if row.held >= 0.0 else "",
        )
        for row in model.groundings.rows
    ]


def read_stays(run: xr.Dataset, names: Any) -> list[Stay]:
    """Return the stays in a run file; ``names`` gives the name of a fragment by its number."""
    if "grounding_time" not in run or run.sizes.get("grounding", 0) == 0:
        return []
    zero, last = np.datetime64(str(run.attrs["start"])), run["time"].values[-1]
    coordinates = {"lon": "lon" if "grounding_lon" in run else "x", "lat": "lat" if "grounding_lat" in run else "y"}
    stays = []
    for k in range(run.sizes["grounding"]):
        began, ended = (run[f"grounding_{name}"].values[k] for name in ("time", "end"))
        values: dict[str, Any] = {
            name: run[f"grounding_{coordinates.get(name, name)}"].values[k].item()
            for name in GroundingEvent.__dataclass_fields__
            if name not in ("time", "end") and f"grounding_{coordinates.get(name, name)}" in run  # earlier versions had less
        }  # fmt: skip
        values |= {
            name: float((date - zero) / np.timedelta64(1, "s")) for name, date in (("time", began), ("end", ended))
        }
        event = GroundingEvent(**values)
        held_since = zero + np.timedelta64(round(event.held), "s")
        dates = str(began)[:19], str(ended)[:19]
        stays.append(
            Stay(
                names(event.number),
                *dates,
                bool(ended >= last),
                event,
                str(held_since)[:19] if event.held >= 0.0 else "",
            )
        )
    return stays


def summarize_ground(model: BareModel) -> dict[str, Any]:
    """Return the effects of the sea floor in a run, as the summary holds them."""
    stays, p = list_stays(model), model.parameters
    clearance = model.groundings.clearance
    summary: dict[str, Any] = {
        "law": p.grounding.law,
        "least_clearance": None if math.isinf(clearance) else clearance,
        "bathymetry_spacing": model.forcing.depth_spacing(),
        "first": None,
        "stays": [stay.as_dict() for stay in stays],
    }
    # Pieces that are too small for a stay of their own are aground all the same.
    el = model.elements
    touching = on_the_floor(el.thickness, el.environment.depth, el.keel.floor_load, p.kernel_values())
    listed = [stay.event.number for stay in stays if stay.lasts]
    summary["elements_of_small_pieces"] = int((touching & ~np.isin(el.berg, listed)).sum())
    if not stays:
        return summary
    # The bergs aground now, or where none is, the one that came free last.
    last_events = [stay.event for stay in stays if stay.lasts] or [max(stays, key=lambda stay: stay.ended).event]
    load = sum(row.load for row in last_events)
    summary |= {
        "first": min(stay.began for stay in stays),
        "hours": sum(stay.event.seconds for stay in stays) / 3600.0,
        "times": sum(stay.event.times for stay in stays),
        "elements": sum(row.carried for row in last_events),
        "load": load,
        "capacity": sum(row.capacity for row in last_events),
        "pressing": sum(row.pressing for row in last_events),
        **{
            key: max(getattr(stay.event, name) for stay in stays)
            for key, name in (("lift", "lift"), ("bending_stress", "stress"), ("gouge", "gouge"))
        },
        "way_aground": max(stay.event.way for stay in stays),
    }
    if p.grounding.law == "seabed":
        summary["sediment"] = p.grounding.sediment
        summary["capacity_on"] = {name: load * holding(name) for name in OTHER_BEDS if name != p.grounding.sediment}
    return summary


def holding(sediment: str) -> float:
    """Return which part of a load a bed can hold by friction where it bears as much as it can.

    ``min(mu, alpha s_u / q_u)``: on clay the keel is as wide as the bearing strength asks for.
    """
    bed = make_bed(Seabed(sediment=sediment))
    adhesion = bed.shear_strength / bed.strength if bed.shear_strength > 0.0 else math.inf
    return min(bed.friction, adhesion)


def force_text(newtons: float) -> str:
    """Return a force to two digits."""
    return f"{newtons:.2g} N"


def short_date(moment: str) -> str:
    """Return day, month and time of an ISO date, such as ``28 Feb 07:10``."""
    date = datetime.fromisoformat(moment)
    return f"{date.day} {date:%b %H:%M}"


def touch_line(stay: Stay, elements: int, *, latlon: bool) -> str:
    """Return that a berg touched, in a line; ``elements``: how many it has."""
    row, whom = stay.event, f"{stay.name} " if stay.name else ""
    position = place_text(row.lon, row.lat, latlon=latlon, digits=2)
    lifted = f", keel lifted by up to {row.lift:.2g} m" if row.lift > 0.0 else ""
    return f"{minute_text(stay.began)}  {whom}aground at {position}: {row.elements} of {elements} elements{lifted}"


def free_line(stay: Stay) -> str:
    """Return that a berg came free, in a line."""
    days = (np.datetime64(stay.ended) - np.datetime64(stay.began)) / np.timedelta64(1, "D")
    return f"{minute_text(stay.ended)}  {stay.name + ' ' if stay.name else ''}afloat again after {_length(float(days))}"


def _length(days: float) -> str:
    return duration_text(float(f"{days:.1f}") if days >= 1.0 else days)


def stay_words(entry: dict[str, Any], weight: float) -> str:
    """Return where a berg stands at the end of a run, for the line of its results.

    ``entry``: of the stay in a summary; ``weight``: of the berg, N.
    """
    if not entry["lasts"]:
        hours = duration_text(float(f"{entry['hours'] / 24.0:.3g}"))
        return f"aground for {hours} from {short_date(entry['first'])} on, afloat since {short_date(entry['last'])}"
    share = f", {100.0 * entry['load'] / weight:.2g} % of its weight" if weight > 0.0 else ""
    inside = (
        f"{entry['elements']} element{'s' if entry['elements'] != 1 else ''}, load {force_text(entry['load'])}{share}"
    )
    held_text = f"; the bed can hold {force_text(entry['capacity'])}" if entry["capacity"] > 0.0 else ""
    pressed = f"{',' if held_text else ';'} the sea presses with {force_text(entry['pressing'])}"
    motion_text = (
        f"; it has stood still since {short_date(entry['held_since'])}"
        if entry.get("held_since")
        else f"; it slides, {_metres(entry['way_aground'])} so far"
    )
    return f"aground since {short_date(entry['first'])} ({inside}{held_text}{pressed}{motion_text})"


def standing_lines(ground: dict[str, Any]) -> list[str]:
    """Return for many pieces or bergs how many stand on the floor at the end of a run, what it carries and what holds them."""
    count = sum(stay["lasts"] for stay in ground["stays"])
    if not count:
        return []
    held_text = f"; the bed can hold {force_text(ground['capacity'])}," if ground["capacity"] > 0.0 else ";"
    return [
        f"  {count} of them stand{'s' if count == 1 else ''} aground: load {force_text(ground['load'])}{held_text} "
        f"the sea presses with {force_text(ground['pressing'])}"
    ]


def title_lines(stays: list[Stay]) -> list[str]:
    """Return for the title of a map the stay that lasts, else the first, in a line, and how many more there were."""
    if not stays:
        return []
    stay = next((stay for stay in stays if stay.lasts), stays[0])
    row, until = stay.event, "the end" if stay.lasts else short_date(stay.ended)
    motion_text = f"held since {short_date(stay.held)}" if stay.held else f"slid {_metres(row.way)}"
    others = len(stays) - 1
    more = f"; {others} other grounding{'s' if others > 1 else ''}" if others else ""
    whom = f"{stay.name} aground" if stay.name else "Aground"
    elements = f"{row.carried} element{'s' if row.carried != 1 else ''}"
    return [f"{whom} {short_date(stay.began)} to {until}: {elements}, {motion_text}{more}"]


def ground_lines(ground: dict[str, Any]) -> list[str]:
    """Return further lines on the sea floor at the end of a run: other beds, or the least clearance."""
    lines = []
    if small := ground.get("elements_of_small_pieces", 0):
        lines.append(
            f"  {small} element{'s' if small != 1 else ''} of small pieces stand{'' if small != 1 else 's'} aground"
        )
    if any(stay["lasts"] for stay in ground["stays"]) and ground.get("capacity_on"):
        beds = ", ".join(f"{force_text(force)} on {name}" for name, force in ground["capacity_on"].items())
        lines.append(
            f"  the bed is taken to be {ground['sediment']}; the same load could hold {beds} (grounding.sediment)"
        )
    if ground.get("bending_stress", 0.0) > USUAL_FLEXURAL_STRENGTH:
        lines.append(
            f"  the ice would bend by {_megapascals(ground['bending_stress'])}, more than it bears: a berg that has lain there "
            "for weeks bears less (grounding.ice_modulus, fracture.flexural_strength)"
        )
    if ground["stays"] and abs(level := ground["stays"][0]["sea_level"]) >= LEAST_LEVEL:
        lines.append(f"  the sea stood {level:+.2f} m from the zero of the depth where and when it first touched")
    clearance, spacing = ground["least_clearance"], ground["bathymetry_spacing"]
    if ground["first"] is None and clearance is not None and 0.0 <= clearance < DOUBTFUL_CLEARANCE:
        nodes = f" and has a node every {_kilometres(spacing)} here" if spacing else ""
        digits = 0 if clearance >= 9.5 else 1
        lines.append(
            f"  the keel passed {clearance:.{digits}f} m above the floor; a chart is good to some tens of metres{nodes}"
        )
    return lines


def keel_line(model: BareModel) -> str:
    """Return how deep the keel that is nearest to the floor is at the start, and the chart under its berg and near it.

    Nothing where no depth is known.
    """
    el, p = model.elements, model.parameters
    if p.grounding.law == "none" or el.size == 0:
        return ""
    draft, under = draft_of(el.thickness, p.ice.density), np.asarray(model.forcing.depth(el.lon, el.lat), float)
    if not np.isfinite(under).any() or not np.nanmin(under) < NO_FLOOR:
        return ""
    nearest = int(np.nanargmin(under - draft))
    gap, berg = float(under[nearest] - draft[nearest]), el.berg == el.berg[nearest]
    earth, lon, lat = p.earth, el.lon[berg], el.lat[berg]
    lon0, lat0, scale = float(lon.mean()), float(lat.mean()), math.radians(1.0) * earth.radius if earth.latlon else 1.0
    along = scale * (math.cos(math.radians(lat0)) if earth.latlon else 1.0)
    reach = np.linspace(-1.0, 1.0, AROUND_POINTS)
    half_x, half_y = NEARBY + 0.5 * along * np.ptp(lon), NEARBY + 0.5 * scale * np.ptp(lat)
    nearby_points = np.meshgrid(lon0 + reach * half_x / along, lat0 + reach * half_y / scale)
    nearby = np.asarray(model.forcing.depth(*nearby_points), float)
    whom = "" if berg.all() else f" of berg {el.berg[nearest]}"
    spacing = model.forcing.depth_spacing()
    chart = f"the chart, with a node every {_kilometres(spacing)}," if spacing else "the sea floor"
    clearance = (
        f"{gap:.0f} m of water below the keel"
        if gap >= 0.0
        else f"the keel stands {-gap:.0f} m deeper: it starts aground"
    )
    least = (
        f"; within {NEARBY / 1e3:.0f} km of it at least {np.nanmin(nearby):.0f} m" if np.isfinite(nearby).any() else ""
    )
    return (
        f"the keel{whom} is {draft[nearest]:.0f} m deep; {chart} has at least {under[nearest]:.0f} m under the berg "
        f"({clearance}){least}"
    )


def _kilometres(metres: float) -> str:
    return f"{metres / 1e3:.3g} km" if metres >= 1e3 else f"{metres:.0f} m"


def why_lines(stays: list[Stay], parameters: Parameters, *, latlon: bool) -> list[str]:
    """Return a sentence for each stay: where the berg touched, how far it went, and holding and driving forces."""
    lines = []
    for stay in stays:
        row = stay.event
        whom = f"{stay.name} was aground" if stay.name else "Aground"
        until = "the end" if stay.lasts else minute_text(stay.ended)
        position = place_text(row.lon, row.lat, latlon=latlon, digits=2)
        clauses = [f"{whom} {minute_text(stay.began)} to {until}: touched {_side(row.towards)}at {position}"]
        if row.times > 1:
            clauses.append(f"touched {row.times} times and stood for {_length(row.seconds / 86400.0)} in all")
        clauses.append(
            f"stopped within {_metres(row.stopped)}"
            if row.stopped >= 0.0
            else f"slid {_metres(row.way)} and did not stop"
        )
        if row.capacity > 0.0:
            clauses.append(f"held by up to {force_text(row.capacity)} against {force_text(row.pressing)}")
        else:
            law = parameters.grounding.law
            clauses.append(
                f"the law {law} brakes it and holds nothing; the sea presses with {force_text(row.pressing)}"
            )
        if row.stress > 0.0:
            clauses.append(bending_words(row.stress, parameters))
        lines.append("; ".join(clauses) + ".")
    return lines


def bending_words(stress: float, parameters: Parameters) -> str:
    """Return the bending stress of the ice on the floor, and its strength; ``stress``: the largest, Pa."""
    strength = parameters.fracture.flexural_strength if isinstance(parameters, QuasiStaticParameters) else None
    text = f"bending of the ice {_megapascals(stress)}"
    if strength is not None:
        return f"{text} (breaks at {_megapascals(strength)})"
    if stress <= USUAL_FLEXURAL_STRENGTH:
        return text
    return (
        f"{text}, more than it bears (some {_megapascals(USUAL_FLEXURAL_STRENGTH)}; fracture.flexural_strength is off): a berg "
        "that has lain there for weeks bears less, with grounding.ice_modulus 0.1 GPa"
    )


def _megapascals(stress: float) -> str:
    return f"{stress / 1e6:.2g} MPa"


def _metres(distance: float) -> str:
    return f"{distance:.0f} m" if distance < 1e4 else f"{distance / 1e3:.0f} km"


def _side(towards: float) -> str:
    """Return the side of a berg that lies in a direction, such as ``with its north-eastern side ``; nothing for its middle."""
    return f"with its {POINTS[round(towards / 45.0) % 8]}ern side " if towards >= 0.0 else ""


def _count_elements(model: BareModel, row: GroundingEvent) -> int:
    """Return how many elements a berg had when it touched: some may have broken off in the same step."""
    pieces = [piece for piece in model.fragments.rows if piece.parent == row.number and piece.birth_time > row.time]
    return int((model.elements.berg == row.number).sum()) + sum(piece.elements for piece in pieces)


class GroundTeller:
    """Says while a run goes on which bergs touch the sea floor and come free, each once."""

    def __init__(self) -> None:
        self._told = self._freed = 0
        self._open: set[int] = set()
        self._deep = self._level = False

    def start(self, model: BareModel) -> None:
        """Treat earlier stays as reported."""
        self._told = len(model.groundings.rows)
        self._open = {k for k, row in enumerate(model.groundings.rows) if row.end >= model.time - 1e-6}

    def lines(self, model: BareModel) -> list[str]:
        """Return new events after a step."""
        rows = model.groundings.rows
        news = self._deep_keel(model)
        over = [k for k in sorted(self._open) if model.time - rows[k].end >= AFLOAT_TIME]
        if len(rows) == self._told and not over:
            return news
        stays, berg, latlon = list_stays(model), model.elements.berg, model.parameters.earth.latlon
        for k in range(self._told, len(rows)):
            if k < MOST_TOLD:
                news.append(touch_line(stays[k], _count_elements(model, rows[k]), latlon=latlon))
                self._open.add(k)
                news += self._level_line(model, rows[k])
            elif k == MOST_TOLD:
                news.append("More bergs touch the sea floor: see summary.json")
        self._told = len(rows)
        for k in over:
            self._open.discard(k)
            if (berg == rows[k].number).any():  # else it has melted, or gone to pieces
                news.append(free_line(stays[k]))
        return news

    def say(self, model: BareModel) -> None:
        """Print new events after a step."""
        for line in self.lines(model):
            say(line)

    def _level_line(self, model: BareModel, row: GroundingEvent) -> list[str]:
        """Return once the sea level of files that adds to the depth of a chart, which may count from another zero."""
        if self._level or not model.forcing.has_own_level_datum:
            return []
        self._level = True
        if abs(row.level) < LEAST_LEVEL:
            return []
        return [
            f"  the sea level of the files stands at {row.level:+.2f} m there and counts in the depth: it is above the geoid, "
            "and a chart may stand above another zero"
        ]

    def _deep_keel(self, model: BareModel) -> list[str]:
        """Return once that a law of drag lets a keel far below the floor."""
        p, el = model.parameters, model.elements
        if self._deep or p.stepping.in_equilibrium:
            return []
        below = draft_of(el.thickness, p.ice.density) - el.environment.depth
        if not (below > DEEP_KEEL).any():
            return []
        below = np.where(on_the_floor(el.thickness, el.environment.depth, 0.0, p.kernel_values()), below, 0.0)
        if below.max() <= DEEP_KEEL:  # the law lets the sea floor do nothing there
            return []
        self._deep = True
        return [
            f"the keel is up to {below.max():.0f} m below the floor: the law {p.grounding.law} does not hold it "
            "(grounding.law)"
        ]
