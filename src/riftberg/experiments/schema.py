"""The schema of an experiment file in YAML: sections, keys, units and limits.

Quantities may carry units (``thickness: 200 m``, ``time_step: 30 min``); plain numbers are in the unit named here.
"""

from __future__ import annotations

from datetime import date, datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from riftberg.bergs.keys import LATTICE, BergKeys, CloudOfBergs, FieldOfBergs, LatticeRows, Rectangle
from riftberg.config.values import (
    NORTHERNMOST,
    SOUTHERNMOST,
    Pair,
    Section,
    UnfitError,
    check_place,
    in_metres,
    in_utc,
    key,
)
from riftberg.errors import InputError
from riftberg.ocean import formulas
from riftberg.ocean.files_schema import WIND_LAYER, FileForcing
from riftberg.ocean.needs import SeaLevel
from riftberg.parameters import A68A_2022, A68A_2022_KID, Parameters

SHAPES = ("outline", "mask", "shelf", "rectangle", "lattice", "points", "seed", "field")
"""Ways to give the shape of a berg."""


class Dated(Section):
    """A file with several dates, of which one is named; in YAML a date stands without quotes."""

    @model_validator(mode="before")
    @classmethod
    def _date_as_text(cls, data: Any) -> Any:
        written = data.get("date") if isinstance(data, dict) else None
        return {**data, "date": written.isoformat()} if isinstance(written, date) else data


class OutlineFile(Dated):
    """Shape from a polygon."""

    file: str = key(..., "", "GeoJSON, shapefile, CSV (lon, lat) or KML")
    feature: int | str | None = key(None, "", "which outline of a file with several")
    date: str | None = key(None, "", "date of the outline in a file with several")
    crs: str | None = key(None, "", "coordinate system of projected coordinates, such as EPSG:3031")
    repair: bool = key(False, "", "mend an outline that crosses itself")


class Mask(Dated):
    """Shape from a grid of ones and zeros, or of thickness."""

    file: str = key(
        ..., "", "NetCDF grid with longitude and latitude, or GeoTIFF (extra geotiff), also in a map projection"
    )
    variable: str | None = key(None, "", "variable of the file; of a GeoTIFF the number or description of a band")
    threshold: float | None = key(None, "", "value above which a point is ice")
    date: str | None = key(None, "", "time of the file")


class Shelf(Dated):
    """Ice shelf that calves: the berg has its mass, and its thickness."""

    file: str = key(..., "", "map of thickness (m) on longitude and latitude or in a map projection; NetCDF or GeoTIFF")
    variable: str | None = key(None, "", "variable of the thickness")
    mask: str | None = key(
        None, "", "variable of the same file: the part of each cell that calves; by default all cells with ice"
    )
    date: str | None = key(None, "", "time of the file")
    crs: str | None = key(None, "", "coordinate system of x and y in m, such as EPSG:3031")


class PointsFile(Section):
    """Bergs, or the elements of one, from a table of places."""

    file: str = key(
        ...,
        "",
        "CSV with columns lon and lat; length (m) makes each row a lone berg, with width and thickness (m) if given",
    )


class Rift(Section):
    """Bonds weakened or removed along lines, or where a mask says."""

    file: str | None = key(None, "", "lines (GeoJSON, shapefile, CSV, KML) or a mask (NetCDF, GeoTIFF)")
    points: list[Pair] | None = key(
        None, "degree", "longitude and latitude of the vertices of a line, instead of a file"
    )
    strength: float = key(0.0, "1", "factor on the strength of the bonds crossed", ge=0, le=1)
    broken: bool = key(False, "", "remove the bonds crossed instead")
    depth: float | None = key(
        None,
        "1",
        "part of the thickness that the rift cuts instead; needs fracture.crevasse_strength, from which follows what is left",
        gt=0,
        lt=1,
    )
    crs: str | None = key(None, "", "coordinate system of projected coordinates of lines, such as EPSG:3031")
    variable: str | None = key(None, "", "variable of a mask")
    threshold: float = key(0.5, "", "value of a mask above which there is a rift")

    @model_validator(mode="after")
    def _one_source(self) -> Rift:
        if (self.file is None) == (self.points is None):
            raise ValueError("a rift needs exactly one of file and points")
        if self.points is not None and len(self.points) < 2:
            raise ValueError("the points of a rift are at least two")
        if self.broken + ("strength" in self.model_fields_set) + (self.depth is not None) > 1:
            raise ValueError("a rift has one of strength, broken: true and depth")
        extra = sorted(self.model_fields_set & {"crs", "variable", "threshold"})
        if self.points is not None and extra:
            raise ValueError(f"the points of a rift have no {extra[0]}")
        return self


