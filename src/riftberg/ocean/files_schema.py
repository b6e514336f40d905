"""What an experiment file may say about forcing from files (section ``forcing``, ``kind: files``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final, Literal

from pydantic import field_validator, model_validator

from riftberg.config.values import Pair, Section, UnfitError, key
from riftberg.errors import ForcingError
from riftberg.ocean.needs import SeaLevel
from riftberg.system.input_files import hidden

if TYPE_CHECKING:
    from riftberg.products.registry import Choice


class NamedFiles(Section):
    """Files whose product, or whose variables, are named."""

    file: str = key(..., "", "file or pattern", min_length=1)
    product: str | None = key(None, "", "name of the product, instead of recognising it")

    names: dict[str, str] = key(
        {}, "", "variable of a quantity or coordinate: {uo: u, vo: v}; quantities and lon, lat, time, depth"
    )

    @classmethod
    def chosen(cls, file: str, choice: Choice) -> NamedFiles:
        """Return files with their product, or names, as the readers take them; these are not checked."""
        file = hidden(file)
        if choice is None or isinstance(choice, str):
            return cls.model_construct(file=file, product=choice, names={})
        if isinstance(choice, Mapping):
            return cls.model_construct(file=file, product=None, names=dict(choice))
        return cls.model_construct(file=file, product=choice.name, names=dict(choice.names))

    @property
    def choice(self) -> Choice:
        """Product and names as the readers take them."""
        from riftberg.products.registry import choose_product

        return choose_product(self.product, self.names, where=f"names of {self.file}")

    @field_validator("file")
    @classmethod
    def _hidden(cls, file: str) -> str:
        return hidden(file)

    @model_validator(mode="after")
    def _known(self) -> NamedFiles:
        from riftberg.products.registry import PRODUCTS, check_naming

        try:
            check_naming(self.names)
        except ForcingError as error:
            raise UnfitError(f"names: {error.what}", error.remedy) from error

        names = [product.name for product in PRODUCTS]
        if self.product is not None and self.product not in names:
            raise ValueError(f"there is no product {self.product!r}; choose one of {', '.join(names)}")
        return self


WIND_LAYER: Final = (
    "share of the wind, turned by 45 degrees, that is taken out of currents at the surface; 0.005 was measured"
)
"""What an experiment file says of it."""


class FileForcing(Section):
    """Ocean, air, sea ice and sea floor from data files."""

    kind: Literal["files"]
    files: list[str | NamedFiles] = key(
        ...,
        "",
        "files or patterns; {file: NAME, product: PRODUCT} names the product, {file: NAME, names: {uo: u}} the variables",
        min_length=1,
    )
    longitude: Pair | None = key(
        None, "degree", "west and east of what is needed; by default as far as the berg may drift"
    )
    latitude: Pair | None = key(None, "degree", "south and north of what is needed; likewise")
    spacing: float | None = key(
        None,
        "degree",
        "width of the cells of a model grid for all fields; without it each product keeps its own",
        gt=0,
        le=5,
    )
    every_hours: float = key(6.0, "h", "interval at which files are interpolated to a model grid", gt=0)
    currents: Literal["draft", "surface"] = key(
        "draft", "", "of files with levels: mean over the draft of each element, or the uppermost level"
    )
    coastal_drift: float = key(0.0, "m s-1", "current added away from land cells", ge=0)
    max_gap: float | None = key(
        None, "h", "longest gap between records that is interpolated across, else 2.5 intervals of the product", gt=0
    )
    hold: float | None = key(
        None, "h", "how long first and last record are held, else half the time that a mean stands for", ge=0
    )
    sea_level: SeaLevel = key(
        "auto",
        "",
        "files: that of the files; geostrophic: the slope that balances the current; auto: the first if it is there, else the "
        "second, with a notice; none: no slope",
    )
    wind_layer: float = key(0.0, "1", WIND_LAYER, ge=0, le=0.05)
    wind: Literal["files", "none"] = key("files", "", "none leaves it out: calm air, unannounced")
    member: int | None = key(
        None,
        "",
        "of files with members of an ensemble the one that is read, from 0; riftberg forecast takes them in turn",
        ge=0,
    )

    @field_validator("files")
    @classmethod
    def _hidden(cls, files: list[str | NamedFiles]) -> list[str | NamedFiles]:
        return [hidden(entry) if isinstance(entry, str) else entry for entry in files]

    @model_validator(mode="after")
    def _a_box(self) -> FileForcing:
        if any(entry == "" for entry in self.files):
            raise ValueError("files holds an empty name")
        if (self.longitude is None) != (self.latitude is None):
            raise ValueError("give longitude and latitude, or none of them")
        for name, pair, most in (("longitude", self.longitude, 540.0), ("latitude", self.latitude, 90.0)):
            if pair is None:
                continue
            low, high = pair
            if abs(low) > most or abs(high) > most:
                raise ValueError(f"{name} = [{low:g}, {high:g}] is not in degrees; they go from {-most:g} to {most:g}")
            if name == "latitude" and low >= high:
                raise ValueError(f"latitude = [{low:g}, {high:g}]: the southern one stands first")
        return self

    @property
    def box(self) -> tuple[Pair, Pair]:
        """Longitudes and latitudes of the box, once they are chosen; east is above west, also across the date line."""
        assert self.longitude is not None
        assert self.latitude is not None
        west, east = self.longitude
        return (west, east if east > west else east + 360.0), self.latitude

    @property
    def entries(self) -> list[NamedFiles]:
        """All entries of ``files`` in one form."""
        return [NamedFiles(file=entry) if isinstance(entry, str) else entry for entry in self.files]
