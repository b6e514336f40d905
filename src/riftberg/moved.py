"""Where things stood before: old module paths and names keep working, with a warning that tells the new one.

`OldPaths` comes first among Python's finders: an old package has the folder of the new one, and its modules would be
loaded a second time from there. The old path gives the new module itself, not a copy: classes
and constants are the same objects under both paths.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any, Final

MODULES: Final = {
    "diagnostics.fragments": "stepping.fragments",
    "diagnostics.track": "runs.track",
    "experiments.files_forcing": "ocean.files_forcing",
    "io": "runs",
    "io.background": "runs.background",
    "io.kid": "kid",
    "io.provenance": "runs.provenance",
    "io.restart": "runs.restart",
    "io.run_file": "runs.run_file",
    "ocean.direct": "fetching.direct",
    "ocean.doctor": "products.doctor",
    "ocean.download": "fetching.download",
    "ocean.fetch": "fetching.fetch",
    "ocean.findings": "products.findings",
    "ocean.logins": "fetching.logins",
    "ocean.on_path": "products.on_path",
    "ocean.parts": "fetching.parts",
    "ocean.products": "products",
    "ocean.services": "fetching.services",
    "stepping.neighbours": "state.neighbours",
    "viz.plane": "plane",
    "viz.scene": "runs.scene",
    "viz.shapes": "runs.shapes",
}
"""Old module to new one, below ``riftberg``; what stood in an old package stands in the new one under the same name."""

NAMES: Final = {
    "bergs.bonding.separation": "bergs.bonding.separations",
    "bergs.assembly.radius_of": "bergs.assembly.inscribed_radius",
    "bergs.iceberg.Body": "bergs.options.Material",
    "bergs.placement.Plane": "bergs.placement.FillingPlane",
    "bergs.placement.TangentPlane": "plane.EqualAreaPlane",
    "bergs.regions.Ice": "bergs.regions.IceMask",
    "cli.pictures.beside": "cli.pictures.picture_path",
    "cli.run.COMPILE_TIME": "cli.compilation.COMPILE_TIME",
    "diagnostics.compare.Day": "diagnostics.compare.RunDay",
    "diagnostics.compare.Told": "diagnostics.compare.ComparedRun",
    "diagnostics.compare.dated": "diagnostics.compare.with_hours",
    "diagnostics.compare.read_told": "diagnostics.compare.read_compared",
    "diagnostics.observed.Observed": "diagnostics.observed.Observations",
    "diagnostics.overlap.overlap": "diagnostics.overlap.intersection_over_union",
    "diagnostics.score.Day": "diagnostics.score.ScoredDay",
    "experiments.Builder": "experiments.options.Builder",
    "cli.progress.ProgressRecorder": "runs.progress.ProgressRecorder",
    "experiments.changes.kinds_of": "values.kinds_of",
    "experiments.changes.unit_of": "values.unit_of",
    "experiments.Entry": "experiments.registry.BuiltIn",
    "experiments.a68a_observed.Observed": "experiments.a68a_observed.ObservedDay",
    "model.Model": "runs.model.Model",
    "experiments.schema.NamedFiles": "ocean.files_schema.NamedFiles",
    "experiments.schema.Outline": "experiments.schema.OutlineFile",
    "fetching.download.opened": "fetching.download.opened_part",
    "fetching.parts.Part": "fetching.parts.PartFile",
    "kid.a68.data_folder": "kid.a68.case_data",
    "kid.driver.build_forcing": "kid.driver.driver_forcing",
    "kid.ncfile.opened": "kid.ncfile.opened_dataset",
    "kid.ncfile.unpack": "kid.ncfile.true_values",
    "ocean.files_forcing.PARTNER": "ocean.datasets.VECTORS",
    "parameter_groups.Bonds": "parameter_groups.BondParameters",
    "physics.drag.draft_of": "physics.floating.draft_of",
    "parameters.Bonds": "parameters.BondParameters",
    "plane.Plane": "plane.ConformalPlane",
    "runs.background.bilinear": "runs.background.on_even_grid",
    "stepping.schemes.without": "stepping.partners.without",
    "viz.panels.NO_WATER": "viz.colours.NO_WATER",
    "viz.panels.damage_map": "viz.colours.damage_map",
    "viz.panels.day_text": "viz.moments.day_text",
    "viz.panels.stress_map": "viz.colours.stress_map",
    "viz.plots.OBSERVED_COLOURS": "viz.colours.OBSERVED_DAYS",
    "viz.style.FRAGMENT_COLOURS": "viz.colours.FRAGMENTS",
    "viz.style.GROUND_COLOUR": "viz.colours.GROUND",
    "viz.style.SMALL_COLOUR": "viz.colours.SMALL",
    "viz.style.speed_map": "viz.colours.speed_map",
    "coupling.exchange.Balance": "coupling.exchange.ExchangeBalance",
    "physics.basal_melt.Exchange": "physics.basal_melt.ExchangeValues",
    "stepping.contacts.Contact": "stepping.contacts.Meeting",
    "stepping.lattice_equilibrium.Lattice": "stepping.lattice_equilibrium.ElasticLattice",
    "stepping.meetings.ACTS": "stepping.meeting_contacts.ACTS",
    "stepping.meetings.CONTACT_PHASE": "stepping.meeting_contacts.CONTACT_PHASE",
    "stepping.meetings.ENTRY": "stepping.meeting_contacts.ENTRY",
    "stepping.meetings.FRESH": "stepping.meeting_substeps.FRESH",
    "stepping.meetings.GENTLE": "stepping.meeting_contacts.GENTLE",
    "stepping.meetings.MOST_SWEEPS": "stepping.meeting_contacts.MOST_SWEEPS",
    "stepping.meetings.Room": "stepping.meeting_contacts.MeetingRoom",
    "stepping.meetings.SETTLED": "stepping.meeting_contacts.SETTLED",
    "stepping.quasi_static.Moment": "stepping.quasi_static.Standing",
    "ocean.at_elements.Moment": "ocean.at_elements.Blend",
    "stepping.rigid_bodies.Motion": "stepping.rigid_bodies.BodyMotion",
    "coupling.names.Quantity": "coupling.names.Exchanged",
    "ocean.analytic.Seamount": "ocean.analytic.SeamountFlow",
    "coupling.shares.axes": "coupling.shares.element_axes",
    "bergs.report.axes": "bergs.report.principal_axes",
    "ocean.formulas.begin": "ocean.formulas.clear_environment",
    "ocean.formulas.finish": "ocean.formulas.fill_open_depth",
    "diagnostics.summary.bergs": "diagnostics.summary.berg_entries",
    "products.window.cover": "products.window.extent_text",
    "stepping.frames.gathered": "stepping.frames.free_bodies",
    "stepping.frames.moved": "stepping.frames.moved_frames",
    "products.vectors.moved": "products.vectors.on_points_of",
    "viz.plots.heading": "viz.plots.figure_title",
    "bergs.raster.joined": "bergs.raster.unbroken",
    "runs.scene.joined": "runs.scene.on_one_branch",
    "limits.number": "limits.number_text",
    "bergs.assembly.numbers": "bergs.assembly.one_each",
    "stepping.rigid_bodies.keep_applied": "stepping.rigid_bodies.keep_forces",
    "runs.checks.start_of": "runs.checks.stated_start",
    "kid.parameters.zonal_period": "kid.parameters.namelist_period",
}
"""Old name to new one, below ``riftberg``, where a module stayed and a name in it did not."""

GONE_MODULES: Final = {
    "experiments.files_fields": "riftberg.ocean.product_records reads fields, riftberg.ocean.mesh places elements in them",
    "experiments.files_levels": "riftberg.ocean.product_records reads levels",
    "ocean.over_draft": "riftberg.ocean.at_elements.mean_to_draft takes the mean over the draft at the element",
    "ocean.own_grids": "riftberg.ocean.datasets.DatasetForcing keeps each product on its own points",
    "stepping.surroundings": "riftberg.stepping.media holds one row for each medium",
}
"""Modules below ``riftberg`` that nothing replaces one for one, and what does their work now."""

GONE_NAMES: Final = {
    "cli.main.COMMANDS": "use riftberg.cli.main.function_of for the function of a command by its name",
    "stepping.velocity.lone_elements": "use riftberg.stepping.velocity.find_lone, which fills an array",
    "diagnostics.overlap.shapely_module": "shapely belongs to the package: import shapely",
    "kid.checks.check_bits": "bergy bits melt now: see riftberg.state.Life",
    "kid.checks.check_rolling": "bergs roll now: see riftberg.physics.rolling",
    "kid.checks.tips_over": "bergs roll now: see riftberg.physics.rolling",
    "kid.entry_table.FOOTLOOSE": "footloose calving runs now",
    "kid.entry_table.MELT": "melt laws run now",
    "kid.restart.Origin": "what it held belongs to the state: see riftberg.state.Life",
    "physics.bonds.advance_shear": "use riftberg.physics.bonds.advance_slip, for the length along the tangent",
    "physics.bonds.contact_velocity": "use riftberg.physics.bonds.along_and_across and slip_speed",
    "products.axes.name_axes": "riftberg.products.place.positioned puts each field on its own axes",
    "runs.track.from_plane": "use the method inverse of riftberg.plane.OrthographicPlane",
    "runs.track.to_plane": "use the method forward of riftberg.plane.OrthographicPlane",
    "stepping.long_kick.sea_floor_rates": "see riftberg.stepping.long_kick.begin_substeps",
    "stepping.multiple.advance": "use riftberg.stepping.multiple.take_long_step, which takes other arguments",
}
"""Names of which only the work is left, done by something that is called in another way."""

PACKAGE: Final = "riftberg."

HOMES: Final = frozenset(PACKAGE + name.rpartition(".")[0] for name in (*NAMES, *GONE_NAMES))
"""Modules in which a name has changed."""


def new_path(path: str) -> str | None:
    """Return the path that a module has now, or None where it never had another."""
    inner = path.removeprefix(PACKAGE)
    if inner == path:
        return None
    if inner in MODULES:
        return PACKAGE + MODULES[inner]
    folder, _, name = inner.rpartition(".")
    return f"{PACKAGE}{MODULES[folder]}.{name}" if folder in MODULES else None


class OldPaths:
    """Finds modules by the paths that they had.

    A finder and a loader of `importlib.abc` by its methods; that module itself takes longer to load than the rest of this one.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a module is, or None where no module was ever called so."""
        if fullname in HOMES:
            return _with_old_names(PathFinder.find_spec(fullname, path, target))
        gone = GONE_MODULES.get(fullname.removeprefix(PACKAGE))
        if gone is not None:
            raise ModuleNotFoundError(f"{fullname} is gone: {gone}", name=fullname)
        new = new_path(fullname)
        if new is None or importlib.util.find_spec(new) is None:
            return None
        return ModuleSpec(fullname, self, is_package=True)  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Leave it to Python to make the module that `exec_module` replaces."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Put the module of today in the place of the old one."""
        new = new_path(module.__name__)
        assert new is not None
        warnings.warn(f"{module.__name__} is now {new}", DeprecationWarning, stacklevel=2)
        sys.modules[module.__name__] = importlib.import_module(new)


