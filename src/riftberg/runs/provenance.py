"""What every file of a run says about its origin: versions, parameters, forcing, seed and what to cite."""

from __future__ import annotations

import json
import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from riftberg.version import __version__

if TYPE_CHECKING:
    from riftberg.model import BareModel

HUTH_2022 = (
    "Huth, A., Adcroft, A., Sergienko, O. and Khan, N. (2022): Ocean currents break up a tabular iceberg. "
    "Science Advances 8, eabq6974. https://doi.org/10.1126/sciadv.abq6974"
)
"""The model that Riftberg implements."""

LIBRARIES = ("numpy", "numba", "xarray", "netCDF4", "pydantic")


def library_versions() -> dict[str, str]:
    """Return the versions of Riftberg, Python and the libraries that decide on numbers."""
    versions = {"riftberg": __version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "unknown"
    return versions


def forcing_text(forcing: Any) -> str:
    """Return what the forcing says of itself, or nothing where it is silent."""
    describe = getattr(forcing, "describe", None)
    return str(describe()) if callable(describe) else ""


def forcing_title(forcing: Any) -> str:
    """Return the short name of the forcing for titles: its ``title``, else the first line of its description."""
    title = getattr(forcing, "title", "")
    text = str(title() if callable(title) else title).strip()
    return text or next((line.strip() for line in forcing_text(forcing).splitlines() if line.strip()), "")


def citations(model: BareModel) -> list[str]:
    """Return the works to cite for this run: the model, and the data products that the forcing names."""
    return [HUTH_2022, *(str(text) for text in getattr(model.forcing, "citations", ()))]


def run_attributes(model: BareModel, *, experiment: str = "", seed: int | None = None) -> dict[str, Any]:
    """Return global attributes that let another person understand and repeat the run."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "title": f"Drift and break-up of bonded icebergs: {experiment or 'run'}",
        "experiment": experiment,
        "source": f"Riftberg {__version__}",
        "history": f"{now} written by Riftberg {__version__}",
        "date_created": now,
        "references": "\n".join(citations(model)),
        "start": model.start.isoformat(),
        "forcing": forcing_text(model.forcing),
        "forcing_title": forcing_title(model.forcing),
        "parameters": model.parameters.describe(),
        "parameters_json": model.parameters.model_dump_json(),
        "versions_json": json.dumps(library_versions()),
        "seed": "none" if seed is None else str(seed),
    }
