"""KID's ``input.nml``: read with the leniencies of Intel's compiler, and turned into Riftberg's parameters by KID's own rules.

Only the groups ``icebergs_nml`` and ``icebergs_driver_nml`` (or ``drv_nml``) matter; others (of FMS) are named in the
report and not read. Accepted beyond the standard: texts without quotes (``traj_name=KID.nc``), whole numbers written as reals
(``mts_sub_steps=1e5``), any of ``T``, ``.true.``, ``true`` for logicals (files 7.1). Source of the rules: equations 0.2, 5.1,
6.4, 7 and the catalogue of quirks (11).
"""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import f90nml
import numpy as np

from riftberg.bergs.bonding import inscribed_share
from riftberg.engines.common.speed_limit import DEBRIS_SPEED
from riftberg.errors import BergError, InputError, NamelistError
from riftberg.kid.entries import (
    CALVING,
    GROUPS,
    HONOURED,
    OCEAN,
    REALS_SIZE,
    REFUSED,
    REPORTED,
    TEXT,
    Value,
    convert,
    find_entry,
    lacking,
    refused_entries,
)
from riftberg.kid.restart import (
    CALVING_FILE,
    DENSITIES,
    DEPTH_FILE,
    RESTART,
    id_text,
    read_depth,
    read_stores,
    split_id,
)
from riftberg.ocean.cells import Fields
from riftberg.ocean.grid import Grid
from riftberg.parameters import PUBLISHED_DRAG, Compatibility, Packing, Parameters, Scheme, kid_quirks
from riftberg.state import Bonds, Elements
from riftberg.system.input_files import MOST_YAML, check_file, extreme_allowed, reading
from riftberg.system.process import own_filters

MONTH: Final = 30 * 86_400
"""Length of a month, s."""

YEAR: Final = 12 * MONTH
"""Length of a year, s."""

LATE_START: Final = {355: 6 * 86_400 + 5 * 3600}
"""Start index of the A68 data -> start of the run after 0001-01-01 00:00, s (files, section 8.7)."""


class Date(NamedTuple):
    """A date of the 30-day calendar; year, month and day count from 1."""

    year: int
    month: int
    day: int
    hour: int
    minute: int
    second: float

    def year_day(self) -> float:
        """Return KID's day of the year, which counts 31 days for every month (files, section 0.3, quirk T2)."""
        hours = self.hour + (self.minute + self.second / 60.0) / 60.0
        return (self.month - 1) * 31 + (self.day - 1) + hours / 24.0

    def month_seconds(self) -> float:
        """Return 86400 day + seconds of the day, by which trajectories are sampled (dynamics, section 12)."""
        return 86_400 * self.day + 3600 * self.hour + 60 * self.minute + self.second

    def __str__(self) -> str:
        """Return the date as text."""
        return f"{self.year:04d}-{self.month:02d}-{self.day:02d} {self.hour:02d}:{self.minute:02d}:{self.second:02.0f}"


def date_after(seconds: float) -> Date:
    """Return the date that many seconds after 0001-01-01 00:00."""
    year, rest = divmod(seconds, YEAR)
    month, rest = divmod(rest, MONTH)
    day, rest = divmod(rest, 86_400)
    hour, rest = divmod(rest, 3600)
    minute, second = divmod(rest, 60)
    return Date(int(year) + 1, int(month) + 1, int(day) + 1, int(hour), int(minute), second)


def is_sampled(date: Date, hours: float) -> bool:
    """Whether a step that starts at a date gives a record every so many hours; -1 means every step."""
    return hours == -1.0 or date.month_seconds() % (3600.0 * hours) == 0.0


@dataclass(frozen=True)
class Clock:
    """Length of the run and its calendar."""

    dt: float  # Long step, s
    steps: int  # Number of long steps
    offset: float  # Start of the run after 0001-01-01 00:00, s

    def date(self, time: float) -> Date:
        """Return the date at a time (s) after the start of the run."""
        return date_after(self.offset + time)


_FOLDERS: Final = ("restart_input_dir", "data_dir")

