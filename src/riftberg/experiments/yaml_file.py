"""Experiments from YAML files: read, checked and explained by line, then built.

The text is read so that nothing in it can hang, explode or pass for something else: its characters, depth, tags and aliases
are looked at before anything is built from it, and each value is built by itself, so that a date such as the 31st of February
is reported with its line.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_args

import numpy as np
import yaml
from pydantic import ValidationError
from pydantic.fields import FieldInfo

from riftberg.bergs.bonded import lost_in_lattice, outside_text
from riftberg.bergs.keys import CloudOfBergs, FieldOfBergs
from riftberg.config.values import Place, field_extra, findings, nested_sections
from riftberg.errors import BergError, InputError, nearest, together
from riftberg.experiments.changes import OF_NAMELISTS, changed_document, reference_numerics
from riftberg.experiments.registry import Info, Options, find
from riftberg.experiments.schema import (
    PRESETS,
    Berg,
    Experiment,
    ExperimentForcing,
    FormulaForcing,
    OpenDriftForcing,
    SeriesForcing,
    Shelf,
    Strength,
    check_span,
)
from riftberg.ocean.files_schema import FileForcing
from riftberg.ocean.formulas import Sum
from riftberg.parameters import (
    A68A_2022,
    PUBLISHED_SPRINGS,
    Earth,
    ExplicitParameters,
    Parameters,
    choose_a68a_preset,
    fields_by_path,
)
from riftberg.system.input_files import MOST_YAML, check_file, in_folder, shown, value_shown
from riftberg.system.netcdf_lock import closing_files

if TYPE_CHECKING:
    from datetime import datetime

    from riftberg.bergs.iceberg import Iceberg
    from riftberg.ocean.forcing import Forcing
    from riftberg.ocean.series import Series
    from riftberg.runs.model import Model


REMEDY: Final = "Name a YAML file, as in the guide to experiments of one's own"
DEEPEST: Final = 20
"""Sections and lists within each other."""

MOST_NODES: Final = 50_000
"""Values of a file, those behind aliases counted as often as they are used."""

_CORE: Final = frozenset(
    f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "timestamp", "seq", "map", "merge")
)
_KEY_TAGS: Final = frozenset(f"tag:yaml.org,2002:{name}" for name in ("str", "int", "float", "bool", "null", "merge"))


def _line(node: Any) -> int:
    """Return the line in which an event or a node begins, from 1."""
    return int(node.start_mark.line) + 1 if node.start_mark else 1


class Document:
    """A YAML file with the lines of its keys."""

    def __init__(self, path: Path, sections: str = "") -> None:
        self.path, self._sections = path, sections
        self.lines: dict[Place, int] = {}
        self._nodes = 0
        self.values = self._load(self._text())

    def _text(self) -> str:
        check_file(self.path, remedy=REMEDY, most=MOST_YAML)
        try:
            text = self.path.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(
                "not a text file in UTF-8", where=shown(self.path), remedy="Save it as UTF-8, or name another"
            ) from error
        bad = yaml.reader.Reader.NON_PRINTABLE.search(text)
        if bad:
            line = text.count("\n", 0, bad.start()) + 1
            raise self._wrong(f"the control character {bad.group()!a} stands there", line, "Remove it")
        return text

    def _wrong(self, problem: str, line: int, remedy: str = "") -> InputError:
        return InputError(problem, where=f"{shown(self.path)}, line {line}", remedy=remedy)

    def _load(self, text: str) -> dict[str, Any]:
        try:
            # Depth and tags are judged from the events alone, before nodes are built: nothing can explode yet.
            depth = 0
            for event in yaml.parse(text, Loader=yaml.SafeLoader):
                if isinstance(event, yaml.CollectionStartEvent):
                    depth += 1
                    if depth > DEEPEST:
                        raise self._wrong(
                            f"more than {DEEPEST} sections or lists within each other", _line(event),
                            "An experiment file has no more than 5",
                        )  # fmt: skip
                elif isinstance(event, yaml.CollectionEndEvent):
                    depth -= 1
                tag = getattr(event, "tag", None)
                if tag not in (None, "!") and tag not in _CORE:
                    raise self._wrong(f"the tag {value_shown(tag)} is not known", _line(event), "Write the plain value")
            node = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            line = f", line {mark.line + 1}" if mark else ""
            raise InputError(
                f"not valid YAML: {shown(error.problem or error.context)}", where=f"{shown(self.path)}{line}",
                remedy="Look at brackets, quotes, colons and the spaces before that line",
            ) from error  # fmt: skip
        except yaml.YAMLError as error:
            raise InputError(f"not valid YAML: {shown(error)}", where=shown(self.path), remedy=REMEDY) from error
        if not isinstance(node, yaml.MappingNode):
            raise InputError(
                "an experiment file is a list of sections", where=shown(self.path),
                remedy=f"It has {self._sections}" if self._sections else REMEDY,
            )  # fmt: skip
        self._mark(node, (), ())
        loader = yaml.SafeLoader("")
        try:
            self._check_scalars(node, loader, set())
            values: dict[str, Any] = loader.construct_document(node)
        except yaml.MarkedYAMLError as error:
            number = error.problem_mark.line + 1 if error.problem_mark else 1
            raise self._wrong(
                f"not valid YAML: {shown(error.problem)}", number, "Write plain keys and values"
            ) from error
        finally:
            loader.dispose()
        return values

    def _mark(self, node: yaml.Node, key_path: Place, above: tuple[int, ...]) -> None:
        """Note the line of every key; refuse keys that stand twice or are no words, and aliases that never end."""
        self._nodes += 1
        line = _line(node)
        if id(node) in above:
            raise self._wrong("an alias (*) that holds itself", line, "Write the values out")
        if self._nodes > MOST_NODES:
            raise self._wrong(
                f"more than {MOST_NODES} values, those behind aliases (*) counted each time", line, "Write fewer values"
            )
        above = (*above, id(node))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                self._mark_key(key, value, key_path, above)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self.lines[(*key_path, index)] = _line(value)
                self._mark(value, (*key_path, index), above)

    def _mark_key(self, key: yaml.Node, value: yaml.Node, key_path: Place, above: tuple[int, ...]) -> None:
        line = _line(key)
        if not isinstance(key, yaml.ScalarNode) or key.tag not in _KEY_TAGS:
            raise self._wrong("a key that is no word", line, "Keys are plain words, such as days")
        inner = (*key_path, str(key.value))
        if inner in self.lines:
            raise self._wrong(
                f"{'.'.join(map(str, inner))} stands twice, first in line {self.lines[inner]}", line, "Leave one out"
            )
        self.lines[inner] = line
        self._mark(value, inner, above)

    def _check_scalars(self, node: yaml.Node, loader: yaml.SafeLoader, seen: set[int]) -> None:
        """Build every plain value by itself, so that one that cannot be built is reported with its line."""
        if id(node) in seen:
            return
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                self._check_scalars(key, loader, seen)
                self._check_scalars(value, loader, seen)
        elif isinstance(node, yaml.SequenceNode):
            for value in node.value:
                self._check_scalars(value, loader, seen)
        else:
            self._check_scalar(node, loader)

    def _check_scalar(self, node: yaml.Node, loader: yaml.SafeLoader) -> None:
        text, line = str(node.value), _line(node)
        kind = node.tag.rpartition(":")[2]
        if kind in ("int", "float"):
            digits = text.lstrip("+-").replace("_", "")
            if ":" in text:
                raise self._wrong(
                    f"{value_shown(text)} would be read as a number to the base 60", line, "Write a plain number"
                )
            if kind == "int" and len(digits) > 1 and digits[0] == "0":
                raise self._wrong(
                    f"{value_shown(text)} would not be read as a decimal number",
                    line,
                    "Write it without the leading zero",
                )
        try:
            loader.construct_object(node)
        except (ValueError, OverflowError, KeyError, AttributeError, TypeError) as error:
            problem = "no date that exists" if kind == "timestamp" else f"no {kind} that can be read"
            remedy = "Dates are such as 2020-12-09 13:00" if kind == "timestamp" else "Write a plain value"
            raise self._wrong(f"{value_shown(text)} is {problem}", line, remedy) from error

    def _known(self, key_path: Place) -> Place:
        """Return the path of a key, or of the section around it, whose line is known."""
        located: Place = ()
        for key in key_path:
            if (*located, key) in self.lines:
                located = (*located, key)
            elif key != 0:  # one section may stand where a list of them may
                break
        return located

    def where(self, key_path: Place) -> str:
        """Return file, line and key of a path."""
        located = self._known(key_path)
        line = f", line {self.lines[located]}" if located else ""
        key = shown(".".join(str(name) for name in key_path))
        return f"{shown(self.path)}{line}" + (f", {key}" if key else "")

    def error(self, problem: str, key_path: Place, remedy: str = "") -> InputError:
        """Return an error that names the key."""
        return InputError(problem, where=self.where(key_path), remedy=remedy)

    def refusal(self, faults: list[tuple[Place, InputError]]) -> InputError:
        """Return one error for all faults, in the order of the file."""
        order = {key_path: number for number, key_path in enumerate(self.lines, start=1)}
        in_order = sorted(faults, key=lambda fault: order.get(self._known(fault[0]), 0))
        return together([self.error(fault.what, key_path, fault.remedy) for key_path, fault in in_order])


def _default_name(path: str | Path) -> str:
    """Return the name of an experiment that gives itself none: the name of its file, in letters that a folder may have."""
    plain = re.sub(r"[^\w.-]+", "-", Path(path).stem)
    return re.sub(r"^[^A-Za-z0-9]+", "", plain) or "experiment"


SMALLEST_SPHERE = 1e6
"""Radius (m) of the sphere below which it is a slip of units."""


def read_file(
    path: Path, changes: Mapping[str, Mapping[str, Any]] | None = None, data: Path | None = None
) -> tuple[Experiment, Parameters, Document]:
    """Read and check an experiment file; all that is wrong with it is reported at once.

    ``changes``: keys of its sections that are to be other ones, by section and path in it; parameters are left alone. ``data``:
    folder of its files, by default its own.
    """
    document = Document(Path(path), ", ".join(Experiment.model_fields))
    forcing = {group: inner for group, inner in (changes or {}).items() if group == "forcing"}
    values = changed_document({"name": _default_name(path), **document.values}, forcing)
    values = changed_document(_fill_from_track(values, data or Path(path).parent), changes or {})
    faults: list[tuple[Place, InputError]] = []
    parameters, experiment = Parameters(), None
    try:
        parameters = _parameters(values.get("parameters"))
    except InputError as error:
        faults += [(("parameters", *_split_key(fault.where)), fault) for fault in error.faults]
    if parameters.earth.latlon and parameters.earth.radius < SMALLEST_SPHERE:
        radius = InputError(
            f"{parameters.earth.radius:g} m is no radius of the Earth",
            remedy=f"Give {SMALLEST_SPHERE:g} m or more, usually 6.371e6",
        )
        faults.append((("parameters", "earth", "radius"), radius))
    try:
        experiment = Experiment.model_validate(values, context=_coordinates(parameters.earth))
    except ValidationError as error:
        faults += findings(error, Experiment)
    if faults or experiment is None:
        raise document.refusal(faults)
    return experiment, _set_packing(parameters, experiment), document


def _fill_from_track(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the contents of a file with start, length and berg of the trajectory that forces it, where the file lacks them."""
    forcing = values.get("forcing")
    missing = {"start", "days", "berg"} - values.keys() - ({"berg"} if "bergs" in values else set())
    if not isinstance(forcing, dict) or not isinstance(forcing.get("opendrift"), str) or not missing:
        return values
    from riftberg.runs.opendrift import read_trajectory

    number = forcing.get("trajectory")
    trajectory = read_trajectory(in_folder(folder, forcing["opendrift"]), number if isinstance(number, int) else None)
    defaults: dict[str, Any] = {
        "start": trajectory.start,
        "days": float((trajectory.times[-1] - trajectory.times[0]) / np.timedelta64(1, "D")),
    }
    if "berg" in missing:
        size = trajectory.known_size()
        position = [float(trajectory.lon[0]), float(trajectory.lat[0])]
        defaults["berg"] = {
            "rectangle": {"length": size["length"], "width": size["width"]},
            "thickness": size["thickness"],
            "placement": position,
        }
    return {**{name: defaults[name] for name in missing}, **values}


