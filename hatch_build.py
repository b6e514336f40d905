"""Version of what is built: that of the git tag, and without tag or git the line in ``src/riftberg/version.py``.

Between tags it names the commit: 0.2.0 and three commits make 0.2.0+3.g1a2b3c4. Wheel and sdist carry it in their metadata
and in their own copy of that line. A wheel that is built with ``RIFTBERG_MACHINE_CODE=FOLDER`` also holds the machine code that
``python benchmarks/machine_code.py FOLDER`` has made.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

LINE = re.compile(r'^__version__ = "(.+)"$', flags=re.MULTILINE)
SOURCE = Path("src", "riftberg", "version.py")


def version_of(root: Path) -> str:
    """Return the version of the source in a folder."""
    line = LINE.search((root / SOURCE).read_text("utf-8"))
    if line is None:
        raise ValueError(f"{SOURCE} has no line with __version__")
    # A folder of an archive may lie inside another project's checkout, whose tags are not ours.
    described = _git(root, "describe", "--tags", "--long", "--match", "v[0-9]*") if (root / ".git").exists() else ""
    parts = re.fullmatch(r"v(.+)-(\d+)-(g[0-9a-f]+)", described)
    if parts is None:
        return line[1]
    tag, commits, commit = parts.groups()
    return tag if commits == "0" else f"{tag}+{commits}.{commit}"


def _git(root: Path, *words: str) -> str:
    try:
        done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return ""
    return done.stdout.strip()


class VersionOfMetadata(MetadataHookInterface):
    """Give the metadata their version."""

    PLUGIN_NAME = "custom"

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the version."""
        metadata["version"] = version_of(Path(self.root))


class VersionInside(BuildHookInterface):  # type: ignore[type-arg]
    """Write the version into the copy of ``version.py`` that wheel and sdist carry."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Replace the file unless it is imported from the source, as in an editable installation."""
        if version == "editable":
            return
        self.folder = tempfile.TemporaryDirectory()
        text = (Path(self.root) / SOURCE).read_text("utf-8")
        copy = Path(self.folder.name) / SOURCE.name
        copy.write_text(LINE.sub(f'__version__ = "{self.metadata.version}"', text), "utf-8")
        inside = SOURCE if self.target_name == "sdist" else SOURCE.relative_to("src")
        build_data["force_include"][str(copy)] = inside.as_posix()
        code = os.environ.get("RIFTBERG_MACHINE_CODE")
        if code and self.target_name == "wheel":
            build_data["force_include"][str(Path(code).resolve())] = "riftberg/compiled/machine_code"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the copy."""
        if version != "editable":
            self.folder.cleanup()
