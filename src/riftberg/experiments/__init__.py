"""Experiments by name, and the changes that a run may make in them.

A builder is a function ``build(options: Options) -> tuple[Model, Info]``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from riftberg.errors import InputError
from riftberg.experiments.registry import EXPERIMENTS, BuiltIn, Info, Numerics, Options, find, names

if TYPE_CHECKING:
    from riftberg.runs.model import Model

__all__ = ["EXPERIMENTS", "BuiltIn", "Info", "Numerics", "Options", "build", "find", "names"]


def build(name: str, options: Options | None = None) -> tuple[Model, Info]:
    """Build an experiment by name or from a YAML file.

    Parameters
    ----------
    name : str
        Name of a built-in experiment (``riftberg experiments`` lists them), or path of a file that ends in ``.yaml`` or ``.yml``.
    options : Options, optional
        What is changed in it.

    Returns
    -------
    model : Model
        The model at its start.
    info : Info
        What the experiment says of its runs: days, output, title, notices.

    Raises
    ------
    InputError
        If there is no such experiment or file, or an option does not go with it.

    Examples
    --------
    >>> model, info = build("a68a")
    >>> info.days
    17.0
    """
    options = options or Options()
    if name.endswith((".yaml", ".yml")):
        from riftberg.experiments.yaml_file import build_file

        if options.fetch:
            raise InputError("a YAML experiment names its own files", where="--fetch", remedy="Use riftberg fetch")
        model, info = build_file(Path(name), options)
        return model, replace(info, notices=(*options.notices, *info.notices))
    entry = find(name)
    if options.grid is not None:
        raise InputError(f"{name} has its own ocean", where="--grid", remedy="It is for experiments of YAML files")
    entry.check_parts(options.without)
    if options.lattice and not entry.lattice:
        lattice_key = next(iter(options.lattice))
        others = ", ".join(other.name for other in EXPERIMENTS if other.lattice)
        raise InputError(
            f"the lattice of {name} is part of the experiment", where=f"berg.{lattice_key}",
            remedy=f"Leave it out; {others} and YAML files take it",
        )  # fmt: skip
    if options.fetch and not entry.fetches:
        with_files = ", ".join(other.name for other in EXPERIMENTS if other.fetches)
        raise InputError(f"{name} needs no files", where="--fetch", remedy=f"Leave it out; {with_files} need files")
    from riftberg.experiments.changes import BERG, is_file_key  # the list of experiments does without NumPy

    for group, inner in options.changes.items():
        for key in inner:
            path = f"{group}.{key}" if key else group
            if is_file_key(path):
                raise InputError(
                    f"{name} has no experiment file with this key", where=path,
                    remedy="Its parameters can be changed, and thickness, placement, rotation, shift, velocity and spin of berg",
                )  # fmt: skip
    model, info = entry.load()(options)
    berg = {key: value for key, value in options.changes.get(BERG, {}).items() if key not in options.lattice}
    if berg:
        from riftberg.experiments.changes import change_berg

        model = change_berg(model, berg)
    return model, replace(info, notices=(*options.notices, *info.notices))