_REMEDY: Final = "A KID run folder holds input.nml"
_MARK: Final = "\xef\xbb\xbf"
"""Byte order mark of UTF-8, as the file is read, which editors of Windows write."""
_CONTROL: Final = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_ASSIGNED: Final = re.compile(r"(?:^|[\s,])([A-Za-z]\w*)\s*(?:\([^()=]*\)\s*)?=", re.MULTILINE)
_REPEATED: Final = re.compile(r"(?<![\w.])(\d{3,})\*")


@dataclass(frozen=True)
class NamelistGroup:
    """Values of one group, defaults where the file is silent."""

    name: str  # Name of the group
    values: dict[str, Value]  # Value of every entry, by KID's spelling of the name
    given: frozenset[str]  # Entries that the file sets
    where: str  # File and group, for messages

    def _get(self, name: str, *types: type) -> Any:
        value = self.values[name]
        if not isinstance(value, types):
            raise TypeError(f"{name} is {type(value).__name__}")
        return value

    def flag(self, name: str) -> bool:
        """Return a logical entry."""
        return bool(self._get(name, bool))

    def whole(self, name: str) -> int:
        """Return an integer entry."""
        return int(self._get(name, int))

    def number(self, name: str) -> float:
        """Return a real entry."""
        return float(self._get(name, float))

    def numbers(self, name: str) -> tuple[float, ...]:
        """Return an entry of ten reals."""
        return tuple(self._get(name, tuple))

    def text(self, name: str) -> str:
        """Return a text entry."""
        return str(self._get(name, str))

    def error(self, fault: str, remedy: str = "") -> NamelistError:
        """Return an error that names the file and the group."""
        return NamelistError(fault, where=self.where, remedy=remedy)


@dataclass(frozen=True)
class KidNamelist:
    """The two groups of a KID namelist file that matter."""

    path: Path  # The file
    icebergs: NamelistGroup  # Group ``icebergs_nml``
    driver: NamelistGroup  # Group ``icebergs_driver_nml``; in cases that exchange with an ocean ``drv_nml``
    ignored_groups: tuple[str, ...]  # Other groups in the file

    @property
    def coupled(self) -> bool:
        """Whether the case exchanges with an ocean."""
        return self.driver.name == "drv_nml"

    @property
    def restarts(self) -> Path:
        """Folder of the restarts."""
        return self.path.parent / self.icebergs.text("restart_input_dir")

    @property
    def fed_back(self) -> bool:
        """Whether the stand-alone driver gets melt water back, which it takes for land ice (quirk T42)."""
        group = self.icebergs
        bits = group.flag("footloose") or group.number("bergy_bit_erosion_fraction") > 0.0
        return not (self.coupled or group.flag("passive_mode")) and (bits or not group.flag("set_melt_rates_to_zero"))

    def idle(self, name: str) -> str:
        """Return why a refused entry does nothing in this case, whatever its value; empty where it acts."""
        group = self.icebergs
        if name == "generate_test_icebergs" and (self.restarts / RESTART).is_file():
            return "there is a restart to read bergs from"
        weighed = group.flag("add_weight_to_ocean") or group.flag("find_melt_using_spread_mass")
        if name == "add_iceberg_thickness_to_SSH" and not (self.coupled or self.driver.flag("a68_test") or weighed):
            return "there is no weight of bergs, and no sea level that it would replace"
        return ""

    def report(self) -> list[str]:
        """Return one line for each entry of the file, each refused or noteworthy default, and each ignored group."""
        lines = [line for group in (self.driver, self.icebergs) for line in self._group_report(group)]
        return lines + [f"&{name}: ignored, it is not about icebergs" for name in self.ignored_groups]

    def _group_report(self, group: NamelistGroup) -> Iterator[str]:
        returns = self.coupled or self.fed_back
        for entry in GROUPS[group.name]:
            if entry.name in group.given or entry.name == "add_weight_to_ocean":
                judged = entry
                if entry.note in (CALVING, OCEAN):  # of effect only with an ocean and a flux of land ice
                    judged = replace(entry, note="") if returns else replace(entry, treatment=REPORTED)
                if judged.treatment == HONOURED and (lack := lacking(entry.name, group.values)):
                    judged = replace(entry, treatment=REPORTED, note=lack)
                value = group.values[judged.name]
                accepted = judged.treatment == REFUSED and value == judged.accepted
                if judged.treatment == REFUSED and not accepted and (why := self.idle(entry.name)):
                    judged = replace(entry, treatment=REPORTED, note=why)
                state = {REPORTED: "no effect here", REFUSED: "accepted" if accepted else "refused"}
                origin = "" if judged.name in group.given else " (default)"
                note = f": {judged.note}" if judged.note and not accepted else ""
                yield f"{judged.name} = {value!r}{origin}: {state.get(judged.treatment, 'honoured')}{note}"


