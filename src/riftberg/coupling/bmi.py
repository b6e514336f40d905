"""The exchange behind the Basic Model Interface 2.0 (bmipy; Hutton et al. 2020), for frameworks that couple models by it.

Needs the extra ``bmi``. Fields lie in the middle of the cells of a regular grid of longitude and latitude.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from bmipy import Bmi
from numpy.typing import NDArray

from riftberg.bergs.iceberg import Iceberg
from riftberg.config.values import key, number
from riftberg.coupling.exchange import Exchange
from riftberg.coupling.fields import GIVEN, TAKEN, OceanForcing, taken
from riftberg.coupling.sections import Box, read_section
from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.runs.model import Model
from riftberg.system.input_files import MOST_YAML, check_file, reading

SECTIONS: Final = ("grid", "berg", "parameters", "ocean", "days")
"""What a configuration file may hold."""


class Basin(Box):
    """Section ``grid``: cells, and the depth of their water."""

    depth: float = key(4000.0, "m", "depth of the sea floor", gt=0)


NAMES: Final = {
    "sea_surface_water_flow__x_component_of_velocity": "eastward_sea_water_velocity",
    "sea_surface_water_flow__y_component_of_velocity": "northward_sea_water_velocity",
    "sea_ice_flow__x_component_of_velocity": "eastward_sea_ice_velocity",
    "sea_ice_flow__y_component_of_velocity": "northward_sea_ice_velocity",
    "sea_surface_air_flow__x_component_of_velocity": "eastward_wind",
    "sea_surface_air_flow__y_component_of_velocity": "northward_wind",
    "sea_surface__elevation": "sea_surface_height_above_geoid",
    "sea_surface_water__temperature": "sea_surface_temperature",
    "sea_surface_water__salinity": "sea_surface_salinity",
    "sea_ice__area_fraction": "sea_ice_area_fraction",
    "sea_ice__thickness": "sea_ice_thickness",
    "sea_bottom_surface__depth": "sea_floor_depth_below_geoid",
    "land-ice_calving__mass_flux": "land_ice_specific_mass_flux_due_to_calving",
    "land-ice_calving_heat__energy_flux": "heat_flux_of_calved_ice",
    "iceberg__melt_mass_flux": "water_flux_into_sea_water_from_icebergs",
    "iceberg_melt_heat__energy_flux": "heat_flux_into_sea_water_due_to_iceberg_thermodynamics",
    "land-ice__melt_mass_flux": "water_flux_into_sea_water_from_land_ice",
    "land-ice_melt_heat__energy_flux": "heat_flux_into_sea_water_due_to_land_ice",
    "iceberg_floating__mass-per-area_density": "iceberg_mass_on_sea_water",
    "iceberg_grounded__mass-per-area_density": "grounded_iceberg_mass",
    "iceberg__area_fraction": "iceberg_area_fraction",
    "iceberg_bottom_water_flow__shear_speed": "iceberg_friction_velocity",
    "iceberg_bottom_water_flow__x_component_of_shear_stress": "downward_eastward_stress_from_icebergs",
    "iceberg_bottom_water_flow__y_component_of_shear_stress": "downward_northward_stress_from_icebergs",
}
"""Names of the variables as CSDMS forms them (object, two underscores, quantity), and those of CF for the same.