def _parameters(groups: Any) -> Parameters:
    """Return the preset of a file with its changes."""
    groups = {str(name): values for name, values in groups.items()} if isinstance(groups, dict) else {}
    preset = groups.pop("preset", "default")
    if not isinstance(preset, str) or preset not in PRESETS:
        raise InputError(
            f"preset {value_shown(preset)} is not known", where="preset",
            remedy=f"{nearest(str(preset), PRESETS)}Use {', '.join(PRESETS)}",
        )  # fmt: skip
    for group, values in groups.items():
        for name in values if isinstance(values, dict) else ():
            field = fields_by_path().get(f"{group}.{name}")
            if field is not None and field_extra(field, "hidden"):
                raise InputError(
                    "it is an option of KID's namelists alone", where=f"{group}.{name}", remedy=OF_NAMELISTS
                )
    usual = PRESETS[preset]
    if usual is A68A_2022:
        usual = choose_a68a_preset(groups)
    if isinstance(usual, ExplicitParameters):  # the number of sub-steps of a preset belongs to its lattice
        usual = usual.changed(stepping={"substeps": None})
    return usual.changed(**groups)


def _set_packing(parameters: Parameters, experiment: Experiment) -> Parameters:
    """Return the parameters with the packing of the bergs, unless the file sets it."""
    hexagonal = any(berg.packing == "hexagonal" for _, berg in experiment.all_bergs)
    shape = {"packing": "hexagonal" if hexagonal else "square"}
    return parameters.changed(bonds={**shape, **experiment.parameters.get("bonds", {})})