def read_namelist(path: Path) -> KidNamelist:
    """Read a KID namelist file."""
    path = check_file(path, most=MOST_YAML, remedy=_REMEDY, kind=NamelistError)
    with reading(path, "cannot be read", _REMEDY, NamelistError):
        text = path.read_text(encoding="latin-1").removeprefix(_MARK)
    odd = _CONTROL.search(text)
    if odd:
        line = text.count("\n", 0, odd.start()) + 1
        raise NamelistError(
            f"the control character {odd.group()!a} stands there", where=f"{path}, line {line}", remedy="Remove it"
        )
    if many := _REPEATED.search(text):
        raise NamelistError(
            f"a value repeated {many[1][:20]} times",
            where=str(path),
            remedy="Lists of a namelist have 10 values at most",
        )
    groups = split_groups(text, path)
    names = [name for name, _ in groups]
    return KidNamelist(
        path=path,
        icebergs=_read_group("icebergs_nml", groups, path),
        driver=_read_group("drv_nml" if "drv_nml" in names else "icebergs_driver_nml", groups, path),
        ignored_groups=tuple(name for name in names if name not in GROUPS),
    )


def check_supported(namelist: KidNamelist) -> None:
    """Raise `NamelistError` if an active entry asks for something that Riftberg does not do, naming all of them."""
    group = namelist.icebergs
    refusals = [pair for pair in refused_entries(GROUPS[group.name], group.values) if not namelist.idle(pair[0].name)]
    if refusals:
        written = {True: ".true.", False: ".false."}
        written_values = [(e, written[value] if isinstance(value, bool) else value) for e, value in refusals]
        faults = "; ".join(f"{e.name} = {value}: {e.note}" for e, value in written_values)
        remedy = "; ".join(f"{e.name}: {e.remedy}" for e, _ in refusals)
        raise group.error(faults, f"Remedy: {remedy}")


def _read_group(name: str, groups: list[tuple[str, str]], path: Path) -> NamelistGroup:
    bodies = [body for group, body in groups if group == name]
    where = f"{path}, &{name}"
    if not bodies:
        others = ", ".join(f"&{group}" for group, _ in groups) or "no group at all"
        raise NamelistError(
            f"group &{name} is missing (the file has {others})",
            where=str(path),
            remedy=f"A run of the stand-alone driver needs &{name} ... /",
        )
    _check_names(name, bodies[0], where)
    raw = _parse(name, bodies[0], where)
    # Where lists begin that the file gives number by number, ``name(3) = 1.0``.
    starts = raw.pop("_start_index", {})
    values: dict[str, Value] = {entry.name: entry.default for entry in GROUPS[name]}
    names = set()
    for key, value in raw.items():
        entry = find_entry(name, key, where)
        first = starts.get(key.lower(), [1])[0]
        values[entry.name] = convert(entry, value, where, 1 if first is None else int(first))
        names.add(entry.name)
    return NamelistGroup(name, values, frozenset(names), where)


MOST_ASSIGNMENTS: Final = 1000
"""Values of a group: it has some 200 entries, and lists may be given number by number."""


def _check_names(name: str, body: str, where: str) -> None:
    """Refuse an unknown entry, or the same ones again and again, before the parser, which takes minutes over many."""
    # Without texts and comments, in which anything may look like an assignment.
    code = "\n".join(_mask_texts(name, line[: _comment_start(line)]) for line in body.split("\n"))
    names = _ASSIGNED.findall(code)
    for entry in dict.fromkeys(names):
        find_entry(name, entry, where)
    if len(names) > MOST_ASSIGNMENTS:
        most = max(set(names), key=names.count)
        raise NamelistError(
            f"{len(names)} assignments, {names.count(most)} of them to {most}", where=where,
            remedy=f"The group has {len(GROUPS[name])} entries: give each once",
        )  # fmt: skip


