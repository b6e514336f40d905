"""What is most often read from a run: bergs, fragments and elements, as ``run.riftberg`` of an `xarray.Dataset`."""

from __future__ import annotations

import importlib
from collections.abc import Hashable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from riftberg.runs.layout import called
from riftberg.runs.tracks import tracks_of


class Table:
    """A dataset with a data frame and a picture that suit it; all else is that of the dataset."""

    picture = ""

    def __init__(self, dataset: xr.Dataset, run: xr.Dataset) -> None:
        self.dataset, self._run = dataset, run

    def __getattr__(self, name: str) -> Any:
        """Return what the dataset has."""
        if name.startswith("__") or name == "dataset":
            raise AttributeError(name)
        return getattr(self.dataset, name)

    def __getitem__(self, name: Any) -> Any:
        """Return a variable of the dataset."""
        return self.dataset[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether the dataset has a variable."""
        return name in self.dataset

    def __iter__(self) -> Iterator[Hashable]:
        """Give the names of the variables."""
        return iter(self.dataset)

    def __dir__(self) -> list[str]:
        """Name what the dataset has too."""
        return sorted({*super().__dir__(), *dir(self.dataset)})

    def __repr__(self) -> str:
        return repr(self.dataset)

    def _repr_html_(self) -> str:
        return self.dataset._repr_html_()

    def to_dataframe(self) -> Any:
        """Return the table as a data frame."""
        return self.dataset.to_dataframe()

    def plot(self, *args: Any, **options: Any) -> Any:
        """Draw the picture of the table; arguments are those of ``riftberg.draw_tracks`` and its like."""
        # The package offers pictures by name; runs are below them.
        return getattr(importlib.import_module("riftberg"), self.picture)(self._run, *args, **options)


class Tracks(Table):
    """Bergs and fragments over time: a CF contiguous ragged array, one after the other along ``index``."""

    picture = "draw_tracks"

    def to_dataframe(self) -> Any:
        """Return one row for each berg or fragment and time, indexed by both: ``.loc["A68a"]`` is the track of one."""
        import pandas as pd  # type: ignore[import-untyped]

        tracks, size = self.dataset, self.dataset["rowsize"].values
        names = [
            called(*row)
            for row in zip(*(tracks[k].values.tolist() for k in ("trajectory", "parent", "name")), strict=True)
        ]
        index = pd.MultiIndex.from_arrays(
            [np.repeat(np.array(names, object), size), tracks["time"].values], names=["berg", "time"]
        )
        columns = {str(name): v.values for name, v in tracks.data_vars.items() if v.dims == ("index",)}
        return pd.DataFrame(columns, index=index)


class Fragments(Table):
    """The family tree: one entry for each berg and fragment, with its birth."""

    picture = "draw_fragments"


class ElementTable(Table):
    """The elements over time."""

    picture = "draw_map"


@xr.register_dataset_accessor("riftberg")  # type: ignore[no-untyped-call]
class RunAccessor:
    """A run by bergs, by fragments and by elements.

    Attributes
    ----------
    tracks : Tracks
        Bergs and fragments over time: position, velocity, spin, area, mass, length, width, azimuth, largest stress over
        strength, aground or not.
    fragments : Fragments
        The family tree, with date, place and size of each birth.
    elements : ElementTable
        The elements over time.

    Examples
    --------
    >>> run = riftberg.open_run("riftberg-out/a68a")        # doctest: +SKIP
    >>> run.riftberg.tracks.to_dataframe()                  # doctest: +SKIP
    >>> run.riftberg.tracks.plot("tracks.png")              # doctest: +SKIP
    """

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run

    @cached_property
    def tracks(self) -> Tracks:
        """Bergs and fragments over time, made from the elements of this dataset; so a part of a run has its own."""
        return Tracks(tracks_of(self._run), self._run)

    def compare(self, other: xr.Dataset, berg: str | None = None) -> xr.Dataset:
        """Compare a berg of this run with the same berg of another run.

        Parameters
        ----------
        other : xarray.Dataset
            Another run, or a member of a sweep: ``riftberg.open_sweep(path).isel(member=3)``.
        berg : str, optional
            Name of the berg; by default the largest at the start of each run.

        Returns
        -------
        xarray.Dataset
            At the dates of this run that both have: ``distance`` of the centroids (m), ``rotation`` of the long axis
            (degrees, clockwise, NaN for members of a sweep), ``area`` of both (m2); and date and area of the break-ups, the
            same event of both in one column.

        Raises
        ------
        InputError
            If the runs have no date in common, or no such berg.
        """
        # Comparisons stand above runs, as pictures do.
        between = importlib.import_module("riftberg.diagnostics.compare").between
        return between(self._run, other, berg)  # type: ignore[no-any-return]

    @cached_property
    def fragments(self) -> Fragments:
        """The family tree of bergs and fragments."""
        run = self._run
        names = [
            str(name) for name in run.variables if str(name).startswith("fragment_") and run[name].dims == ("fragment",)
        ]
        table = run[names].rename({name: name.removeprefix("fragment_") for name in names}).reset_coords()
        return Fragments(table.set_coords("number").swap_dims(fragment="number"), run)

    @cached_property
    def elements(self) -> ElementTable:
        """The elements over time."""
        run = self._run
        along = {"trajectory"}, {"trajectory", "time"}
        names = [name for name, v in run.data_vars.items() if set(v.dims) in along]
        return ElementTable(run[names].rename(trajectory="element"), run)
