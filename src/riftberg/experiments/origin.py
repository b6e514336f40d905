"""What a run and a sweep keep of the command that made them, so that ``riftberg rerun`` can make them again."""

from __future__ import annotations

import json
import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from riftberg.runs.layout import COMMAND, FILE, PLACE


def origin(
    experiment: str, words: Sequence[str], settings: Sequence[str], data: Path | None, folder: Path
) -> dict[str, str]:
    """Return the attributes of a file in a folder: the command, the experiment file if there is one, and where its data are.

    ``words``: options of the command; ``settings``: what is set besides, as ``group.name=value``.
    """
    path = Path(experiment)
    told = [part for setting in settings for part in ("--set", setting)]
    found = {COMMAND: shlex.join(["riftberg", "run", path.name, *words, *told])}
    home = data
    if path.suffix in (".yaml", ".yml"):
        found[FILE], home = path.read_text("utf-8-sig"), home or path.parent
    if home is not None:
        found[PLACE] = os.path.relpath(home.resolve(), folder.resolve())
    return found


def setting(name: str, value: Any) -> str:
    """Return ``name=value`` as ``--set`` reads it again with the same digits."""
    if isinstance(value, float):
        return f"{name}={int(value)}" if value.is_integer() else f"{name}={value!r}"
    return f"{name}={value if isinstance(value, str) else json.dumps(value)}"


def settings_of(changes: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return changes by group and name as ``--set`` takes them; a group without a name is a key of the file by itself."""
    return [
        setting(f"{group}.{name}" if name else group, value)
        for group, values in changes.items()
        for name, value in values.items()
    ]