def _parse(name: str, body: str, where: str) -> dict[str, Any]:
    source = f"&{name}\n{quote_texts(name, body)}\n/\n"
    try:
        with own_filters():
            # The parser warns of values that it leaves out.
            warnings.filterwarnings("error", module=r"f90nml\b")
            return dict(f90nml.reads(source).todict().get(name, {}))
    except Exception as error:  # the parser raises bare StopIteration, ValueError, AssertionError and more
        reason = " ".join(f"{error or type(error).__name__}".split())[:120]
        raise NamelistError(
            f"cannot be parsed ({reason})", where=where, remedy="Look for a missing quote, comma, sign or value"
        ) from error


def quote_texts(group: str, body: str) -> str:
    """Put quotes around texts that lack them, as Intel's compiler accepts them."""
    names = "|".join(e.name for e in GROUPS[group] if e.kind == TEXT)
    if not names:
        return body
    pattern = re.compile(rf"(?i)(?<![\w'\"])({names})(\s*=\s*)([^\s'\",!][^\s,!'\"]*)")
    lines = ((line, _comment_start(line)) for line in body.split("\n"))
    return "\n".join(pattern.sub(lambda m: f"{m[1]}{m[2]}'{m[3]}'", line[:end]) + line[end:] for line, end in lines)


def _comment_start(line: str) -> int:
    quote = ""
    for k, char in enumerate(line):
        if quote:
            quote = "" if char == quote else quote
        elif char in "'\"":
            quote = char
        elif char == "!":
            return k
    return len(line)


def split_groups(text: str, path: Path) -> list[tuple[str, str]]:
    """Return names (lower case) and bodies of the groups of a namelist file, in order."""
    groups: list[tuple[str, str]] = []
    name, body = "", ""
    for line in text.splitlines():
        code = line[: _comment_start(line)]
        if not name:
            start = re.match(r"\s*[&$](\w+)", code)
            if start is None:
                continue
            name, body = start[1].lower(), ""
            code = code[start.end() :]
        bare = _mask_texts(name, code)
        # A slash within a text ends nothing, so texts are masked first.
        end = re.search(r"(?i)/|[&$]end\b", bare)
        piece, closed = (code[: end.start()], True) if end else (code, False)
        body += piece + "\n"
        if closed:
            groups.append((name, body))
            name = ""
    if name:
        raise NamelistError(f"group &{name} has no end", where=str(path), remedy="Close it with a line '/'")
    return groups


def _mask_texts(group: str, code: str) -> str:
    """Blank out quoted texts, and unquoted texts that may hold a slash, keeping the length of the line."""
    masked = re.sub(r"'[^']*'|\"[^\"]*\"", lambda m: " " * len(m[0]), code)
    names = "|".join(e.name for e in GROUPS.get(group, ()) if e.kind == TEXT)
    if not names:
        return masked
    pattern = re.compile(rf"(?i)(?<!\w)({names})\s*=\s*[^\s'\",!]+")

    def blank(match: re.Match[str]) -> str:
        # A slash that closes an unquoted file name is the end of the group; one that closes a folder is not.
        keep = match[0].endswith("/") and match[1].lower() not in _FOLDERS
        return " " * (len(match[0]) - 1) + ("/" if keep else " ")

    return pattern.sub(blank, masked)


LONGEST_STEP: Final = 864_000.0
"""Longest long step that is taken, s (10 days)."""

NEVER: Final = sys.float_info.max
"""Threshold of a stress that never breaks a bond, Pa."""

TIP_OF_SCHEME_TWO: Final = 999.0
"""KID's ``tip_parameter`` from which its second scheme of rolling acts."""


