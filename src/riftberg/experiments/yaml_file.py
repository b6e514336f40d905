"""Experiments from YAML files: read, checked and explained by line, then built."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from riftberg.bergs.bonded import lost_in_lattice
from riftberg.bergs.keys import FieldOfBergs
from riftberg.config.values import Place, findings, sections_in
from riftberg.errors import BergError, InputError, nearest
from riftberg.experiments.changes import changed_document, reference_numerics
from riftberg.experiments.document import Document
from riftberg.experiments.registry import Info, Options, find
from riftberg.experiments.schema import (
    PRESETS,
    Berg,
    Experiment,
    ExperimentForcing,
    FormulaForcing,
    Shelf,
    Strength,
    check_span,
)
from riftberg.ocean.analytic import ConstantForcing
from riftberg.ocean.files_schema import FileForcing
from riftberg.ocean.formulas import Sum
from riftberg.parameters import Earth, Parameters
from riftberg.system.input_files import value_shown
from riftberg.system.netcdf_lock import closing_files

if TYPE_CHECKING:
    from riftberg.bergs.iceberg import Iceberg
    from riftberg.ocean.forcing import Forcing
    from riftberg.runs.model import Model


def _name_of(path: str | Path) -> str:
    """Return the name of an experiment that gives itself none: that of its file, in letters that a folder may have."""
    plain = re.sub(r"[^\w.-]+", "-", Path(path).stem)
    return re.sub(r"^[^A-Za-z0-9]+", "", plain) or "experiment"


SMALLEST_SPHERE = 1e6
"""Radius (m) of the sphere below which it is a slip of units."""


def read_file(
    path: Path, changes: Mapping[str, Mapping[str, Any]] | None = None
) -> tuple[Experiment, Parameters, Document]:
    """Read and check an experiment file; all that is wrong with it is reported at once.

    ``changes``: keys of its sections that are to be other ones, by section and path in it; parameters are left alone.
    """
    document = Document(Path(path), ", ".join(Experiment.model_fields))
    values = changed_document({"name": _name_of(path), **document.values}, changes or {})
    faults: list[tuple[Place, InputError]] = []
    parameters, experiment = Parameters(), None
    try:
        parameters = _parameters(values.get("parameters"))
    except InputError as error:
        faults += [(("parameters", *_place_of(fault.where)), fault) for fault in error.faults]
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
    return experiment, _packed(parameters, experiment), document


def _parameters(groups: Any) -> Parameters:
    """Return the preset of a file with its changes."""
    groups = {str(name): values for name, values in groups.items()} if isinstance(groups, dict) else {}
    preset = groups.pop("preset", "default")
    if not isinstance(preset, str) or preset not in PRESETS:
        raise InputError(
            f"preset {value_shown(preset)} is not known", where="preset",
            remedy=f"{nearest(str(preset), PRESETS)}Use {', '.join(PRESETS)}",
        )  # fmt: skip
    stepping = groups.get("stepping", {})
    if isinstance(stepping, dict):  # the number of sub-steps of a preset belongs to its lattice
        groups["stepping"] = {"substeps": None, **stepping}
    return PRESETS[preset].changed(**groups)


def _packed(parameters: Parameters, experiment: Experiment) -> Parameters:
    """Return the parameters with the packing of the bergs, but for what the file says itself."""
    hexagonal = any(berg.packing == "hexagonal" for _, berg in experiment.all_bergs)
    shape: dict[str, Any] = (
        {"packing": "hexagonal", "max_bonds": 6} if hexagonal else {"packing": "square", "max_bonds": 4}
    )
    return parameters.changed(bonds={**shape, **experiment.parameters.get("bonds", {})})


def _coordinates(earth: Earth) -> dict[str, Any]:
    """Return what the sections of a file take from the parameters: whether places are metres, and the latitude of a plane."""
    plane = earth.f_plane or not earth.latlon
    latitude = earth.reference_latitude if plane else None
    return {"metres": not earth.latlon, "coordinates": {"latlon": earth.latlon, "latitude": latitude}}


def _place_of(where: str) -> Place:
    return tuple(int(part) if part.isdigit() else part for part in where.split(".")) if where else ()


@closing_files(only_if_refused=True)
def build_file(path: Path, options: Options) -> tuple[Model, Info]:
    """Build the experiment of a YAML file."""
    from riftberg.runs.model import Model

    experiment, parameters, _ = read_file(path, options.changes)
    if options.numerics == "reference":
        parameters = reference_numerics(parameters)
    parameters = options.apply(parameters)
    folder = options.data or Path(path).parent
    berg = build_berg(experiment, parameters, folder)
    days = options.days or experiment.days
    check_span(experiment.start, days, where="--days" if options.days else str(path))
    forcing = build_forcing(experiment, folder, days, options, berg, parameters)
    notices = tuple(getattr(forcing, "notices", ()))
    made, loses = lost_in_lattice(berg)
    info = Info(
        experiment.name,
        experiment.title,
        days,
        experiment.output_every_hours,
        notices=notices,
        output_forces=experiment.output_forces,
        output_cells=experiment.output_cells,
        made=made,
        loses=loses,
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
            from riftberg.bergs.raster import is_map, read_raster

            source: Any = rift.points
            if rift.file is not None:
                path = folder / rift.file
                source = read_raster(path, rift.variable) if is_map(path) else path
            made = made.with_rifts(
                source, strength=rift.strength, broken=rift.broken, crs=rift.crs, threshold=rift.threshold
            )
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
        "earth_radius": parameters.earth.radius, "lattice_angle": berg.lattice_angle, "offset": berg.offset,
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
        from riftberg.ocean.files_forcing import Run, shared_forcing

        if options.grid is not None:
            forcing = forcing.model_copy(update={"spacing": options.grid})
        if options.files:
            forcing = forcing.model_copy(update={"files": list(options.files)})
        place = berg.elements.place.lon, berg.elements.place.lat
        run = Run.of(
            experiment.start, days, berg.elements.thickness, parameters.ice.density, melts=parameters.melt.enabled,
            place=place if parameters.earth.latlon else None,
        )  # fmt: skip
        return shared_forcing(forcing, folder, run)
    if isinstance(forcing, FormulaForcing):
        return Sum(forcing.parts)
    if options.grid is not None:
        raise InputError("this forcing needs no grid", where="--grid", remedy="Leave it out")
    without = frozenset(forcing.without) | options.without
    model, _ = find(forcing.name).load()(Options(without=without, data=options.data))
    return model.forcing


def sections() -> Iterator[tuple[str, Mapping[str, FieldInfo]]]:
    """Give the sections of an experiment file with their keys, for the documentation."""
    yield "", Experiment.model_fields
    yield "berg", Berg.model_fields
    for section in sections_in(Experiment.model_fields["forcing"].annotation):
        (kind,) = get_args(section.model_fields["kind"].annotation)
        yield f"forcing, kind: {kind}", section.model_fields
