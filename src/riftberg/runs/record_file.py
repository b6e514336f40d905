"""The run file under way: laid out for its elements and bonds, filled block by block, taken up where a run goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.errors import InputError
from riftberg.runs.background import add_background
from riftberg.runs.derived import Derived, list_ledgers, values_now, write_fragment_melt
from riftberg.runs.layout import (
    BOND_LATEST,
    COMMAND,
    FILE,
    PLACE,
    SHAPE,
    TABLES,
    Layout,
    in_file,
    position_names,
    reorder,
    texts,
)
from riftberg.runs.schema import MISSING, REGISTRY, bond_history, define_histories, define_run, histories, stored_kind
from riftberg.runs.tracks import (
    ELEMENT_COLUMNS,
    ON_BED,
    berg_rows,
    ragged,
    split_blocks,
    track_longitudes,
    write_tracks,
)
from riftberg.state import Floats
from riftberg.system.atomic_files import replacing
from riftberg.system.netcdf_lock import open_netcdf

if TYPE_CHECKING:
    from riftberg.model import BareModel

ANEW: Final = "Go on from the restart into another folder (--resume FILE --output FOLDER)"
"""What to do where a file cannot be gone on with."""

ROUND: Final = 1e-6
"""Time (s) by which the sum of steps may miss a time of records."""


class Record:
    """Copies of the variables of one time, as the file has them, so that the tracks are those that a reader finds from it."""

    def __init__(self, model: BareModel, peak: Floats, derived: dict[str, Floats], layout: Layout) -> None:
        self.time = float(model.time)
        elements, bonds = model.elements, model.bonds
        # Identifiers of the layout itself where they are the same: `reorder` then need not compare them for each variable.
        self.ids = layout.ids if np.array_equal(elements.id, layout.ids) else elements.id.copy()
        self.bond_ids = layout.bond_ids if np.array_equal(bonds.id, layout.bond_ids) else bonds.id.copy()
        moving = dict(zip(("u", "v", "lon"), (*model.velocity(), track_longitudes(model)), strict=True))
        self.elements = {
            v.name: moving.get(v.name, getattr(elements, v.name)).astype(stored_kind(v)) for v in histories(model)
        }
        self.elements |= {name: getattr(elements, name).copy() for name in SHAPE}
        self.bonds = {name: getattr(bonds, name).astype("f4") for name in bond_history(model)}
        self.bonds["peak_stress"] = peak.astype("f4")
        self.derived = derived
        self.ledger = values_now(model, list_ledgers(model))


class RecordFile:
    """A run file and the rows of its elements and bonds.

    ``derived``: variables of the elements beside those of the state; ``attributes``: of the file.
    """

    def __init__(
        self, path: Path, model: BareModel, derived: Sequence[Derived], attributes: dict[str, Any], *, tracks: bool
    ) -> None:
        self.path, self.derived, self.attributes, self._with_tracks = path, derived, attributes, tracks
        self.layout = Layout()
        self.records, self.last_time = 0, float("nan")
        self._names = position_names(model.parameters.earth.latlon)
        self._tracks: list[dict[str, NDArray[Any]]] = []  # Rows of the bergs of written records, by block

    def follow(self, model: BareModel) -> None:
        """Make room for the elements and bonds that there are now."""
        self.layout.follow(model.elements, model.bonds, SHAPE, BOND_LATEST)

    @property
    def memory(self) -> dict[str, Any]:
        """What a restart keeps of the layout."""
        layout = self.layout
        change = np.array([layout.gaps, *(name in layout.moving for name in SHAPE)], float)
        return {"rows_of_elements": layout.ids, "rows_of_bonds": layout.bond_ids, "rows_change": change}

    def save(self, model: BareModel, held: list[Record], *, new: bool, last: bool, background: bool) -> None:
        """Write the present state and the records that are held; with the ``last`` the tracks, and currents and floor."""
        if self.layout.outgrown and not new:
            self.lay_out_anew(model)
        # Never an old file emptied: HDF5 refuses to write what this process still has open for reading.
        with replacing(self.path, copy=not new) as copy, open_netcdf(copy, "w" if new else "a") as file:
            if new:
                self._define(file, model)
            file.set_auto_mask(False)
            self._write_state(file, model)
            if held:
                self._write_records(file, model, held)
            if last and self._tracks and self._with_tracks:  # a berg lies in one piece, and cannot be appended to
                fragments = {row.number: vars(row) for row in model.fragments.rows}
                write_tracks(file, ragged(self._tracks, fragments, model.start, not self._names))
            if last and background:
                add_background(file, model)
        self.records += len(held)
        self.last_time = held[-1].time if held else self.last_time

    def _define(self, file: netCDF4.Dataset, model: BareModel) -> None:
        """Create dimensions and variables, and write the constants."""
        define_run(file, model, self._names, self.layout)
        define_histories(file, [v for entry in self.derived for v in entry.variables], self._names, self.layout)
        file.setncatts(self.attributes)
        self.layout.written()

    def _write_state(self, file: netCDF4.Dataset, model: BareModel) -> None:
        """Write the present state of the bonds, the family tree and the events, over the earlier ones."""
        self.layout.refresh(model.elements, model.bonds, BOND_LATEST)
        for name in BOND_LATEST:
            file[in_file(name)][:] = self.layout.latest[name]
        events: tuple[Sequence[Any], ...] = (
            model.fragments.rows, model.contacts.rows, model.groundings.rows, model.rift_tips,
        )  # fmt: skip
        if written := file.dimensions["rift_tip"].size:
            file["rift_tip_crack"][:written] = 0  # tips that stand no more keep their rows
        for (kind, variables), rows in zip(TABLES, events, strict=True):
            for v in variables if rows else ():
                values = [getattr(row, v.name) for row in rows]
                column = texts(values) if v.dtype == "str" else np.array(values, v.dtype)
                file[f"{kind}_{self._names.get(v.name, v.name)}"][: len(rows)] = column
        write_fragment_melt(file, model)

    def _write_records(self, file: netCDF4.Dataset, model: BareModel, held: list[Record]) -> None:
        """Write records behind those that are there, and keep the rows of their bergs."""
        layout, block = self.layout, slice(self.records, self.records + len(held))
        columns: dict[str, NDArray[Any]] = {}
        for v in [*histories(model), *(REGISTRY[name] for name in SHAPE)]:
            missing = MISSING if v.dtype == "i8" else np.nan
            columns[v.name] = np.stack([reorder(r.ids, r.elements[v.name], layout.ids, missing) for r in held], axis=1)
        for name in bond_history(model):
            columns[name] = np.stack(
                [reorder(r.bond_ids, r.bonds[name], layout.bond_ids, np.nan) for r in held], axis=1
            )
        for name, values in columns.items():
            if name not in SHAPE or name in layout.moving:
                file[self._names.get(name, in_file(name))][:, block] = values
        for name in held[0].ledger:
            file[name][:, block] = np.stack([r.ledger[name] for r in held], axis=1)
        for name in held[0].derived:
            derived = [reorder(r.ids, r.derived[name], layout.ids, np.nan) for r in held]
            file[name][:, block] = np.stack(derived, axis=1)
        times = np.array([r.time for r in held])
        file["time"][block] = times
        self._tracks.append(berg_rows(times, layout.latest | columns, model.parameters))

    def lay_out_anew(self, model: BareModel) -> None:
        """Write the file again, with room for elements and bonds that have come since."""
        with replacing(self.path) as temporary, open_netcdf(self.path) as old, open_netcdf(temporary, "w") as file:
            old.set_auto_mask(False)
            file.set_auto_mask(False)
            self._define(file, model)
            block = slice(0, self.records)
            file["time"][block] = old["time"][block]
            has_position = np.isfinite(old[self._names.get("lon", "lon")][:, block])
            for name, variable in old.variables.items():
                if name not in file.variables or file[name].dimensions[1:] != ("time",):
                    continue  # written with the latest state, or fixed since it was laid out
                rows = slice(0, min(variable.shape[0], file[name].shape[0]))
                if variable.dimensions[1:] == ("time",):
                    file[name][rows, block] = variable[rows, block]
                else:
                    file[name][rows, block] = np.where(has_position[rows], variable[rows][:, None], np.nan)

    def take_up(self, old: netCDF4.Dataset, model: BareModel, memory: Mapping[str, Any], location: str) -> None:
        """Take the layout and the records from before the state of a model out of the file; refuse that of another run.

        ``memory``: the layout when that state was saved (`RecordFile.memory`).
        """
        layout = self.layout
        layout.ids, layout.bond_ids = memory["rows_of_elements"], memory["rows_of_bonds"]
        elements, bonds = layout.ids.size, layout.bond_ids.size
        if not np.array_equal(old["trajectory"][:elements], layout.ids) or old.dimensions["bond"].size < bonds:
            raise InputError("its elements are not those of the restart file", where=location, remedy="Name another")
        # The command that made the run, not the one that continues it.
        self.attributes |= {name: old.getncattr(name) for name in (COMMAND, FILE, PLACE) if name in old.ncattrs()}
        if old.getncattr("parameters_json") != self.attributes["parameters_json"]:
            raise InputError("a run with other parameters than those of the restart file", where=location, remedy=ANEW)
        gaps, *moving = memory["rows_change"].tolist()
        layout.taken_up(
            {name: _first_seen(old[in_file(name)][:elements]) for name in SHAPE},
            {name: old[in_file(name)][:bonds] for name in BOND_LATEST},
            gaps=bool(gaps), moving=[name for name, moves in zip(SHAPE, moving, strict=True) if moves],
        )  # fmt: skip
        self.records = int(np.searchsorted(old["time"][:], model.time - ROUND))
        self.last_time = float(old["time"][self.records - 1])
        on_bed = ON_BED if model.parameters.grounding.law == "seabed" else ()
        rows = {"trajectory": slice(elements), "bond": slice(bonds)}
        for block in split_blocks(self.records, elements):
            columns = {
                name: variable[tuple(rows.get(dim, block) for dim in variable.dimensions)]
                for name in (*ELEMENT_COLUMNS, *on_bed, *bond_history(model))
                for variable in [old[self._names.get(name, name)]]
            }
            self._tracks.append(berg_rows(old["time"][block], layout.latest | columns, model.parameters))


def _first_seen(values: NDArray[Any]) -> NDArray[Any]:
    """Return the shape of each element at its first record."""
    if values.ndim == 1:
        return values
    first: NDArray[Any] = values[np.arange(len(values)), np.argmax(np.isfinite(values), axis=1)]
    return first
