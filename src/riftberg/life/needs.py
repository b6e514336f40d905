"""What melt needs to know of the sea; a run without it is refused before its first step."""

from __future__ import annotations

from riftberg.errors import InputError
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import Parameters


def check_water(forcing: Forcing, p: Parameters) -> None:
    """Refuse melt without a temperature, or without a salinity where the law of the base needs one.

    Runs with the reference's numerics take what their driver hands over.
    """
    melt = p.melt
    if not melt.enabled or melt.zero_rates or p.compatibility.zero_start:
        return
    known = provided(forcing)
    missing = []
    if melt.temperature is None and "sst" not in known:
        missing.append(("temperature", "sst", "melt.temperature"))
    needs_salt = melt.base != "turbulent" and melt.mode != "berg" and melt.salinity_from_ocean
    if needs_salt and melt.salinity is None and "sss" not in known:
        missing.append(("salinity", "sss", "melt.salinity"))
    if missing:
        what = " and no ".join(name for name, _, _ in missing)
        fields = " and ".join(field for _, field, _ in missing)
        numbers = " and ".join(number for _, _, number in missing)
        raise InputError(
            f"bergs are to melt, but there is no {what} of the sea",
            where=f"forcing: {forcing.describe()}",
            remedy=f"Give files with {fields}, or numbers: {numbers}; or set melt.enabled = false",
        )


def provided(forcing: Forcing) -> frozenset[str]:
    """Return which variables around the elements a forcing knows; empty where it does not say."""
    return frozenset(getattr(forcing, "provides", ()))