STRENGTHS = ("weibull", "normal", "uniform", "file")
"""Ways to give the strengths of the bonds."""


class Strength(Section):
    """Relative strengths of the bonds: drawn with mean 1, or from a map."""

    weibull: float | None = key(None, "1", "modulus of a Weibull distribution", gt=0)
    normal: float | None = key(None, "1", "standard deviation of a normal distribution, values above zero", ge=0, lt=1)
    uniform: float | None = key(None, "1", "half width of a uniform distribution", ge=0, lt=1)
    file: str | None = key(None, "", "map of relative strength (NetCDF, GeoTIFF), read at the middles of the bonds")
    variable: str | None = key(None, "", "variable of the map")
    seed: int = key(
        1,
        "",
        "seed of the distribution: the same seed gives the same strengths, each of several bergs its own",
        ge=0,
    )

    @model_validator(mode="after")
    def _one_way(self) -> Strength:
        definitions = [name for name in STRENGTHS if getattr(self, name) is not None]
        if len(definitions) != 1:
            raise ValueError(f"the strength needs exactly one of {', '.join(STRENGTHS)}")
        if definitions[0] == "file" and "seed" in self.model_fields_set:
            raise ValueError("a map of strength has no seed")
        if definitions[0] != "file" and self.variable is not None:
            raise ValueError(f"variable is that of a map; {definitions[0]} has none")
        return self


class Berg(BergKeys):
    """The iceberg: one shape, thickness, elements, place and weak bonds."""

    name: str | None = key(None, "", "name of the berg, which its fragments bear too", min_length=1, max_length=60)
    outline: OutlineFile | None = key(None, "", "shape from a polygon: a file, or a section of its own")
    mask: Mask | None = key(None, "", "shape from a grid: a file, or a section of its own")
    shelf: Shelf | None = key(None, "", "ice shelf that calves: a file, or a section of its own")
    rectangle: Rectangle | None = None
    lattice: LatticeRows | None = None
    points: PointsFile | None = key(None, "", "lone bergs, or elements, at places: a table, or a section of its own")
    seed: CloudOfBergs | None = None
    field: FieldOfBergs | None = None
    rifts: list[Rift] = key(
        [], "", "weak or missing bonds where the berg lies at the start, a section or a list of them"
    )
    strength: Strength | None = key(None, "", "scatter of the strength of the bonds, a section of its own")

    @model_validator(mode="after")
    def _one_shape(self) -> Berg:
        shapes = [name for name in SHAPES if getattr(self, name) is not None]
        if len(shapes) != 1:
            count = f"has {len(shapes)} shapes ({', '.join(shapes)})" if shapes else "has no shape"
            raise ValueError(f"the berg {count}; give exactly one of {', '.join(SHAPES)}")
        if shapes[0] in ("rectangle", "lattice", "seed") and self.placement is None:
            raise ValueError(f"a berg from a {shapes[0]} needs placement: [longitude, latitude]")
        if shapes[0] in ("rectangle", "lattice", "points", "seed", "field") and isinstance(self.thickness, str):
            raise ValueError(f"a berg from a {shapes[0]} takes no map of thickness; give it in metres")
        may_have = {
            "field": ("thickness", "velocity"),
            "seed": ("placement", "thickness", "velocity"),
            "points": ("thickness", "velocity", "radius", "packing"),
        }.get(shapes[0])
        extra = sorted(self.model_fields_set - {shapes[0], *(may_have or self.model_fields_set)})
        if extra:
            *others, last = may_have or ("",)
            raise ValueError(f"{shapes[0]} has no {extra[0]}; beside it there may be {', '.join(others)} and {last}")
        placed = sorted(self.model_fields_set & {"thickness", "placement", "rotation", "shift", *LATTICE})
        if shapes[0] == "shelf" and placed:
            raise ValueError(
                f"a berg from a shelf has no {placed[0]}: thickness, place and lattice are those of the shelf"
            )
        return self

    @model_validator(mode="after")
    def _at_sea(self, info: ValidationInfo) -> Berg:
        """Refuse a place on or near a pole, where only swapped coordinates put a berg."""
        if self.placement is not None and not in_metres(info):
            final = self.placement[0], self.placement[1] + self.shift[1]
            check_place(final, south=SOUTHERNMOST, north=NORTHERNMOST)
        return self