def _with_old_names(spec: ModuleSpec | None) -> ModuleSpec | None:
    """Let a module answer to the names that it had, once it is loaded."""
    if spec is None or spec.loader is None:
        return spec
    name, load = spec.name, spec.loader.exec_module

    def exec_module(module: ModuleType) -> None:
        load(module)
        setattr(module, "__getattr__", old_names(name))  # noqa: B010

    setattr(spec.loader, "exec_module", exec_module)  # noqa: B010
    return spec


def install() -> None:
    """Let Python ask for old paths first."""
    if not any(isinstance(finder, OldPaths) for finder in sys.meta_path):
        sys.meta_path.insert(0, OldPaths())


def old_names(module: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module in which names have changed."""

    def __getattr__(name: str) -> Any:  # noqa: N807
        path = f"{module.removeprefix(PACKAGE)}.{name}"
        new = NAMES.get(path)
        if path in GONE_NAMES:  # Python's own error of a failed import would not say more than that it is not there
            warnings.warn(f"{module}.{name} is gone: {GONE_NAMES[path]}", DeprecationWarning, stacklevel=2)
        if new is None:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, _, today = new.rpartition(".")
        warnings.warn(f"{module}.{name} is now {PACKAGE}{new}", DeprecationWarning, stacklevel=2)
        return getattr(importlib.import_module(PACKAGE + home), today)

    return __getattr__