def to_parameters(namelist: KidNamelist) -> Parameters:
    """Return the physics of the namelist with the numerics and quirks of the reference."""
    check_supported(namelist)
    group = namelist.icebergs
    if group.number("rho_bergs") < DENSITIES[0]:
        raise group.error(
            f"rho_bergs = {group.number('rho_bergs'):g} kg m-3 is no density of ice",
            f"Give it in kg m-3: ice has {DENSITIES[0]:g} to {DENSITIES[1]:g}",
        )
    if group.flag("dem") and scheme(group) == "runge_kutta":
        raise group.error("dem = .true. with Runge_not_Verlet = .true.", "Set Runge_not_Verlet = .false.")
    if group.flag("footloose") and scheme(group) == "runge_kutta":
        raise group.error("footloose = .true. with Runge_not_Verlet = .true.", "Set Runge_not_Verlet = .false.")
    if group.flag("footloose") and not group.flag("use_operator_splitting"):
        raise group.error(
            "footloose = .true. with use_operator_splitting = .false.", "Set use_operator_splitting = .true."
        )
    try:
        return Parameters(**_groups(group, time_step(namelist)))
    except InputError as error:
        section = f"{error.where}: " if error.where else ""
        raise group.error(f"gives {section}{error.what}", "Correct that entry") from error


def time_step(namelist: KidNamelist) -> float:
    """Return the long step (s) after a check."""
    name = "dt" if namelist.coupled else "ibdt"
    dt = namelist.driver.number(name)
    if dt <= 0:
        raise namelist.driver.error(f"{name} = {dt} is no time step", "Give a positive number of seconds")
    if dt > LONGEST_STEP:
        raise namelist.driver.error(
            f"{name} = {dt:g} s is longer than {LONGEST_STEP:g} s", "Give minutes or hours, in s"
        )
    return dt


def scheme(group: NamelistGroup) -> Scheme:
    """Return the stepping scheme; ``mts`` overrides ``Runge_not_Verlet``."""
    if group.flag("mts"):
        return "mts"
    return "runge_kutta" if group.flag("Runge_not_Verlet") else "verlet"


def contact_stiffness(group: NamelistGroup) -> float:
    """Return the stiffness between bergs (s-2); ``spring_coef`` where none is given."""
    stated = group.number("contact_spring_coef")
    if (
        stated < 0.0
    ):  # the reference takes it for 0; a slip of sign would make ice a thousand times as soft without a word
        raise group.error(
            f"contact_spring_coef = {stated:g} is below 0", "Give 0 for that of spring_coef, or a stiffness"
        )
    return stated if stated > 0.0 else group.number("spring_coef")


def namelist_period(group: NamelistGroup) -> float:
    """Return the zonal period; the default of 360 means none on a Cartesian grid."""
    stated = group.number("Lx")
    return -1.0 if stated == 360.0 and not group.flag("grid_is_latlon") else stated


def substeps(group: NamelistGroup, dt: float) -> int:
    """Return the number of sub-steps; -1 means ``ceil(dt / (0.3 / sqrt(spring_coef)))``."""
    stated = group.whole("mts_sub_steps")
    if stated >= 1 or not group.flag("mts"):
        return max(stated, 1)
    spring = group.number("spring_coef")
    if stated != -1 or spring <= 0:
        raise group.error(
            f"mts_sub_steps = {stated} with spring_coef = {spring} gives no sub-steps", "Give a positive mts_sub_steps"
        )
    return math.ceil(dt / (0.3 / math.sqrt(spring)))


