"""Whether the client of a service will find a login, in the places where that client itself looks.

Nothing is sent or kept; user names and passwords are looked at only for being there. Without this the clients would ask
at the terminal, or fail late and in words of their own.
"""

from __future__ import annotations

import base64
import configparser
import netrc
import os
from pathlib import Path
from typing import Literal

from riftberg.errors import ForcingError

EARTHDATA_HOST = "urs.earthdata.nasa.gov"
COPERNICUS_HOSTS = ("auth.marine.copernicus.eu", "nrt.cmems-du.eu", "my.cmems-du.eu")
"""Machines of a ``.netrc`` that copernicusmarine takes; the last two only in its older versions."""


def earthdata() -> Literal["environment", "netrc"]:
    """Return the way in which earthaccess will log in."""
    if _set("EARTHDATA_TOKEN") or _set("EARTHDATA_USERNAME", "EARTHDATA_PASSWORD"):
        return "environment"
    path = Path(os.environ.get("NETRC") or _netrc_at_home())
    if _in_netrc(path, EARTHDATA_HOST):
        return "netrc"
    raise missing_login(
        "NASA Earthdata",
        "Make a free account at https://urs.earthdata.nasa.gov, then put it in ~/.netrc "
        f"(machine {EARTHDATA_HOST}) or in EARTHDATA_USERNAME and EARTHDATA_PASSWORD, or a token in EARTHDATA_TOKEN",
    )


def copernicus() -> None:
    """Raise `ForcingError` if copernicusmarine would find no login: variables, its own file, ``.netrc``."""
    if _set("COPERNICUSMARINE_SERVICE_USERNAME", "COPERNICUSMARINE_SERVICE_PASSWORD"):
        return
    # The client takes the first of these files that exists, and asks at the terminal if that one holds no login.
    folder = Path(os.environ.get("COPERNICUSMARINE_CREDENTIALS_DIRECTORY") or Path.home())
    own = folder / ".copernicusmarine" / ".copernicusmarine-credentials"
    if _in_copernicus_file(own) if own.exists() else _in_netrc(_netrc_at_home(), *COPERNICUS_HOSTS):
        return
    raise missing_login(
        "Copernicus Marine",
        "Make a free account at https://data.marine.copernicus.eu, then run: copernicusmarine login",
    )


def climate_data_store() -> None:
    """Raise `ForcingError` if cdsapi would find no address and key in its variables and ``~/.cdsapirc`` together."""
    path = Path(os.environ.get("CDSAPI_RC") or Path.home() / ".cdsapirc")
    lines = path.read_text().splitlines() if path.is_file() else []
    keys = {name.strip() for name, colon, value in (line.partition(":") for line in lines) if colon and value.strip()}
    lacking = [name for name in ("url", "key") if name not in keys and not _set(f"CDSAPI_{name.upper()}")]
    if lacking:
        lacking_text = f"; {path} lacks {' and '.join(lacking)}" if path.is_file() else ""
        raise missing_login(
            "the Climate Data Store",
            "Make a free account at https://cds.climate.copernicus.eu and write the two lines url and key, which its page "
            "'how to api' shows, to ~/.cdsapirc",
            lacking_text,
        )


def missing_login(service: str, remedy: str, detail: str = "") -> ForcingError:
    """Return the error that says that a service wants a login and how to come by one."""
    return ForcingError(f"{service} wants a login and none was found{detail}", where="fetch", remedy=remedy)


def _set(*names: str) -> bool:
    """Tell whether all of these variables of the environment hold something."""
    return all(os.environ.get(name) for name in names)


def _netrc_at_home() -> Path:
    return Path.home() / ("_netrc" if os.name == "nt" else ".netrc")


def _in_netrc(path: Path, *machines: str) -> bool:
    """Tell whether a ``.netrc`` holds user name and password for one of these machines."""
    if not path.is_file():
        return False
    try:
        hosts = netrc.netrc(path).hosts
    except (netrc.NetrcParseError, UnicodeDecodeError) as error:
        remedy = "Mend that line, or give the login in variables of the environment"
        raise ForcingError(f"cannot be read ({error})", where=str(path), remedy=remedy) from error
    entries = [hosts[machine] for machine in machines if machine in hosts]
    return any(user and password for user, _, password in entries)


def _in_copernicus_file(path: Path) -> bool:
    """Tell whether the file that ``copernicusmarine login`` writes (base64 of an INI file) holds both."""
    kept = configparser.RawConfigParser()
    try:
        kept.read_string(base64.standard_b64decode(path.read_text()).decode())
    except (OSError, ValueError, configparser.Error):
        return False
    return all(kept.get("credentials", name, fallback="") for name in ("username", "password"))
