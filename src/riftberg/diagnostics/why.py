"""Why a berg broke: the break-ups of a run with their reasons, their fate in controls, and all of it in plain words.

How the load of a cut is found and shared among the forces stands in `riftberg.diagnostics.cut`.
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.config.units import area_text, count_text, minute_text, place_text
from riftberg.diagnostics.cut import GEOSTROPHIC, Breakup, Collision, Cut, FirstBond, birth_members, iso
from riftberg.diagnostics.summary import melt_lines
from riftberg.diagnostics.whole import WholeBerg, whole_berg, whole_lines
from riftberg.engines.common.reserves import reserve_lines
from riftberg.engines.common.rift_tips import tip_lines
from riftberg.life.edges import EdgeIce, front_lines
from riftberg.runs.groundings import read_stays, why_lines
from riftberg.runs.layout import run_heading
from riftberg.runs.scene import SMALL, Scene
from riftberg.system.atomic_files import write_json

if TYPE_CHECKING:
    import xarray as xr


@dataclass
class Reasons:
    """Break-ups of a run that are large enough to be shown; stays on the sea floor, losses by melting, reserves, rifts."""

    experiment: str
    forcing: str
    breakups: list[Breakup]
    small: int
    strength: float | None
    melt: list[str] = field(default_factory=list)
    ground: list[str] = field(default_factory=list)
    reserves: list[str] = field(default_factory=list)
    rifts: list[str] = field(default_factory=list)
    whole: WholeBerg | None = None  # Where nothing broke off
    latlon: bool = True

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, texts, lists and dicts."""
        return asdict(self)

    def write(self, path: str | Path) -> Path:
        """Write as JSON."""
        return write_json(self.as_dict(), path)


SMALL_LOAD: Final = 0.25
"""No force is called the reason of a break whose cut as a whole carried less than this part of the strength."""

LEADING: Final = 0.25
"""Part of the largest share from which on a force is named as a reason too."""

STARTING: Final = 24.0
"""Time (h) after the start in which a berg may break by being set in motion."""

ALIKE: Final = 0.1
"""Relative difference of areas up to which a piece of a control run is the same."""

CAUSES: Final = {
    "ocean drag": "the current exerts a different drag on its parts",
    GEOSTROPHIC: "Coriolis force and slope of the sea surface do not balance on its parts alike, as in a sheared current",
    "wind drag": "the wind exerts a different drag on its parts",
    "waves": "waves exert a different push on its parts",
    "sea floor": "the sea floor holds a part of it",
    "sea ice": "sea ice exerts a different drag on its parts",
}


FLOOR: Final = (
    "The force of the sea floor is not recorded: it is taken to be what closes the budget, "
    "spread evenly over all that is aground."
)


def explain(run: xr.Dataset, *, smallest: float = SMALL) -> Reasons:
    """Find the reasons of the break-ups of a run.

    Parameters
    ----------
    run : xarray.Dataset
        From `riftberg.open_run`.
    smallest : float, optional
        Fragments below this part of the area of their berg are counted, not explained.
    """
    scene = Scene(run)
    breakups: list[Breakup] = []
    small = 0
    for row in np.argsort(run["fragment_birth_time"].values, kind="stable"):
        if int(run["fragment_parent"].values[row]) <= 0:
            continue
        berg_area = scene.berg_areas.get(scene.origin(int(run["fragment_number"].values[row])), float(scene.area.sum()))
        large = float(run["fragment_area"].values[row]) >= smallest * berg_area
        breakup = Cut(scene, int(row)).breakup() if large else None
        if breakup is None:
            small += 1
            continue
        breakup.name, breakup.parent_name = scene.name(breakup.fragment), scene.name(breakup.parent)
        breakup.collision = find_collision(scene, breakup)
        breakups.append(breakup)
    return Reasons(
        experiment=run_heading(run, ""),
        forcing=str(run.attrs.get("forcing_title", "")),
        breakups=breakups,
        small=small,
        strength=scene.bonds.strength if scene.parameters.fracture.enabled else None,
        reserves=[*_front_lines(scene), *_reserve_lines(scene)],
        rifts=tip_lines(scene.rift_tips, scene.parameters),
        melt=melt_lines(run),
        whole=None if breakups else whole_berg(scene),
        latlon=scene.latlon,
        ground=why_lines(read_stays(run, scene.name), scene.parameters, latlon=scene.latlon),
    )


def _front_lines(scene: Scene) -> list[str]:
    """Return how much the fronts of the largest berg bend at the start of a run."""
    present = scene.there[0]
    side = np.sqrt(scene.area)
    ice = EdgeIce(*(array[present] for array in (scene.x[0], scene.y[0], side, side, scene.thickness(0))))
    return front_lines(ice, scene.berg[0][present], scene.parameters)


def _reserve_lines(scene: Scene) -> list[str]:
    """Return pre-stress and reserve of the bergs at the start of a run, in sentences."""
    present = scene.there[0]
    numbers = scene.berg[0][present]
    names = {number: scene.name(number) for number in np.unique(numbers).tolist()}
    return reserve_lines(numbers, scene.thickness(0)[present], scene.area[present], names, scene.parameters)