def _groups(group: NamelistGroup, dt: float) -> dict[str, dict[str, Any]]:
    """Parameters by group, entry by entry; melt, rolling, footloose and calving follow in `_life_groups`."""
    flag, number, mts = group.flag, group.number, group.flag("mts")
    dem = mts and flag("dem") and flag("iceberg_bonds_on")  # without ``mts`` they do not act (quirk Q25)
    # Thresholds of fracture (equations 7.1, 7.2; quirks Q8, Q9): in sub-steps they count as they stand. After the long step
    # one of 0 or less means never, and two of them mean that nothing is tested, whatever the criterion.
    inline = flag("break_bonds_on_sub_steps")
    normal, shear = (number(name) * number("frac_thres_scaling") for name in ("frac_thres_n", "frac_thres_t"))
    fracture = dem and (inline or normal > 0 or shear > 0)
    if fracture and (criterion := group.text("fracture_criterion")).lower() != "stress":
        cause = "break_bonds_on_sub_steps = .true." if inline else "positive frac_thres_n or frac_thres_t"
        raise group.error(
            f"fracture_criterion = '{criterion}' with {cause}",
            "Set fracture_criterion = 'stress', or switch fracture off",
        )
    if not inline:
        normal, shear = (value if value > 0 else NEVER for value in (normal, shear))
    # Repulsion comes from the cell search and attraction from the bonds (branch B of section 5.1).
    plain = not (mts or number("contact_distance") > 0 or contact_stiffness(group) != number("spring_coef"))
    return {
        "ice": {"density": number("rho_bergs")},
        "drag": {
            **PUBLISHED_DRAG,
            "ocean_scale": number("ocean_drag_scale"),
            "sides_by_bonds": flag("internal_bergs_for_drag"),
            "rotational": False,
        },
        "grounding": {
            "coefficient": number("cdrag_grounding"),
            "ramp_height": max(number("h_to_init_grounding"), 0.0),
            "on_substeps": flag("short_step_mts_grounding") and mts,
            "implicit": False,
            "torque": flag("use_grounding_torque"),
        },
        "contact": {
            "spring": contact_stiffness(group),
            "on_substeps": False,
            "distance": max(number("contact_distance"), 0.0),
            "critical_damping": flag("critical_interaction_damping_on"),
            "tangential_critical_damping": flag("tang_crit_int_damp_on"),
            "radial_damping": number("radial_damping_coef"),
            "tangential_damping": number("tangental_damping_coef"),
            "iterate": flag("force_convergence"),
            "tolerance": number("convergence_tolerance"),
        },
        "bonds": {
            "law": "none" if not flag("iceberg_bonds_on") else ("dem" if dem else "spring"),
            "packing": "hexagonal" if flag("hexagonal_icebergs") else "square",
            "spring": number("spring_coef"),
            "youngs_modulus": number("dem_spring_coef"),
            "poisson": number("poisson"),
            "damping": number("dem_damping_coef"),
            "objective_damping": False,
            "no_shear": flag("ignore_tangential_force"),
            "linear_bending": flag("orig_dem_moment_of_inertia"),
            "max_bonds": group.whole("max_bonds") if flag("iceberg_bonds_on") else 0,
            "constant_size": flag("constant_interaction_LW"),
            "constant_length": number("constant_length"),
            "constant_width": number("constant_width"),
        },
        "fracture": {
            "enabled": fracture,
            "normal_strength": normal,
            "shear_strength": shear,
            "on_substeps": inline,
            "broken_as_contact": flag("use_broken_bonds_for_substep_contact") and inline,
            "not_in_first_step": flag("no_frac_first_ts"),
        },
        "stepping": {
            "scheme": scheme(group),
            "time_step": dt,
            "substeps": substeps(group, dt),
            "explicit_substeps": flag("explicit_inner_mts") or flag("dem"),
            "predictor_corrector": flag("use_new_predictive_corrective"),
            "skip_first_long_force": flag("skip_first_outer_mts_step"),
            "only_interactions": flag("only_interactive_forces"),
            "frozen": flag("Static_icebergs"),
            "fixed_velocity": (
                (number("u_override"), number("v_override")) if flag("override_iceberg_velocities") else None
            ),
            "interactions": flag("interactive_icebergs_on"),
            **({"speed_limit": DEBRIS_SPEED} if extreme_allowed() else {}),
        },
        "earth": {
            "latlon": flag("grid_is_latlon"),
            "radius": number("Rearth"),
            "period": namelist_period(group),
            "f_plane": flag("use_f_plane"),
            "reference_latitude": number("lat_ref"),
        },
        **_life_groups(group),
        "compatibility": Compatibility.kid(
            shared_shear_lever=flag("save_bond_forces"),
            grid_position_round_trip=plain,
            plain_kid_branch=plain,
            radius_based=flag("radius_based_drag") and flag("hexagonal_icebergs") and dem,
            damping_by_speed=flag("scale_damping_by_pmag"),
        ).model_dump(),
    }


