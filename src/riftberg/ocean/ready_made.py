"""`riftberg.Forcing`: all ready-made forcing under one name, and what a class of one's own stands on."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

import xarray as xr

from riftberg.config.values import required
from riftberg.errors import ForcingError
from riftberg.ocean import formulas
from riftberg.ocean.datasets import DatasetForcing


class Forcing(formulas.Formula):
    """Forcing by formula or from datasets; parts are combined with ``+``.

    A class of one's own needs one method, ``add_to(elements, time)``, which adds to the environment of the elements;
    ``currents`` and ``depth`` let maps show it.

    Examples
    --------
    >>> ocean = Forcing.uniform(current=(0.1, 0.0)) + Forcing.eddy((-37.0, -56.0), radius=40e3, speed=0.5)
    >>> ocean = ocean + Forcing.turning_wind(10.0) + Forcing.seamount((-36.0, -56.0), 400.0, 20e3, depth=500.0)
    >>> class Swirl(Forcing):
    ...     def add_to(self, elements, time):
    ...         elements.environment.uo[:] += 0.1 * np.cos(time / 43200.0)
    >>> ocean = ocean + Swirl()
    """

    uniform = formulas.Uniform
    eddy = formulas.Eddy
    jet = formulas.Jet
    shear = formulas.Shear
    front = formulas.Front
    tide = formulas.Tide
    seamount = formulas.Seamount
    slope = formulas.Slope
    turning_wind = formulas.TurningWind

    @staticmethod
    def from_xarray(
        datasets: xr.Dataset | Sequence[xr.Dataset], start: datetime | None = None, **options: Any
    ) -> DatasetForcing:
        """Return the forcing that datasets in memory, or opened by xarray, give.

        Parameters
        ----------
        datasets : xarray.Dataset or sequence of them
            Currents and, as they are at hand, sea level, wind, sea ice and sea floor; with CF standard names and units, each on
            its own grid and at its own times.
        start : datetime.datetime, optional
            Date of the model's time 0 (UTC); by default the first at which all of them have records. A model with this
            forcing starts then.
        **options
            As for `riftberg.DatasetForcing`.
        """
        products = list_of_datasets(datasets)
        return DatasetForcing.from_xarray(products, start, **options)


def list_of_datasets(datasets: Any) -> list[xr.Dataset]:
    """Return one dataset or several as a list, or refuse what is none."""
    several = list(datasets) if isinstance(datasets, list | tuple) else [datasets]
    for part in several or [None]:
        required(
            part, xr.Dataset, "a dataset of xarray, or a list of them, such as xarray.open_dataset(file)",
            where="Forcing.from_xarray", kind=ForcingError,
        )  # fmt: skip
    return several
