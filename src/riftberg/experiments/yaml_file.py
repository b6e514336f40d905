"""Experiments from YAML files: read, checked and explained by line, then built."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from riftberg.bergs.keys import FieldOfBergs
from riftberg.bergs.report import lost_in_lattice
from riftberg.config.values import (
    NORTHERNMOST,
    SOUTHERNMOST,
    UnfitError,
    allowed,
    check_degrees,
    check_kind,
    check_place,
    finding_text,
    given,
    kinds_of,
    plain_value,
)
from riftberg.errors import BergError, InputError, nearest
from riftberg.experiments.changes import changed, fields_of, reference_numerics
from riftberg.experiments.document import Document, Place
from riftberg.experiments.formula_schema import FormulaForcing, sum_of
from riftberg.experiments.options import Info, Options
from riftberg.experiments.registry import find
from riftberg.experiments.schema import (
    PRESETS,
    Berg,
    Experiment,
    ExperimentForcing,
    Rift,
    Shelf,
    Strength,
)
from riftberg.ocean.files_schema import FileForcing
from riftberg.ocean.steady_schema import ConstantForcing
from riftberg.parameters import A68A_2022, A68A_2022_KID, Parameters
from riftberg.system.input_files import value_shown
from riftberg.system.netcdf_lock import closing_files

if TYPE_CHECKING:
    from riftberg.bergs.iceberg import Iceberg
    from riftberg.ocean.forcing import Forcing
    from riftberg.runs.model import Model

_KINDS: dict[str, type[BaseModel]] = {
    "constant": ConstantForcing, "files": FileForcing, "analytic": ExperimentForcing, "formula": FormulaForcing,
}  # fmt: skip


def _name_of(path: str | Path) -> str:
    """Return the name of an experiment that gives itself none: that of its file, in letters that a folder may have."""
    plain = re.sub(r"[^\w.-]+", "-", Path(path).stem)
    return re.sub(r"^[^A-Za-z0-9]+", "", plain) or "experiment"


def read_file(path: Path) -> tuple[Experiment, Parameters, Document]:
    """Read and check an experiment file."""
    document = Document(Path(path), _keys(Experiment))
    values = dict(document.values)
    values.setdefault("name", _name_of(path))
    values = _prepared(values, Experiment, (), document)
    groups = values.get("parameters")
    changes = _changes(groups if isinstance(groups, dict) else {}, document)
    try:
        experiment = Experiment(**values)
    except ValidationError as error:
        _explain(error, document)
        document.settle()
        raise
    with document.noting(("days",)):
        check_span(experiment.start, experiment.days, where=document.where(("days",)))
    for place, berg in experiment.all_bergs if _in_degrees(changes) else []:
        name: Place = tuple(int(p) if p.isdigit() else p for p in place.split("."))
        with document.noting(name):
            _check_place(berg, document, name)
    document.settle()
    parameters = _parameters(experiment, changes, document)
    if parameters.earth.latlon and parameters.earth.radius < SMALLEST_SPHERE:
        raise document.error(
            f"{parameters.earth.radius:g} m is no radius of the Earth", ("parameters", "earth", "radius"),
            f"Give {SMALLEST_SPHERE:g} m or more, usually 6.371e6",
        )  # fmt: skip
    return experiment, parameters, document


def _in_degrees(changes: Mapping[str, Any]) -> bool:
    """Whether positions are degrees; all presets have them so."""
    return changes.get("earth", {}).get("latlon", True) is not False


SMALLEST_SPHERE = 1e6
"""Radius (m) of the sphere below which it is a slip of units."""

FIRST_YEAR, LAST_YEAR = 1700, 2250
"""Years in which run files can tell dates to the nanosecond, as xarray keeps them."""


def check_span(start: datetime, days: float, *, where: str) -> None:
    """Refuse a run whose dates no run file can hold."""
    good = FIRST_YEAR <= start.year <= LAST_YEAR and days <= 366.0 * (LAST_YEAR - start.year + 1)
    if not good:
        raise InputError(
            f"a run of {days:g} days from {start:%d.%m.}{start.year:04d}", where=where,
            remedy=f"Runs lie in the years {FIRST_YEAR} to {LAST_YEAR}",
        )  # fmt: skip


def _check_place(berg: Berg, document: Document, where: Place) -> None:
    """Refuse a place that is none on Earth, or on a pole, where only swapped coordinates put a berg."""
    for name, place in (("placement", berg.placement), ("shift", berg.shift)):
        if place is not None:
            check_degrees(place, where=document.where((*where, name)))
    if berg.placement is not None:
        final = berg.placement[0], berg.placement[1] + berg.shift[1]
        check_place(final, where=document.where((*where, "placement")), south=SOUTHERNMOST, north=NORTHERNMOST)


def _keys(section: type[BaseModel]) -> str:
    return ", ".join(section.model_fields)


def _prepared(values: Any, section: type[BaseModel], place: Place, document: Document) -> dict[str, Any]:
    """Check the keys of a section and of those within, and turn quantities into numbers."""
    if isinstance(values, str) and "file" in section.model_fields and values not in section.model_fields:
        values = {"file": values}  # outline: berg.geojson
    if not isinstance(values, dict):
        raise document.error(f"{value_shown(values)} is not a section", place, f"It has the keys {_keys(section)}")
    result: dict[str, Any] = {}
    choices = list(section.model_fields)
    for name, value in values.items():
        inner = (*place, str(name))
        with document.noting(inner):
            if str(name) not in choices:
                hint = nearest(str(name), choices)
                document.meant |= {(*place, choice) for choice in choices if repr(choice) in hint}
                raise document.error("there is no such key", inner, f"{hint}Allowed here: {', '.join(choices)}")
            result[str(name)] = _value(value, section.model_fields[str(name)], inner, document)
    return result


def _value(value: Any, field: FieldInfo, place: Place, document: Document) -> Any:
    items = _sections_in(field)
    if get_origin(field.annotation) is list and isinstance(value, dict | str) and (
        items is not None or get_args(field.annotation) == (str,)
    ):  # fmt: skip
        document.one_of_list(place)
        value = [value]
    if items is not None:
        only = get_args(field.annotation) == (items,)
        if only and not isinstance(value, list):
            raise document.error(
                f"{value_shown(value)} is no section and no list of sections",
                place,
                f"Each has the keys {_keys(items)}",
            )
        if isinstance(value, list):
            prepared = [only or isinstance(item, dict) for item in value]
            return [
                _prepared(item, items, (*place, k), document) if prepared[k] else item for k, item in enumerate(value)
            ]
    inner = _section_of(value, field, place, document)
    if inner is not None:
        return _prepared(value, inner, place, document)
    _check_kind(value, field, place, document)
    try:
        return (
            value if str in kinds_of(field.annotation) and not _is_quantity(value, field) else plain_value(value, field)
        )
    except ValueError as error:
        raise document.error(str(error), place, allowed(field)) from error


def _check_kind(value: Any, field: FieldInfo, place: Place, document: Document) -> None:
    """Refuse what would silently pass for something else."""
    try:
        check_kind(value, field)
    except UnfitError as error:
        raise document.error(error.what, place, error.remedy) from error


def _is_quantity(value: Any, field: FieldInfo) -> bool:
    """Whether a text in a field for numbers or file names begins like a number."""
    from riftberg.config.units import looks_like_quantity

    return isinstance(value, str) and float in kinds_of(field.annotation) and looks_like_quantity(value)


def _sections_in(field: FieldInfo) -> type[BaseModel] | None:
    """Return the section that items of a list may be."""
    items = [item for kind in kinds_of(field.annotation) if get_origin(kind) is list for item in get_args(kind)]
    kinds = [kind for item in items for kind in kinds_of(item)]
    return next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)


def _section_of(value: Any, field: FieldInfo, place: Place, document: Document) -> type[BaseModel] | None:
    """Return the section that a field holds; the kind of forcing decides among several."""
    sections = [kind for kind in kinds_of(field.annotation) if isinstance(kind, type) and issubclass(kind, BaseModel)]
    if len(sections) < 2 or value is None:
        return sections[0] if sections and value is not None else None
    kind = value.get("kind") if isinstance(value, dict) else None
    if not isinstance(kind, str) or kind not in _KINDS:
        raise document.error(
            f"kind = {value_shown(kind)} is not known" if kind else "the kind of forcing is missing",
            (*place, "kind"),
            f"{nearest(str(kind), _KINDS)}Use kind: {', '.join(_KINDS)}",
        )
    return _KINDS[kind]


def _explain(error: ValidationError, document: Document) -> None:
    """Note the findings of pydantic with their places, but for those that follow from what is noted already."""
    # Of an entry that is a text or a section, what is wrong with the section says more: it lies deeper, or is a sentence of ours.
    for finding in sorted(error.errors(), key=lambda finding: (-len(finding["loc"]), finding["type"] != "value_error")):
        loc = tuple(finding["loc"])
        loc = (*loc[:1], *loc[2:]) if loc[:1] == ("forcing",) and loc[1:2] and loc[1] in _KINDS else loc
        place = tuple(part for part in loc if part not in ("float", "int", "str") and "NamedFiles" not in str(part))
        field = _field_at(place)
        remedy = "" if field is None or finding["type"] == "value_error" else allowed(field)
        if not document.noted(place):
            document.note(place, document.error(finding_text(finding), place, remedy))


def _field_at(place: Place) -> FieldInfo | None:
    """Return the field of the schema at a place."""
    section: type[BaseModel] = Experiment
    names = [part for part in place if isinstance(part, str)]  # without the numbers of what stands in lists
    for depth, part in enumerate(names):
        choices = _KINDS.values() if names[:depth] == ["forcing"] else (section,)
        field = next((c.model_fields[part] for c in choices if part in c.model_fields), None)
        if field is None or depth == len(names) - 1:
            return field
        inner = [k for k in kinds_of(field.annotation) if isinstance(k, type) and issubclass(k, BaseModel)]
        items = _sections_in(field)
        if not inner and items is None:
            return field
        section = items or inner[0]
    return None


def _changes(groups: Mapping[Any, Any], document: Document) -> dict[str, Any]:
    """Return the changes of the parameters by group, each value checked."""
    changes: dict[str, Any] = {}
    for group, values in groups.items():
        place = ("parameters", str(group))
        with document.noting(place):
            if group != "preset":
                changes[str(group)] = _group(str(group), values, document)
            elif not isinstance(values, str) or values not in PRESETS:
                raise document.error(f"preset {value_shown(values)} is not known", place,
                                     f"{nearest(str(values), PRESETS)}Use {', '.join(PRESETS)}")  # fmt: skip
    return changes


def _parameters(experiment: Experiment, changes: dict[str, Any], document: Document) -> Parameters:
    """Return the preset with the changes of the file; packing follows the berg."""
    base = {"a68a-2022": A68A_2022, "a68a-2022-reference": A68A_2022_KID, "default": Parameters()}[
        experiment.parameters.get("preset", "default")
    ]
    packing = "hexagonal" if any(berg.packing == "hexagonal" for _, berg in experiment.all_bergs) else "square"
    shape: dict[str, Any] = {"packing": packing, "max_bonds": 6 if packing == "hexagonal" else 4}
    changes["bonds"] = {**shape, **changes.get("bonds", {})}
    if "substeps" not in changes.get("stepping", {}):
        changes["stepping"] = {"substeps": None, **changes.get("stepping", {})}
    try:
        return changed(base, changes, where=document.where(("parameters",)))
    except InputError as error:
        cause = error.__cause__
        if isinstance(cause, InputError) and cause.where:
            place = ("parameters", *cause.where.split("."))
            raise document.error(cause.what, place, cause.remedy) from cause
        raise


def _group(group: str, values: Any, document: Document) -> dict[str, Any]:
    groups = Parameters.model_fields
    place = ("parameters", group)
    if group not in groups:
        raise document.error("there is no such group of parameters", place,
                             f"{nearest(group, groups)}Groups are {', '.join(groups)}, and preset")  # fmt: skip
    if not isinstance(values, dict):
        raise document.error(f"{value_shown(values)} is not a group of parameters", place)
    fields, result = fields_of(groups[group]), {}
    section: Any = groups[group].annotation
    for name, value in values.items():
        inner = (*place, str(name))
        with document.noting(inner):
            if name not in fields:
                raise document.error("there is no such parameter", inner,
                                     f"{nearest(str(name), fields)}{group} has {', '.join(fields)}")  # fmt: skip
            plain = _value(value, fields[name], inner, document)
            is_section = _section_of(value, fields[name], inner, document) is not None
            result[str(name)] = plain if is_section else given(plain, section, name, where=document.where(inner))
    return result


@closing_files(only_if_refused=True)
def build_file(path: Path, options: Options) -> tuple[Model, Info]:
    """Build the experiment of a YAML file."""
    from riftberg.runs.model import Model

    experiment, parameters, _ = read_file(path)
    if options.numerics == "reference":
        parameters = reference_numerics(parameters)
    parameters = options.apply(parameters)
    folder = options.data or Path(path).parent
    berg = build_berg(experiment, parameters, folder)
    days = options.days or experiment.days
    check_span(experiment.start, days, where="--days" if options.days else str(path))
    forcing = build_forcing(experiment, folder, days, options, berg, parameters)
    notices = tuple(getattr(forcing, "notices", ()))
    info = Info(
        experiment.name,
        experiment.title,
        days,
        experiment.output_every_hours,
        notices=notices,
        output_forces=experiment.output_forces,
        output_cells=experiment.output_cells,
        made=lost_in_lattice(berg),
    )
    return Model(berg, forcing, parameters, experiment.start), info


def build_berg(experiment: Experiment, parameters: Parameters, folder: Path) -> Iceberg:
    """Build the berg or bergs of an experiment, with their rifts and the strengths of their bonds."""
    from riftberg.bergs.iceberg import Iceberg

    built = [_one_berg(place, berg, parameters, folder) for place, berg in experiment.all_bergs]
    if experiment.berg is not None:
        return built[0]
    with _key_named("bergs"):
        return Iceberg.join(built)


def _one_berg(place: str, berg: Berg, parameters: Parameters, folder: Path) -> Iceberg:
    """Build one berg of an experiment; ``place`` is the name of its section."""
    if berg.field is not None:
        with _key_named(f"{place}.field"):
            return _field_of_bergs(berg, berg.field, parameters)
    made = _whole_berg(berg, parameters, folder)
    for index, rift in enumerate(berg.rifts):
        with _key_named(f"{place}.rifts.{index}"):
            made = _with_rift(made, rift, folder)
    if berg.strength is not None:
        with _key_named(f"{place}.strength"):
            made = _with_strength(made, berg.strength, folder)
    return made if berg.name is None else made.named(berg.name)


@contextmanager
def _key_named(key: str) -> Iterator[None]:
    """Name the key of the file in errors about what it holds."""
    try:
        yield
    except BergError as error:
        where = f"{key}, {error.where}" if error.where else key
        raise BergError(error.what, where=where, remedy=error.remedy) from error


def _with_rift(berg: Iceberg, rift: Rift, folder: Path) -> Iceberg:
    from riftberg.bergs.raster import is_map, read_raster

    source: Any = rift.points
    if rift.file is not None:
        path = folder / rift.file
        source = read_raster(path, rift.variable) if is_map(path) else path
    return berg.with_rifts(source, strength=rift.strength, broken=rift.broken, crs=rift.crs, threshold=rift.threshold)


def _with_strength(berg: Iceberg, strength: Strength, folder: Path) -> Iceberg:
    from riftberg.bergs.raster import read_raster

    if strength.file is not None:
        return berg.with_strength(read_raster(folder / strength.file, strength.variable))
    if strength.weibull is not None:
        return berg.with_strength("weibull", shape=strength.weibull, seed=strength.seed)
    if strength.normal is not None:
        return berg.with_strength("normal", spread=strength.normal, seed=strength.seed)
    return berg.with_strength("uniform", spread=strength.uniform, seed=strength.seed)


def _whole_berg(berg: Berg, parameters: Parameters, folder: Path) -> Iceberg:
    from riftberg.bergs.iceberg import Iceberg

    thickness = berg.thickness if isinstance(berg.thickness, float) else folder / berg.thickness
    common: dict[str, Any] = {
        "thickness": thickness, "radius": berg.radius, "packing": berg.packing, "density": parameters.ice.density,
        "velocity": berg.velocity, "spin": berg.spin, "rotation": berg.rotation,
        "earth_radius": parameters.earth.radius,
    }  # fmt: skip
    if berg.outline is not None:
        outline = berg.outline
        return Iceberg.from_outline(
            folder / outline.file, feature=outline.feature, date=outline.date, crs=outline.crs, repair=outline.repair,
            placement=berg.placement, shift=berg.shift, **common,
        )  # fmt: skip
    if berg.mask is not None:
        mask = berg.mask
        return Iceberg.from_mask(
            folder / mask.file, variable=mask.variable, threshold=mask.threshold, date=mask.date,
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
    from riftberg.coupling.shelf import IceShelf

    path = folder / shelf.file
    ice = IceShelf.from_raster(
        path, None if shelf.mask is None else path, variable=shelf.variable, mask_variable=shelf.mask, date=shelf.date,
        crs=shelf.crs, density=parameters.ice.density, earth_radius=parameters.earth.radius,
    )  # fmt: skip
    made = ice.berg(radius=berg.radius, packing=berg.packing, velocity=berg.velocity)
    made.elements.motion.spin[:] = berg.spin
    return made


def _field_of_bergs(berg: Berg, field: FieldOfBergs, parameters: Parameters) -> Iceberg:
    from riftberg.bergs.iceberg import Iceberg

    thickness = berg.thickness if "thickness" in berg.model_fields_set else None
    if isinstance(thickness, str):
        raise BergError("a field of bergs takes no map of thickness", where="berg.thickness", remedy="Give metres")
    return Iceberg.field(
        field.number, field.area, sizes=field.sizes, seed=field.seed, thickness=thickness, gap=field.gap,
        between=field.between, density=parameters.ice.density, velocity=berg.velocity, latlon=parameters.earth.latlon,
        earth_radius=parameters.earth.radius,
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
    if isinstance(forcing, ConstantForcing):
        from riftberg.ocean.analytic import Steady

        return Steady(forcing.current, forcing.wind, forcing.slope, forcing.sea_ice, forcing.depth)
    if isinstance(forcing, FileForcing):
        from riftberg.ocean.files_forcing import Run, forcing_from_files

        if options.grid is not None:
            forcing = forcing.model_copy(update={"spacing": options.grid})
        if options.files:
            forcing = forcing.model_copy(update={"files": list(options.files)})
        run = Run.of(
            experiment.start, days, berg.elements.thickness, parameters.ice.density, melts=parameters.melt.enabled
        )
        return forcing_from_files(forcing, folder, run)
    if isinstance(forcing, FormulaForcing):
        earth = parameters.earth
        plane = earth.f_plane or not earth.latlon
        return sum_of(forcing, latlon=earth.latlon, latitude=earth.reference_latitude if plane else None)
    if options.grid is not None:
        raise InputError("this forcing needs no grid", where="--grid", remedy="Leave it out")
    without = frozenset(forcing.without) | options.without
    model, _ = find(forcing.name).load()(Options(without=without, data=options.data))
    return model.forcing


def sections() -> Iterator[tuple[str, Mapping[str, FieldInfo]]]:
    """Give the sections of an experiment file with their keys, for the documentation."""
    yield "", Experiment.model_fields
    yield "berg", Berg.model_fields
    for kind, section in _KINDS.items():
        yield f"forcing, kind: {kind}", section.model_fields