def _coordinates(earth: Earth) -> dict[str, Any]:
    """Return the context that sections take from the parameters: whether positions are metres, and the latitude of a plane."""
    plane = earth.f_plane or not earth.latlon
    latitude = earth.reference_latitude if plane else None
    return {"metres": not earth.latlon, "coordinates": {"latlon": earth.latlon, "latitude": latitude}}


def _split_key(where: str) -> Place:
    return tuple(int(key) if key.isdigit() else key for key in where.split(".")) if where else ()


@closing_files(only_if_refused=True)
def build_file(path: Path, options: Options) -> tuple[Model, Info]:
    """Build the experiment of a YAML file."""
    from riftberg.runs.model import Model

    experiment, parameters, _ = read_file(path, options.changes, options.data)
    notices: list[str] = []
    if options.numerics == "reference":
        springs = PUBLISHED_SPRINGS if experiment.parameters.get("preset") == "a68a-2022" else {}
        parameters = reference_numerics(parameters, springs=springs, notices=notices)
    parameters = options.apply(parameters)
    folder = options.data or Path(path).parent
    berg = build_berg(experiment, parameters, folder, notices)
    days = options.days or experiment.days
    check_span(experiment.start, days, where="--days" if options.days else str(path))
    forcing = build_forcing(experiment, folder, days, options, berg, parameters)
    notices += forcing.notices
    if options.ocean is not None:
        forcing = options.ocean(forcing, parameters)
    lattice_text, loses = lost_in_lattice(berg)
    info = Info(
        experiment.name,
        experiment.title,
        days,
        experiment.output_every_hours,
        notices=tuple(notices),
        output_forces=experiment.output_forces,
        output_cells=experiment.output_cells,
        made=lattice_text,
        loses=loses,
    )
    return Model(berg, forcing, parameters, experiment.start), info


