"""A forecast after new sightings: its members are weighted by them, and drawn anew where too few of them count."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any, Final

import numpy as np
import xarray as xr

from riftberg.diagnostics.observed import Observations
from riftberg.ensembles.probability import effective
from riftberg.ensembles.sweep import WEIGHTS, Plan, Store
from riftberg.ensembles.vary import Varied
from riftberg.errors import InputError
from riftberg.state import Floats
from riftberg.system.atomic_files import write_text
from riftberg.verification.positions import AZIMUTH_ERROR
from riftberg.verification.sightings import DAY, away_from, check_dates, sightings_of, start_of, times_of, turned_from

FEWEST: Final = 1.0 / 3.0
"""Part of the members that has to count; below it they are drawn anew."""

KERNEL: Final = 0.3
"""Width of the kernel of Liu and West (2001), in standard deviations of the members."""

FARTHEST: Final = 10.0
"""Distance of a sighting from all members, in standard deviations of its error, beyond which weights say nothing."""


def log_likelihood(
    ds: xr.Dataset, observed: Observations | None, *, error: float, berg: str | None = None, hour: float | None = None,
    broken: datetime | None = None, whole_until: datetime | None = None, doubt: float = 0.05,
    azimuth_error: float | None = AZIMUTH_ERROR,
) -> Floats:  # fmt: skip
    """Return the logarithm of the probability of all sightings for each member; NaN for one that failed.

    ``error``: standard deviation of a position along each axis, km; ``azimuth_error``: of a long axis, degrees, none to leave
    axes out; ``doubt``: probability that it was wrongly seen whole or broken. Sightings are independent of each other.
    """
    check_dates(broken, whole_until)
    times = times_of(ds)
    found = np.where(ds["status"].values == 0, 0.0, np.nan)
    if not np.isfinite(found).any():
        raise InputError("no member came to its end", where="update", remedy="Look at the reasons in sweep.json")
    count = 0
    _, sightings = ("", []) if observed is None else sightings_of(observed, berg, start_of(ds), hour)
    for seen in sightings:
        if not times[0] <= np.datetime64(seen.when, "ns") <= times[-1]:
            continue
        away = away_from(ds, seen.when, seen.place)
        if (nearest := float(np.nanmin(np.hypot(*away.T)))) > FARTHEST * error:
            assert observed is not None
            raise InputError(
                f"on {seen.when:%Y-%m-%d %H:%M} the berg was seen {nearest:,.0f} km from the nearest member, with an error "
                f"of {error:g} km",
                where=str(observed.source),
                remedy="Check place, date and berg; if they are right, give an error that covers it (--error)",
            )
        found -= 0.5 * (away**2).sum(axis=-1) / error**2
        # An ensemble of an earlier version has no axes.
        if azimuth_error is not None and np.isfinite(seen.azimuth) and "azimuth" in ds:
            found -= 0.5 * (turned_from(ds, seen.when, seen.azimuth) / azimuth_error) ** 2
        count += 1
    first = ds["first_breakup"].values.astype("datetime64[ns]")
    for date, was in ((broken, True), (whole_until, False)):
        if date is not None:
            now = np.datetime64(date, "ns")
            if not times[0] <= now <= times[-1] + DAY:
                raise InputError(f"{date:%Y-%m-%d %H:%M} is not within the forecast", where="update")
            right = (~np.isnat(first) & (first <= now)) == was
            found += np.log(np.where(right, 1.0 - doubt, doubt))
            count += 1
    if not count:
        raise InputError("no sighting during the forecast", where="update", remedy="Give positions, or --broken DATE")
    return found


def weighted(store: Store, likelihood: Floats, about: str) -> tuple[Floats, float]:
    """Write the weights of a forecast and the forecast anew; return weights (sum 1) and their effective number."""
    weight = np.exp(likelihood - base_of(store, likelihood.size) - np.nanmax(likelihood))
    weight = np.nan_to_num(weight / np.nansum(weight))
    kept = {"observed": about, "effective": effective(weight), "base": base_of(store, weight.size).tolist(),
            "weight": (weight * np.count_nonzero(np.isfinite(likelihood))).tolist()}  # fmt: skip
    write_text(store.folder / WEIGHTS, json.dumps(kept))
    store.write()
    return weight, effective(weight)


def base_of(store: Store, count: int) -> Floats:
    """Return the logarithm of the probability by which each member was chosen before: 0 unless it was drawn anew."""
    return np.array(store.weights().get("base", [0.0] * count))


def drawn_anew(
    plan: Plan, weight: Floats, likelihood: Floats, *, seed: int = 1
) -> tuple[dict[str, list[Any]], list[float]]:
    """Return inputs of new members around those that count, and the logarithms of the likelihood of their parents.

    Numbers move by the kernel of Liu and West (2001) in the normal scores of their distributions, which keeps mean and
    variance; choices and random fields are those of the parent. A new member counts by its likelihood over its parent's.
    """
    random = np.random.default_rng(seed)
    parents = np.searchsorted(np.cumsum(weight), (np.arange(weight.size) + random.random()) / weight.size).clip(
        0, weight.size - 1
    )
    columns: dict[str, list[Any]] = {name: [plan.members[k][name] for k in parents] for name in plan.members[0]}
    for v in plan.varied:
        if v.distribution is not None and not v.distribution.choices and v.parts == 1:
            columns[v.name] = _moved(v, np.array([values[v.name] for values in plan.members]), parents, weight, random)
    return columns, [float(likelihood[k]) for k in parents]


def _moved(v: Varied, values: Floats, parents: Any, weight: Floats, random: np.random.Generator) -> list[Any]:
    from scipy.stats import norm

    assert v.distribution is not None
    score = norm.ppf(np.clip(v.distribution.shares_below(values), 1e-9, 1.0 - 1e-9))
    mean = weight @ score
    spread = np.sqrt(weight @ (score - mean) ** 2)
    shrunk = mean + np.sqrt(1.0 - KERNEL**2) * (score[parents] - mean)
    return v.distribution.quantiles(norm.cdf(shrunk + KERNEL * spread * random.standard_normal(len(parents))))