def _life_groups(group: NamelistGroup) -> dict[str, dict[str, Any]]:
    """Melt, rolling, footloose calving and calving from land ice (files 1, 2, 3)."""
    flag, number, quirks = group.flag, group.number, kid_quirks()
    shelf, mixed = flag("melt_icebergs_as_ice_shelf"), flag("use_mixed_melting")
    equations = "three_equation" if flag("Use_three_equation_model") else "two_equation"
    cutoff, tip = number("melt_cutoff"), number("tip_parameter")
    older = "weeks_mellor" if tip >= TIP_OF_SCHEME_TWO else "legacy"

    def classes(*names: str) -> dict[str, tuple[float, ...]]:
        ours = ("mass", "fraction", "scaling", "thickness")
        return {key: group.numbers(name) for key, name in zip(ours, names, strict=True)}

    south = classes("initial_mass", "distribution", "mass_scaling", "initial_thickness")
    north = classes("initial_mass_n", "distribution_n", "mass_scaling_n", "initial_thickness_n")
    return {
        "melt": {
            "enabled": True,
            "mode": "mixed" if mixed else ("shelf" if shelf else "berg"),
            "base": equations if mixed or shelf else "turbulent",
            "salinity_from_ocean": flag("use_mixed_layer_salinity_for_thermo"),
            "split": flag("use_operator_splitting"),
            "bits_fraction": max(number("bergy_bit_erosion_fraction"), 0.0),
            "const_gamma": flag("const_gamma"),
            "gamma_t": number("Gamma_T_3EQ"),
            "friction_drag": number("cdrag_icebergs"),
            "least_friction": number("ustar_icebergs_bg"),
            "tide": number("utide_icebergs"),
            "least_gap": cutoff if cutoff >= 0.0 and flag("apply_thickness_cutoff_to_bergs_melt") else None,
            "sea_ice_shift": number("sicn_shift"),
            "zero_rates": flag("set_melt_rates_to_zero"),
            "keep_shape": flag("Iceberg_melt_without_decay"),
            **quirks["melt"],
        },
        "rolling": {
            "enabled": flag("allow_bergs_to_roll"),
            "scheme": "updated" if flag("use_updated_rolling_scheme") else older,
            "tip": tip,
            **quirks["rolling"],
        },
        "footloose": {
            "enabled": flag("footloose"),
            "youngs": number("fl_youngs"),
            "strength": 1000.0 * number("fl_strength"),  # kPa in namelists
            "style": "bergs" if group.text("fl_style") == "new_bergs" else "bits",
            "displace": flag("displace_fl_bergs"),
            "berg_mass": number("new_berg_from_fl_bits_mass_thres"),
            "one_draw": flag("fl_init_child_xy_by_pe"),
            **quirks["footloose"],
        },
        "calving": {
            "south": south,
            "north": north if flag("separate_distrib_for_n_hemisphere") else None,
            "fractions": "number" if flag("input_freq_distribution") else "mass",
            "length_over_width": number("LoW_ratio"),
            # Given in years; KID divides by the seconds of a year all the same (quirk T14).
            "smoothing_time": max(number("tau_calving"), 0.0) / (365.0 * 24.0 * 60.0 * 60.0),
            **quirks["calving"],
        },
    }


def add_file_depth(fields: Fields, group: NamelistGroup, restarts: Path, grid: Grid) -> Fields:
    """Return fields with the depth of ``topog.nc`` in the domain, if the namelist asks for it and there is such a file."""
    depth = read_depth(restarts / DEPTH_FILE, grid) if group.flag("read_ocean_depth_from_file") else None
    if depth is None:
        return fields
    depths = fields.depth.copy()
    depths[grid.domain] = depth
    return fields._replace(depth=depths)


def depth_notes(group: NamelistGroup, restarts: Path) -> list[str]:
    """Say that depths are the driver's where the file that the namelist wants is not there."""
    if not group.flag("read_ocean_depth_from_file") or (restarts / DEPTH_FILE).is_file():
        return []
    return [f"read_ocean_depth_from_file = .true., but there is no {restarts / DEPTH_FILE}: depths are the driver's"]