def build_berg(
    experiment: Experiment, parameters: Parameters, folder: Path, notices: list[str] | None = None
) -> Iceberg:
    """Build the berg or bergs of an experiment, with their rifts and the strengths of their bonds.

    ``notices``: takes a sentence for each rift that changes nothing.
    """
    from riftberg.bergs.iceberg import Iceberg

    drawn: Counter[int] = Counter()
    notices = [] if notices is None else notices
    built = [_one_berg(section, berg, parameters, folder, drawn, notices) for section, berg in experiment.all_bergs]
    if experiment.berg is not None:
        return built[0]
    with _name_key("bergs"):
        return Iceberg.join(built)


def _distinct_seed(seed: int, drawn: Counter[int]) -> int:
    """Return the seed of one of several bergs: unchanged for the first, and one of its own for each that shares it."""
    number = drawn[seed]
    drawn[seed] += 1
    return int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)[0]) if number else seed


def _one_berg(
    section: str, berg: Berg, parameters: Parameters, folder: Path, drawn: Counter[int], notices: list[str]
) -> Iceberg:
    """Build one berg of an experiment; ``section`` is the name of its section, ``drawn`` counts the seeds that are used."""
    if berg.field is not None:
        with _name_key(f"{section}.field"):
            return _build_field(berg, berg.field, parameters)
    if berg.seed is not None:
        with _name_key(f"{section}.seed"):
            return _build_cloud(berg, berg.seed, parameters)
    if berg.points is not None:
        with _name_key(f"{section}.points"):
            return _build_points(berg, Path(in_folder(folder, berg.points.file)), parameters)
    iceberg = _whole_berg(berg, parameters, folder)
    for index, rift in enumerate(berg.rifts):
        with _name_key(f"{section}.rifts.{index}"):
            from riftberg.bergs.raster import is_map, read_raster

            source: Any = rift.points
            if rift.file is not None:
                path = Path(in_folder(folder, rift.file))
                source = read_raster(path, rift.variable) if is_map(path) else path
            iceberg = iceberg.with_rifts(
                source, strength=rift.strength if "strength" in rift.model_fields_set else None, broken=rift.broken,
                depth=rift.depth, crevasse_strength=getattr(parameters.fracture, "crevasse_strength", None), crs=rift.crs,
                threshold=rift.threshold,
            )  # fmt: skip
            notices += [f"{section}.rifts.{index}: {text}" for text in _idle_rift_lines(iceberg.report["rifts"][-1])]
    if berg.strength is not None:
        with _name_key(f"{section}.strength"):
            iceberg = _apply_strength(iceberg, berg.strength, folder, drawn)
    return iceberg if berg.name is None else iceberg.named(berg.name)