class ExperimentForcing(Section):
    """The ocean of a built-in experiment."""

    kind: Literal["experiment"]
    experiment: Literal["a68a"] = key(..., "", "built-in experiment whose ocean is used")
    without: list[Literal["shoal", "shear"]] = key([], "", "parts of that ocean to leave out")


class FormulaForcing(Section):
    """Forcing by formulas, which are added; each may be a section or a list of sections."""

    kind: Literal["formula"]
    uniform: list[formulas.Uniform] = key([], "", "the same everywhere, a section or a list of sections")
    eddy: list[formulas.Eddy] = key([], "", "eddies, a section or a list of sections")
    jet: list[formulas.Jet] = key([], "", "jets, a section or a list of sections")
    shear: list[formulas.Shear] = key([], "", "shear layers, a section or a list of sections")
    front: list[formulas.Front] = key([], "", "fronts, a section or a list of sections")
    tide: list[formulas.Tide] = key([], "", "tides, a section or a list of sections")
    seamount: list[formulas.Seamount] = key(
        [], "", "seamounts, a section or a list of sections; the shallowest sea floor counts"
    )
    slope: list[formulas.Slope] = key([], "", "sloping sea floors, a section or a list of sections")
    turning_wind: list[formulas.TurningWind] = key([], "", "winds that turn, a section or a list of sections")

    @property
    def parts(self) -> list[formulas.Part]:
        """All formulas."""
        return [formula for name in formulas.FORMULAS for formula in getattr(self, name)]

    @model_validator(mode="after")
    def _something(self) -> FormulaForcing:
        if not self.parts:
            raise ValueError(f"no formula is given; give one or more of {', '.join(formulas.FORMULAS)}")
        return self


class SeriesForcing(Section):
    """Forcing by a series in time that is the same everywhere, from a table."""

    kind: Literal["along"]
    along: str = key(
        ..., "", "CSV with a column time and columns uo, vo, ua, va, depth, ice_fraction, ...", min_length=1
    )
    means: bool = key(
        False, "", "a value is the mean over the interval that ends at its time; otherwise linear between times"
    )
    hold: float = key(0.0, "h", "how long the first and last value are held", ge=0)
    max_gap: float | None = key(
        None, "h", "longest time between two values that is interpolated across, else 2.5 usual ones", gt=0
    )
    sea_level: SeaLevel = key(
        "auto",
        "",
        "files: the slope of the table; geostrophic: that which balances the current; auto: the first, else the second",
    )
    wind_layer: float = key(0.0, "1", WIND_LAYER, ge=0, le=0.05)
    wind: Literal["files", "none"] = key("files", "", "none leaves the wind out")


class OpenDriftForcing(Section):
    """Forcing along a trajectory that OpenDrift wrote: start and size of the berg come from it too, where the file gives none."""

    kind: Literal["opendrift"]
    opendrift: str = key(..., "", "NetCDF file that OpenDrift (OpenBerg) wrote", min_length=1)
    trajectory: int | None = key(None, "", "number of the trajectory in a file with several")
    hold: float = key(0.0, "h", "how long the first and last value are held", ge=0)
    sea_level: SeaLevel = key("auto", "", "geostrophic or auto: the slope that balances the current; none: no slope")
    wind_layer: float = key(0.0, "1", WIND_LAYER, ge=0, le=0.05)
    wind: Literal["files", "none"] = key("files", "", "none leaves the wind out")


def forcing_kind(forcing: Any) -> Any:
    """Return the word that says of which kind a section of forcing is."""
    kind = forcing.get("kind") if isinstance(forcing, dict) else getattr(forcing, "kind", None)
    return kind if isinstance(kind, str) else None