def check_calving_store(folder: Path, group: NamelistGroup, grid: Grid) -> None:
    """Refuse a store of calved ice that is large enough to release a berg."""
    path = folder / CALVING_FILE
    stores = read_stores(path, grid, REALS_SIZE)
    if stores is None:
        return
    classes = stores.ice
    northern = "_n" if group.flag("separate_distrib_for_n_hemisphere") else ""
    for suffix in {"", northern}:
        mass, scaling = group.numbers(f"initial_mass{suffix}"), group.numbers(f"mass_scaling{suffix}")
        for k, (m, s) in enumerate(zip(mass, scaling, strict=True)):
            if float(classes[k].max()) >= m * s:
                raise group.error(
                    f"{path} stores {float(classes[k].max()):g} kg in size class {k + 1}, enough to calve a berg",
                    "Only cases with an ocean (group drv_nml) calve: remove the file",
                )


TOO_CLOSE: Final = 0.01
"""Length of a bond, in sums of the radii of its ends, that no run can start from."""


def check_bond_lengths(elements: Elements, bonds: Bonds, packing: Packing) -> None:
    """Refuse bonds between elements that lie on top of each other: their force would have no direction.

    Elements without a bond may lie so: bergs that calve in one cell are born on one spot.
    """
    share = inscribed_share(elements, packing)
    radius = np.sqrt(share * elements.length * elements.width)
    close = bonds.bond_length < TOO_CLOSE * (radius[bonds.first] + radius[bonds.second])
    if close.any():
        k = int(np.argmax(close))
        first, second = bonds.first[k], bonds.second[k]
        raise BergError(
            f"two elements with a bond lie on top of each other, {bonds.bond_length[k]:.3g} m apart at "
            f"{elements.lon[first]:g}, {elements.lat[first]:g}",
            where=f"elements {id_text(elements.id[first])} and {id_text(elements.id[second])}",
            remedy="Remove one of them from the iceberg restart",
        )


ROUND_OFF: Final = 1e-9
"""Relative difference up to which two sizes of elements are one size: those of KID's own lattices differ by some 1e-16."""


def check_both_sides(elements: Elements, bonds: Bonds, group: NamelistGroup, p: Parameters) -> None:
    """Refuse bonds whose two sides KID would compute with unequal thickness: it then pulls at both with unequal forces.

    So it is with equal sizes, where the side that is not its own gives the thickness (quirk Q11).
    """
    if p.bonds.law != "dem" or p.quirks.shared_shear_lever:
        return
    body, i, j = elements.body, bonds.first, bonds.second
    melts = p.melt.enabled and not p.melt.zero_rates  # elements with bonds never roll
    area = body.length * body.width
    alike = p.bonds.constant_size | np.isclose(area[i], area[j], rtol=ROUND_OFF, atol=0.0)
    unequal = alike & (~np.isclose(body.thickness[i], body.thickness[j], rtol=ROUND_OFF, atol=0.0) | melts)
    if unequal.any():
        k = int(np.argmax(unequal))
        (counters, cells), thickness = (split_id(elements.id[[i[k], j[k]]])), body.thickness
        raise group.error(
            f"save_bond_forces = .false. with bonded elements of {thickness[i[k]]:g} and {thickness[j[k]]:g} m (id_cnt = "
            f"{counters[0]} and {counters[1]}, id_ij = {cells[0]} and {cells[1]}){' that melt' if melts else ''}: each "
            "side of the bond then has a force of its own, and the berg drives itself",
            "Set save_bond_forces = .true.",
        )


def check_footloose(elements: Elements, group: NamelistGroup) -> None:
    """Refuse footloose calving of elements with bonds, at which the reference stops in its first step (files, 2)."""
    bonded = (elements.bond_count > 0) & (elements.static < 0.5) & (elements.life.fl_k >= 0.0)
    if group.flag("footloose") and bonded.any():
        k = int(np.argmax(bonded))
        raise group.error(
            f"footloose = .true. with iceberg_bonds_on = .true.: the element at {elements.lon[k]:g}, {elements.lat[k]:g} has "
            f"{elements.bond_count[k]} bonds, and the reference stops there too",
            "Set one of them to .false.",
        )


def order_sides(elements: Elements) -> int:
    """Make length the longer side, as KID does in its first step; return how many elements changed."""
    wrong = elements.width > elements.length
    elements.width[wrong], elements.length[wrong] = elements.length[wrong], elements.width[wrong]
    return int(wrong.sum())