def _idle_rift_lines(rift: dict[str, Any]) -> list[str]:
    """Return that a rift lies outside of the ice, or in crevasses which reach deeper by themselves, if so."""
    notices = [outside_text(rift["outside"])] if rift["outside"] > 0.0 else []
    if not rift.get("unchanged"):
        return notices
    share = "" if rift["unchanged"] == rift["crossed"] else f" at {rift['unchanged']} of its {rift['crossed']} bonds"
    return [
        *notices,
        f"its depth of {rift['depth']:g} changes nothing{share}: with fracture.crevasse_strength the ice is crevassed down to "
        f"{rift['crevassed']:.2g} of its thickness before it parts",
    ]


@contextmanager
def _name_key(key: str) -> Iterator[None]:
    """Name the key of the file in errors about its value."""
    try:
        yield
    except BergError as error:
        where = f"{key}, {error.where}" if error.where else key
        raise BergError(error.what, where=where, remedy=error.remedy) from error


def _apply_strength(berg: Iceberg, strength: Strength, folder: Path, drawn: Counter[int]) -> Iceberg:
    from riftberg.bergs.raster import read_raster

    if strength.file is not None:
        return berg.with_strength(read_raster(Path(in_folder(folder, strength.file)), strength.variable))
    seed = _distinct_seed(strength.seed, drawn)
    if strength.weibull is not None:
        return berg.with_strength("weibull", shape=strength.weibull, seed=seed)
    if strength.normal is not None:
        return berg.with_strength("normal", spread=strength.normal, seed=seed)
    return berg.with_strength("uniform", spread=strength.uniform, seed=seed)