Forcing = Annotated[
    Annotated[FileForcing, Tag("files")]
    | Annotated[ExperimentForcing, Tag("experiment")]
    | Annotated[FormulaForcing, Tag("formula")]
    | Annotated[SeriesForcing, Tag("along")]
    | Annotated[OpenDriftForcing, Tag("opendrift")],
    Field(discriminator=Discriminator(forcing_kind)),
]


FIRST_YEAR, LAST_YEAR = 1700, 2250
"""Years whose dates run files can keep to the nanosecond, as xarray does."""


def check_span(start: datetime, days: float, *, where: str) -> None:
    """Refuse a run whose dates no run file can hold."""
    if not (FIRST_YEAR <= start.year <= LAST_YEAR and days <= 366.0 * (LAST_YEAR - start.year + 1)):
        raise InputError(
            f"a run of {days:g} days from {start:%d.%m.}{start.year:04d}", where=where,
            remedy=f"Runs lie in the years {FIRST_YEAR} to {LAST_YEAR}",
        )  # fmt: skip


FORMER_KINDS = {
    "constant": "Write forcing: {uniform: {current: [0.2, 0.0], ...}}; slope: [0, 0] there keeps the sea surface level",
    "analytic": "Write forcing: {experiment: a68a}",
}
"""Kinds of forcing of earlier versions, and what to write now."""


class Experiment(Section):
    """A whole experiment file."""

    name: str = key(
        "experiment",
        "",
        "short name of letters, digits, dots and dashes, also of the output folder",
        pattern=r"^[A-Za-z0-9][\w.-]*$",
    )
    title: str = key("", "", "heading of the map")
    start: Annotated[datetime, AfterValidator(in_utc)] = key(..., "", "date and time of the start (UTC)")
    days: float = key(..., "day", "length of the run", gt=0)
    output_every_hours: float = key(1.0, "h", "interval of the records, at least the long step", gt=0)
    output_forces: bool = key(False, "", "write the mean force of each medium on each element between records")
    output_cells: float | None = key(
        None, "degree", "write fresh water, heat and mass on cells this wide, by month and by day", ge=0.01, le=10
    )
    berg: Berg | None = None
    bergs: list[Berg] = key([], "", "several bergs instead of one, a list of sections as berg has them")
    forcing: Forcing
    parameters: dict[str, Any] = key({}, "", "groups of parameters, and optionally a preset")
    vary: dict[str, str | float | list[Any]] = key(
        {},
        "",
        "what sweep, forecast and sensitivity vary: a distribution or values by name, as their --vary; run leaves it",
    )

    @field_validator("forcing", mode="before")
    @classmethod
    def _files_alone(cls, forcing: Any) -> Any:
        """Take a list of files, or one, for forcing of that kind, and a section by the key that only one kind has."""
        files = [forcing] if isinstance(forcing, str) else forcing
        forcing = {"files": files} if isinstance(files, list) else forcing
        if not isinstance(forcing, dict):
            return forcing
        if (remedy := FORMER_KINDS.get(str(forcing.get("kind")))) is not None:
            raise UnfitError(f"kind: {forcing['kind']} is gone", remedy)
        kinds = {key: key for key in ("files", "along", "opendrift", "experiment")} | dict.fromkeys(
            formulas.FORMULAS, "formula"
        )
        named = {kinds[key] for key in forcing if key in kinds}
        return {"kind": named.pop(), **forcing} if len(named) == 1 else forcing

    @field_validator("days")
    @classmethod
    def _kept_in_files(cls, days: float, info: ValidationInfo) -> float:
        try:
            if "start" in info.data:
                check_span(info.data["start"], days, where="")
        except InputError as error:
            raise UnfitError(error.what, error.remedy) from error
        return days

    @model_validator(mode="after")
    def _berg_or_bergs(self) -> Experiment:
        if (self.berg is None) == (not self.bergs):
            raise ValueError("the experiment needs exactly one of berg and bergs")
        return self

    @property
    def all_bergs(self) -> list[tuple[str, Berg]]:
        """The bergs, each with the name of its section."""
        if self.berg is not None:
            return [("berg", self.berg)]
        return [(f"bergs.{k}", berg) for k, berg in enumerate(self.bergs)]


PRESETS = {"a68a-2022": A68A_2022, "a68a-2022-reference": A68A_2022_KID, "default": Parameters()}
"""Sets of parameters that a file may start from."""