def find_collision(scene: Scene, b: Breakup) -> Collision | None:
    """Return the contact with another berg in which the first bond of a break-up failed; the latest, if there are several."""
    run = scene.run
    if "contact_time" not in run or run.sizes.get("contact", 0) == 0:
        return None
    broke = np.datetime64(b.first_break)
    step = np.timedelta64(round(1e3 * scene.parameters.time_step), "ms")
    first, second = run["contact_first"].values, run["contact_second"].values
    began, ended = run["contact_time"].values, run["contact_end"].values
    during = (began <= broke) & (broke <= ended + step) & ((first == b.parent) | (second == b.parent))
    if not during.any():
        return None
    k = max(np.flatnonzero(during).tolist(), key=lambda row: began[row])
    other = int(second[k] if first[k] == b.parent else first[k])
    return Collision(scene.name(other), iso(began[k]), float(run["contact_speed"].values[k]))


def control_fate(breakup: Breakup, control: xr.Dataset) -> str:
    """Return the fate of a break-up in a control run."""
    scene, ids = Scene(control), control["trajectory"].values
    fragment_rows = np.isin(ids, breakup.members)
    area = float(scene.area[fragment_rows].sum())
    pieces: list[tuple[float, float, str]] = []  # area in common and area of each fragment (m2), time of its birth
    for row in range(control.sizes["fragment"]):
        members = birth_members(scene, row) if int(control["fragment_parent"].values[row]) > 0 else None
        if members is None:
            continue
        control_rows = np.isin(ids, ids[members[0]])
        if (fragment_rows & control_rows).any():
            birth = iso(control["fragment_birth_time"].values[row])
            pieces.append(
                (float(scene.area[fragment_rows & control_rows].sum()), float(scene.area[control_rows].sum()), birth)
            )
    if not pieces:
        return "removed"
    common, other, birth = max(pieces, key=lambda piece: piece[0] / (area + piece[1] - piece[0]))
    if common <= 0.5 * area:
        return f"breaks off only in part, {common / 1e6:.0f} of {area / 1e6:.0f} km2 at {birth}"
    birth_text = f"breaks off at {birth}"
    if abs(other - area) > ALIKE * area or common < (1.0 - ALIKE) * area:
        birth_text += f" with another area, {other / 1e6:.0f} km2 instead of {area / 1e6:.0f} km2"
    return birth_text


def reason_lines(reasons: Reasons) -> list[str]:
    """Return the reasons in words, one paragraph per break-up."""
    small, reserves = count_text(reasons.small, "small piece"), [" ".join(reasons.reserves)] if reasons.reserves else []
    if not reasons.breakups:
        but = f" but {small} (--all lists them)" if reasons.small else ""
        whole_text = [] if reasons.whole is None else [" ".join(whole_lines(reasons.whole, latlon=reasons.latlon))]
        return [f"Nothing broke off{but}.", *whole_text, *reasons.rifts, *reasons.ground, *reasons.melt, *reserves]
    lines = [_paragraph(breakup) for breakup in reasons.breakups]
    if reasons.small:
        lines.append(f"{small.replace('small', 'smaller')} broke off too (--all lists them).")
    return [*lines, *reasons.rifts, *reasons.ground, *reasons.melt, *reserves]


def _paragraph(b: Breakup) -> str:
    """Return the fragment that broke off, the date, the load, and the force that caused it."""
    first, load = b.first_bonds[0], b.decisive
    where = (
        "aground" if b.grounded else "afloat: nothing of it touched the sea floor" if load.aground == 0 else "afloat"
    )
    position = place_text(first.lon, first.lat, latlon=b.latlon, digits=2)
    large = max(abs(value) for _, value in b.causes) or 1.0
    shares = [f"{name} {value / 1e3:+.1f} kPa" for name, value in b.causes if abs(value) >= 0.02 * large]
    text = [
        f"{minute_text(b.time)}: {b.name or f'fragment {b.fragment}'} ({area_text(1e6 * b.area_km2)}, "
        f"{count_text(b.elements, 'element')}) broke off {b.parent_name or f'berg {b.parent}'}, {where}.",
        f"{count_text(b.bonds, 'bond')} failed from {minute_text(b.first_break)} on, the first at {position}"
        + (", with an end aground." if first.grounded else "."),
        _strength_words(b.by_strength),
        _stress_words(first),
        f"Across the cut of {load.cut_km:.1f} km the load at {minute_text(load.time)} came to a nominal "
        f"{load.nominal / 1e3:.1f} kPa: {', '.join(shares)}.",
    ]
    if b.collision is not None:
        text.append(
            f"It broke in a collision: {b.collision.berg} met {b.parent_name or 'it'} at {b.collision.speed:.2g} m/s at "
            f"{minute_text(b.collision.time)} and was in contact with it while the first bond failed."
        )
    else:
        if b.sudden:
            text.append(_sudden_words(b))
        text.append(_cause_words(b, first.strength))
    if b.crack_km is not None and b.crack_towards is not None:
        text.append(f"The crack runs {b.crack_km:.1f} km from end to end, at {b.crack_towards:.0f} degrees from north.")
    if b.released_per_area is not None and b.released_toughness is not None:
        text.append(
            f"The crack released {_short(b.released_per_area)} J/m2 of its area, which a toughness of "
            f"{_short(b.released_toughness / 1e3)} kPa m1/2 would take."
        )
    if b.hours_since_start < STARTING:
        text.append(
            f"This is {b.hours_since_start:.1f} h after the start: acceleration from rest loads a berg too; see whether it"
            " breaks when it starts with the velocity of the water."
        )
    if b.closure is not None:
        afloat = " when it was last afloat" if load.aground else ""
        text.append(f"The forces explain the recorded motion{afloat} within {100.0 * b.closure:.1f} % of their sum.")
    if load.aground and not b.floor_recorded:
        text.append(FLOOR)
    for change, fate in b.controls.items():
        # As people write it: "still" for a break-up that was not removed, and no seconds.
        fate_text = "still " + re.sub(r"(\d{4}-\d\d-\d\d)T(\d\d:\d\d):\d\d", r"\1 \2", fate)
        text.append(f"{change.capitalize()} it {'does not break off' if fate == 'removed' else fate_text}.")
    return " ".join(clause for clause in text if clause)


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"