The tester of CSDMS looks at names with an expression that takes years for a long one without the two underscores.
"""


class BmiRiftberg(Bmi):
    """Bergs beside an ocean, behind the Basic Model Interface.

    Input variables are listed in `riftberg.coupling.fields.TAKEN` (wind, not its stress), output variables in
    `riftberg.coupling.fields.GIVEN`. Fields that are not set are at rest or absent, salinity 34; temperature is NaN, and must be
    set if bergs melt. They are listed by the names of CSDMS, see `NAMES`; CF names are known too.

    Examples
    --------
    A configuration file::

        grid: {west: -40, east: -36, south: -58, north: -55, columns: 16, rows: 12, depth: 3000, edge: open}
        berg: {length: 30000, width: 12000, thickness: 200, lon: -38, lat: -56.5}
        parameters: {melt: {enabled: true}}
        ocean: {sea_surface_temperature: 1.5, sea_surface_salinity: 34.0}
        days: 10
    """

    def __init__(self) -> None:
        self._exchange: Exchange | None = None
        self._values: dict[str, NDArray[np.float64]] = {}
        self._lacking: set[str] = set()
        self._end = 0.0

    # ------------------------------------------------------------------------------------------------- from start to end

    def initialize(self, config_file: str) -> None:
        """Read a configuration file, and set the model up.

        Raises
        ------
        InputError
            If the file is missing, or says something that cannot be.
        """
        settings = _read(Path(config_file))
        box: Basin = settings["grid"]
        grid = box.cells()
        self._spacing = (box.north - box.south) / box.rows, (box.east - box.west) / box.columns
        self._origin = (box.south + 0.5 * self._spacing[0], box.west + 0.5 * self._spacing[1])
        self._shape = box.rows, box.columns
        forcing = OceanForcing(grid, grid.fields(depth=box.depth))
        usual = {"length": "2 km", "width": "2 km", "thickness": "200 m", "lon": 0.0, "lat": 0.0}
        values = {**usual, **settings.get("berg", {})}
        if unknown := [name for name in values if name not in usual]:
            raise InputError(f"unknown {unknown[0]!r} of the berg", where="berg", remedy=f"Give {', '.join(usual)}")
        position = values["lon"], values["lat"]
        berg = Iceberg.rectangle(values["length"], values["width"], thickness=values["thickness"], placement=position)
        model = Model(berg, forcing, Parameters(**settings.get("parameters", {})))
        grid.locate(model.elements)  # refuses a berg beyond the grid
        self._exchange = Exchange(model, staggering="A", wind_staggering="A")
        self._end = 86400.0 * number(settings.get("days", 1.0), "day", where=f"{config_file}, days")
        if not 0.0 < self._end < math.inf:
            raise InputError(f"days = {settings['days']}", where=config_file, remedy="Give a finite number above 0")
        self._values = {name: np.zeros(self._shape) for name in NAMES.values()}
        self._values["sea_floor_depth_below_geoid"][:] = box.depth
        # No warmth of the sea is usual: until it is given it is not handed over, and bergs that melt are refused.
        self._lacking = {"sea_surface_temperature"}
        self._values["sea_surface_temperature"][:] = np.nan
        # Of the open Southern Ocean, where nothing else is given.
        self._values["sea_surface_salinity"][:] = 34.0
        for name, value in settings.get("ocean", {}).items():
            cf_name = NAMES.get(name, name)
            if cf_name in GIVEN or cf_name not in self._values:
                raise InputError(f"unknown field {name!r}", where=f"{config_file}, ocean", remedy="See TAKEN")
            self._values[cf_name][:] = number(value, TAKEN[cf_name].units, where=f"{config_file}, ocean, {name}")
        handed = self._given_inputs()
        # Only for the check: values that cannot be are refused here and not in the first step.
        taken(handed, {TAKEN[name].field: (self._shape,) for name in handed}, np.ones(self._shape))

    @property
    def exchange(self) -> Exchange:
        """The exchange behind the interface."""
        if self._exchange is None:
            raise InputError("not initialized", where="BmiRiftberg", remedy="Call initialize(config_file) first")
        return self._exchange

    def update(self) -> None:
        """Take one step."""
        fields = self.exchange.step(self._given_inputs())
        for name, quantity in GIVEN.items():
            self._values[name][:] = fields[quantity.short].values

    def _given_inputs(self) -> dict[str, NDArray[np.float64]]:
        """Return the input fields that have been given."""
        self._lacking = {name for name in self._lacking if np.isnan(self._values[name]).all()}
        return {name: q for name, q in self._values.items() if name in TAKEN and name not in self._lacking}

    def update_until(self, time: float) -> None:
        """Step until a time (s); it must be reached by whole steps."""
        step = self.get_time_step()
        count = round((time - self.get_current_time()) / step)
        if count < 0 or abs(self.get_current_time() + count * step - time) > 1e-6 * step:
            raise InputError(f"time {time:g} s is not reached by whole steps of {step:g} s", where="update_until")
        for _ in range(count):
            self.update()

    def finalize(self) -> None:
        """Let the model go."""
        self._exchange, self._values = None, {}

    # ------------------------------------------------------------------------------------------------------ what it is

    def get_component_name(self) -> str:
        """Return the name of the model."""
        return "Riftberg"

    def get_input_item_count(self) -> int:
        """Return the number of input variables."""
        return len(self.get_input_var_names())

    def get_output_item_count(self) -> int:
        """Return the number of output variables."""
        return len(GIVEN)

    def get_input_var_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Return the names of the input variables."""
        return tuple(name for name, cf_name in NAMES.items() if cf_name in TAKEN)

    def get_output_var_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Return the names of the output variables."""
        return tuple(name for name, cf_name in NAMES.items() if cf_name in GIVEN)

    def get_var_grid(self, name: str) -> int:
        """Return the number of the grid of a variable."""
        self._field(name)
        return 0

    def get_var_type(self, name: str) -> str:
        """Return the type of a variable."""
        return str(self._field(name).dtype)

    def get_var_units(self, name: str) -> str:
        """Return the units of a variable."""
        self._field(name)
        return {**TAKEN, **GIVEN}[NAMES.get(name, name)].units

    def get_var_itemsize(self, name: str) -> int:
        """Return the size of one number, bytes."""
        return int(self._field(name).itemsize)

    def get_var_nbytes(self, name: str) -> int:
        """Return the size of a variable, bytes."""
        return int(self._field(name).nbytes)

    def get_var_location(self, name: str) -> str:
        """Return where the numbers of a variable stand."""
        self._field(name)
        return "node"

    def get_current_time(self) -> float:
        """Return the time since the start, s."""
        return self.exchange.model.time

    def get_start_time(self) -> float:
        """Return the time at the start, s."""
        return 0.0

    def get_end_time(self) -> float:
        """Return the time at the end, s."""
        return self._end

    def get_time_units(self) -> str:
        """Return the unit of time."""
        return "s"

    def get_time_step(self) -> float:
        """Return the time step, s."""
        return self.exchange.ocean_step

    # ---------------------------------------------------------------------------------------------------------- values

    def _field(self, name: str) -> NDArray[np.float64]:
        cf_name = NAMES.get(name, name)
        if cf_name not in self._values:
            raise InputError(
                f"no variable {name!r}", where="BmiRiftberg", remedy="See get_input_var_names and get_output_var_names"
            )
        return self._values[cf_name]

    def get_value(self, name: str, dest: NDArray[Any]) -> NDArray[Any]:
        """Copy a variable."""
        dest[:] = self._field(name).reshape(dest.shape)
        return dest

    def get_value_ptr(self, name: str) -> NDArray[Any]:
        """Return a variable itself."""
        return self._field(name).reshape(-1)

    def get_value_at_indices(self, name: str, dest: NDArray[Any], inds: NDArray[Any]) -> NDArray[Any]:
        """Copy some numbers of a variable."""
        dest[:] = self._field(name).reshape(-1)[inds]
        return dest

    def set_value(self, name: str, src: NDArray[Any]) -> None:
        """Set a variable."""
        values = self._field(name)
        values[:] = np.asarray(src, dtype=float).reshape(values.shape)

    def set_value_at_indices(self, name: str, inds: NDArray[Any], src: NDArray[Any]) -> None:
        """Set some numbers of a variable."""
        self._field(name).reshape(-1)[inds] = src

    # ------------------------------------------------------------------------------------------------------------ grid

    def get_grid_rank(self, grid: int) -> int:
        """Return the number of dimensions."""
        return 2

    def get_grid_size(self, grid: int) -> int:
        """Return the number of cells."""
        return self._shape[0] * self._shape[1]

    def get_grid_type(self, grid: int) -> str:
        """Return the kind of grid."""
        return "uniform_rectilinear"

    def get_grid_shape(self, grid: int, shape: NDArray[Any]) -> NDArray[Any]:
        """Return rows and columns."""
        shape[:] = self._shape
        return shape

    def get_grid_spacing(self, grid: int, spacing: NDArray[Any]) -> NDArray[Any]:
        """Return the spacing of rows and columns, degrees."""
        spacing[:] = self._spacing
        return spacing

    def get_grid_origin(self, grid: int, origin: NDArray[Any]) -> NDArray[Any]:
        """Return latitude and longitude of the first cell."""
        origin[:] = self._origin
        return origin

    def _axis(self, k: int, out: NDArray[Any]) -> NDArray[Any]:
        out[:] = self._origin[k] + self._spacing[k] * np.arange(self._shape[k])
        return out

    def get_grid_x(self, grid: int, x: NDArray[Any]) -> NDArray[Any]:
        """Return the longitudes of the columns."""
        return self._axis(1, x)

    def get_grid_y(self, grid: int, y: NDArray[Any]) -> NDArray[Any]:
        """Return the latitudes of the rows."""
        return self._axis(0, y)

    def get_grid_node_count(self, grid: int) -> int:
        """Return the number of cells."""
        return self.get_grid_size(grid)

    def _no_mesh(self, *arguments: Any) -> Any:
        """Refuse: the grid has two dimensions and is no mesh."""
        raise NotImplementedError("the grid has two dimensions and is no mesh")

    _refused: Any = _no_mesh
    get_grid_z = get_grid_edge_count = get_grid_face_count = _refused
    get_grid_edge_nodes = get_grid_face_edges = get_grid_face_nodes = get_grid_nodes_per_face = _refused


def _read(path: Path) -> dict[str, Any]:
    """Read a configuration file; its names are checked."""
    check_file(path, most=MOST_YAML, remedy="Name a YAML file")
    with reading(path, "cannot be read", "Write it as YAML"):
        settings = yaml.safe_load(path.read_text("utf-8"))
    if not isinstance(settings, dict) or "grid" not in settings:
        raise InputError(
            "no section 'grid'", where=str(path), remedy=f"Give {', '.join(Basin.model_fields)} under grid"
        )
    for name in settings:
        if name not in SECTIONS:
            raise InputError(f"unknown section {name!r}", where=str(path), remedy=f"Sections are {', '.join(SECTIONS)}")
    for name in ("berg", "parameters", "ocean"):
        if not isinstance(settings.get(name, {}), dict):
            raise InputError(
                f"section {name!r} is no list of names and values", where=str(path), remedy="See the how-to page"
            )
    return {**settings, "grid": read_section(Basin, settings["grid"], where=f"{path}, grid")}