def _whole_berg(berg: Berg, parameters: Parameters, folder: Path) -> Iceberg:
    from riftberg.bergs.iceberg import Iceberg

    thickness = berg.thickness if isinstance(berg.thickness, float) else Path(in_folder(folder, berg.thickness))
    common: dict[str, Any] = {
        "thickness": thickness, **_radius_given(berg), "packing": berg.packing, "density": parameters.ice.density,
        "velocity": berg.velocity, "spin": berg.spin, "rotation": berg.rotation,
        "earth_radius": parameters.earth.radius, "lattice_angle": berg.lattice_angle, "offset": berg.offset,
    }  # fmt: skip
    if berg.outline is not None:
        outline = berg.outline
        return Iceberg.from_outline(
            Path(in_folder(folder, outline.file)), feature=outline.feature, date=outline.date, crs=outline.crs,
            repair=outline.repair, placement=berg.placement, shift=berg.shift, **common,
        )  # fmt: skip
    if berg.mask is not None:
        mask = berg.mask
        return Iceberg.from_mask(
            Path(in_folder(folder, mask.file)), variable=mask.variable, threshold=mask.threshold, date=mask.date,
            placement=berg.placement, shift=berg.shift, **common,
        )  # fmt: skip
    if berg.shelf is not None:
        return _from_shelf(berg, berg.shelf, parameters, folder)
    assert berg.placement is not None
    common |= {"placement": (berg.placement[0] + berg.shift[0], berg.placement[1] + berg.shift[1])}
    common |= {"latlon": parameters.earth.latlon}
    if berg.rectangle is not None:
        return Iceberg.rectangle(berg.rectangle.length, berg.rectangle.width, **common)
    assert berg.lattice is not None
    return Iceberg.from_table(berg.lattice.rows, table_radius=berg.lattice.cell_radius, **common)


def _from_shelf(berg: Berg, shelf: Shelf, parameters: Parameters, folder: Path) -> Iceberg:
    from riftberg.bergs.bonding import Metric, turn_rigidly
    from riftberg.coupling.shelf import IceShelf

    path = Path(in_folder(folder, shelf.file))
    ice = IceShelf.from_raster(
        path, None if shelf.mask is None else path, variable=shelf.variable, mask_variable=shelf.mask, date=shelf.date,
        crs=shelf.crs, density=parameters.ice.density, earth_radius=parameters.earth.radius,
    )  # fmt: skip
    iceberg = ice.berg(radius=berg.radius, packing=berg.packing, velocity=berg.velocity)
    turn_rigidly(iceberg.elements, berg.spin, Metric(True, iceberg.earth_radius))
    return iceberg


def _build_field(berg: Berg, field: FieldOfBergs, parameters: Parameters) -> Iceberg:
    from riftberg.bergs.iceberg import Iceberg

    thickness = berg.thickness if "thickness" in berg.model_fields_set else None
    return Iceberg.field(
        field.number, field.area, sizes=field.sizes, seed=field.seed, thickness=thickness, gap=field.gap,
        between=field.between, density=parameters.ice.density, velocity=berg.velocity, latlon=parameters.earth.latlon,
        earth_radius=parameters.earth.radius,
    )  # fmt: skip


def _radius_given(berg: Berg) -> dict[str, float]:
    """Return the radius that a file gives; without one a berg smaller than an element of the default size is one element."""
    return {"radius": berg.radius} if "radius" in berg.model_fields_set else {}


def _build_cloud(berg: Berg, cloud: CloudOfBergs, parameters: Parameters) -> Iceberg:
    from riftberg.bergs.iceberg import Iceberg

    assert berg.placement is not None
    return Iceberg.cloud(
        cloud.number, berg.placement, cloud.radius, length=cloud.length, width=cloud.width, sizes=cloud.sizes,
        between=cloud.between, gap=cloud.gap, overlap=cloud.overlap, seed=cloud.seed, dates=cloud.dates,
        thickness=berg.thickness if "thickness" in berg.model_fields_set else None,
        density=parameters.ice.density, velocity=berg.velocity, latlon=parameters.earth.latlon,
        earth_radius=parameters.earth.radius,
    )  # fmt: skip


