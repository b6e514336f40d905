"""Variables of any name: which files of an experiment, or of a command line, hold what ``--names`` names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riftberg.errors import InputError, nearest
from riftberg.system.input_files import in_folder

if TYPE_CHECKING:
    from riftberg.products.registry import Choice


def as_named(files: Sequence[str], product: str | None, names: str | None) -> tuple[Sequence[str], dict[str, Choice]]:
    """Return the files that patterns name, and for each the product and those of the names that it holds."""
    if not names:
        return files, dict.fromkeys(files, product)
    from riftberg.products.reading import open_raw
    from riftberg.products.registry import choice_of, expand

    if not files:
        raise InputError(
            "no files were named", where="--names", remedy="Name them in the experiment file: names: {uo: u}"
        )
    pairs = [part.partition("=") for part in names.split(",")]
    asked = {key.strip(): name.strip() for key, _, name in pairs}
    choice_of(None, asked, where="--names")
    files = expand(files)
    held = {file: set(map(str, open_raw(file, chunked=False).variables)) for file in files}
    if missing := set(asked.values()) - set().union(*held.values()):
        everything = sorted(set().union(*held.values()))
        remedy = f"{nearest(min(missing), everything)}They hold {', '.join(everything)}"
        raise InputError(f"no file has a variable {min(missing)!r}", where="--names", remedy=remedy)
    own = {file: {key: name for key, name in asked.items() if name in held[file]} for file in files}
    return files, {file: choice_of(product, own[file], where="--names") for file in files}


def named_files(experiment: str, names: str, data: Path | None) -> tuple[Any, ...]:
    """Return the files of an experiment with the variables that are named; a product or names of its own stay."""
    from riftberg.experiments.yaml_file import read_file
    from riftberg.ocean.files_schema import FileForcing

    forcing = read_file(Path(experiment))[0].forcing if experiment.endswith((".yaml", ".yml")) else None
    if not isinstance(forcing, FileForcing):
        raise InputError(
            "the forcing has no files", where="--names", remedy="It is for experiment files with kind: files"
        )
    folder = data or Path(experiment).parent
    own = [in_folder(folder, entry.file) for entry in forcing.entries]
    known = {
        file: entry.choice for file, entry in zip(own, forcing.entries, strict=True) if entry.product or entry.names
    }
    free = [file for file in own if file not in known]
    files, choices = as_named(free, None, names)
    return entries_of([*known, *files], known | choices)


def entries_of(files: Sequence[str], choices: Mapping[str, Choice]) -> tuple[Any, ...]:
    """Return files as an experiment has them, each with its product or names."""
    from riftberg.ocean.files_schema import NamedFiles

    # A product that is not known is refused where the files are opened, as in a run.
    return tuple(NamedFiles.chosen(in_folder(Path.cwd(), file), choices[file]) for file in files)