def _sudden_words(b: Breakup) -> str:
    """Return why the record before a break shows no sign of it."""
    sentence = f"No bond of the berg had more than {b.highest / 1e3:.1f} kPa at the record before"
    if b.decisive.aground or b.on_impact:
        return sentence + ": it broke within the long step, on impact."
    if b.in_equilibrium:
        return (
            sentence
            + ": the load grew to the strength between the records (--forces and more frequent records show it)."
        )
    hint = "." if b.controls else " (--controls tries half the long step)."
    if b.peak is None:
        return sentence + ": it broke within the long step, in the ringing after the impulse of the outer forces" + hint
    return (
        sentence + f", but {b.peak / 1e3:.1f} kPa between that and the one before it: it broke in the ringing after the"
        " impulses of the outer forces" + hint
    )


def _cause_words(b: Breakup, strength: float) -> str:
    """Return which force loads the cut, or that none does much."""
    if b.on_impact:
        return "Those are the loads before it touched the sea floor; the impact broke it."
    if b.decisive.nominal < SMALL_LOAD * strength and not b.decisive.aground:
        return "The load of the cut is small beside the strength: no force parts the cut as a whole, it failed bond by bond."
    # The two or three that pull most: one alone may be a third of the load.
    pulling = [(name, share) for name, share in b.causes if share > 0.0]
    leading = [(name, share) for name, share in pulling[:3] if share >= LEADING * pulling[0][1]]
    if not leading:
        return ""
    begin = "The cut is loaded because" if b.sudden and not b.decisive.aground else "It broke because"
    total = sum(share for _, share in pulling)
    causes = [
        f"{CAUSES.get(name, f'{name} acts on its parts differently')} ({name}, {share / 1e3:+.1f} kPa, "
        f"{100.0 * share / total:.0f} % of what pulls)"
        for name, share in leading
    ]
    return f"{begin} {', and because '.join(causes)}."


def _strength_words(by_strength: dict[str, int]) -> str:
    """Return which strengths the bonds exceeded, where it was not the normal one alone."""
    if not by_strength or list(by_strength) == ["normal"]:
        return ""
    (name, count), *others = by_strength.items()
    first = f"{count} bonds exceeded their {name} strength" if count > 1 else f"1 bond exceeded its {name} strength"
    rest = [f"{count} {'their' if count > 1 else 'its'} {name} one" for name, count in others]
    bent = ": the sea floor lifted the ice until it broke in bending" if "flexural" in by_strength else ""
    return f"{' and '.join([first, *rest])}{bent}."


def _stress_words(bond: FirstBond) -> str:
    """Return the stress of a bond some hours before it failed, and its strength."""
    strength = f"its strength is {bond.strength / 1e3:.3g} kPa, beside a pre-stress of {bond.prestress / 1e3:.0f} kPa."
    if not bond.tension:
        return f"No record shows its stress; {strength}"
    stress, hours = bond.peak or bond.tension, np.array(bond.hours)
    last = abs(float(bond.hours[-1]))
    when = (
        f"{last:.1f} h before"
        if last >= 0.5
        else f"{60.0 * last:.0f} min before"
        if last >= 1.0 / 60.0
        else "just before"
    )
    words = [f"{stress[-1] / 1e3:.1f} kPa {when}"]
    for earlier in (6.0, 24.0):
        k = int(np.argmin(np.abs(hours + earlier)))
        if abs(hours[k] + earlier) < 0.5 * earlier and k != len(hours) - 1:
            words.append(f"{stress[k] / 1e3:.1f} kPa {-hours[k]:.0f} h before")
    which = "largest tensile stress between records" if bond.peak else "tensile stress"
    return f"Its {which} was {', '.join(reversed(words))}; {strength}"