def _build_points(berg: Berg, path: Path, parameters: Parameters) -> Iceberg:
    from riftberg.bergs.iceberg import Iceberg
    from riftberg.bergs.outline import read_points

    columns: dict[str, Any] = {"thickness": berg.thickness, **read_points(path)}
    if "length" in columns and "radius" in berg.model_fields_set:
        raise BergError(
            "a radius beside lengths", where=str(path), remedy="Leave berg.radius out, or the column length"
        )
    if "length" not in columns:
        columns["radius"] = berg.radius
    return Iceberg.from_points(
        **columns, packing=berg.packing, density=parameters.ice.density, velocity=berg.velocity,
        latlon=parameters.earth.latlon, earth_radius=parameters.earth.radius,
    )  # fmt: skip


def build_forcing(
    experiment: Experiment, folder: Path, days: float, options: Options, berg: Iceberg, parameters: Parameters
) -> Forcing:
    """Build the forcing of an experiment."""
    forcing = experiment.forcing
    if options.without and not isinstance(forcing, ExperimentForcing):
        raise InputError(
            f"cannot leave out {min(options.without)!r}: forcing of kind {forcing.kind!r} has no named parts",
            where="--without",
            remedy="Change the file instead",
        )
    if options.grid is not None and not isinstance(forcing, FileForcing):
        raise InputError("this forcing needs no grid", where="--grid", remedy="Leave it out")
    if isinstance(forcing, FileForcing):
        from riftberg.ocean.files_forcing import Run, shared_forcing

        if options.grid is not None:
            forcing = forcing.model_copy(update={"spacing": options.grid})
        if options.files:
            forcing = forcing.model_copy(update={"files": list(options.files)})
        positions = berg.elements.place.lon, berg.elements.place.lat
        run = Run.of(
            experiment.start, days, berg.elements.thickness, parameters.ice.density, melts=parameters.melt.enabled,
            place=positions if parameters.earth.latlon else None,
        )  # fmt: skip
        return shared_forcing(forcing, folder, run)
    if isinstance(forcing, FormulaForcing):
        return Sum(forcing.parts)
    if isinstance(forcing, SeriesForcing | OpenDriftForcing):
        return series_forcing(forcing, folder, experiment.start)
    from riftberg.ocean.story import StoryOcean

    find(forcing.experiment).check_parts(options.without)
    without = options.without | set(forcing.without)
    return StoryOcean(shoal="shoal" not in without, shear="shear" not in without, start=experiment.start)


def series_forcing(forcing: SeriesForcing | OpenDriftForcing, folder: Path, start: datetime) -> Series:
    """Return the series of a table, or along a trajectory."""
    options: dict[str, Any] = {
        "sea_level": forcing.sea_level, "wind_layer": forcing.wind_layer, "hold": 3600.0 * forcing.hold, "start": start,
    }  # fmt: skip
    if forcing.wind == "none":
        options |= {"ua": None, "va": None}
    if isinstance(forcing, OpenDriftForcing):
        from riftberg.runs.opendrift import read_trajectory

        return read_trajectory(in_folder(folder, forcing.opendrift), forcing.trajectory).forcing(**options)
    from riftberg.ocean.series import read_series

    gap = None if forcing.max_gap is None else 3600.0 * forcing.max_gap
    return read_series(in_folder(folder, forcing.along), means=forcing.means, max_gap=gap, **options)


def sections() -> Iterator[tuple[str, Mapping[str, FieldInfo]]]:
    """Give the sections of an experiment file with their keys, for the documentation."""
    yield "", Experiment.model_fields
    yield "berg", Berg.model_fields
    for section in nested_sections(Experiment.model_fields["forcing"].annotation):
        (kind,) = get_args(section.model_fields["kind"].annotation)
        yield f"forcing, kind: {kind}", section.model_fields
