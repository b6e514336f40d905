"""Which input matters: Morris effects and Sobol' indices of results that every member has, rank correlations of the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
import xarray as xr

from riftberg.config.values import check_names
from riftberg.ensembles.distributions import POINTS
from riftberg.ensembles.forecast import forecast_errors
from riftberg.ensembles.result import variable_name
from riftberg.ensembles.sweep import SweepOptions, sweep
from riftberg.ensembles.uncertain import SEED
from riftberg.errors import InputError
from riftberg.state import Floats
from riftberg.system.input_files import value_shown

if TYPE_CHECKING:
    from riftberg.ensembles.member import Maker

METHODS: Final = {"morris": "morris", "sobol": "saltelli"}
"""Plan of each method."""

USUAL_DRAWS: Final = {"morris": 16, "sobol": 64}

LEVEL: Final = 0.9
"""Of the intervals."""

BOOTSTRAPS: Final = 1000

WIDE: Final = 0.2
"""Width of an interval of a total index from which on its digits mean nothing."""

DAY: Final = np.timedelta64(1, "D")


class Result(NamedTuple):
    """One number of each member."""

    values: Floats  # NaN where a member has none
    unit: str
    partial: bool = False  # Not all members that come to their end have one


def select_results(ds: xr.Dataset, at_days: Iterable[float] = ()) -> dict[str, Result]:
    """Return the results of the members of a sweep by name; by default by the middle and the end of the runs."""
    first, length = ds["time"].values[0], float((ds["time"].values[-1] - ds["time"].values[0]) / DAY)
    # Days count from the own start of each member.
    after = ds["start_after"].values / 86400.0 if "start_after" in ds.coords else np.zeros(ds.sizes["member"])
    finished = ds["status"].values == 0

    def days(dates: Any) -> Floats:
        return np.asarray(((dates - first) / DAY).T - after, float).T

    results = {"largest stress over strength": Result(ds["stress_ratio"].values, "1")}
    if late := [day for day in at_days if not 0.0 < day <= length + 1e-6]:
        raise InputError(f"day {late[0]:g} of runs of {length:g} days", where="at_days", remedy="Give days of the runs")
    for day in sorted(at_days) or (0.5 * length, length):
        for word, name in (("broken", "first_breakup"), ("aground", "first_aground")):
            # No date is later than any: a member that never breaks counts as whole.
            results[f"{word} by day {day:g}"] = Result(np.where(finished, days(ds[name].values) <= day, np.nan), "1")
    results["largest area at the end"] = Result(ds["largest_area"].values / 1e6, "km2")
    results["date of the first break-up"] = Result(days(ds["first_breakup"].values), "day", partial=True)
    born = np.where(ds["fragment_parent"].values > 0, days(ds["fragment_birth_time"].values), np.inf)
    if born.size:
        earliest = born.argmin(axis=1)
        for name in ("lon", "lat") if "lat" in ds else ("x", "y"):
            position = ds[f"fragment_{name}"].values[np.arange(earliest.size), earliest]
            broke = np.where(np.isfinite(born.min(axis=1)), position, np.nan)
            results[f"{name} of the first break-up"] = Result(broke, "degree" if "lat" in ds else "m", partial=True)
    return results


def indices(ds: xr.Dataset, results: Mapping[str, Result], *, seed: int = 1) -> xr.Dataset:
    """Return the sensitivity of results to the inputs of a sweep that was drawn by a plan for it.

    A draw in which a member failed counts in nothing. Intervals are of 90 %, from drawing the draws anew.
    """
    plan = ds.attrs.get("plan")
    if plan not in POINTS:
        raise InputError("members that were not drawn for it", where="sensitivity", remedy="Run riftberg sensitivity")
    names = [str(name) for name in ds.coords if "distribution" in ds[name].attrs]
    fields = variable_name(SEED)
    names += [fields] if fields in ds.coords and fields not in names else []
    size = len(names) + POINTS[plan]
    used = ds.sizes["member"] // size * size
    inputs = {name: _numbers(ds[name].values) for name in names}
    x = np.stack([values[:used].reshape(-1, size) for values in inputs.values()])
    random = np.random.default_rng(seed)
    out = xr.Dataset(attrs={"plan": plan, "interval": f"bootstrap, {100 * LEVEL:.0f} %", "draws": used // size})
    out.coords["result"] = ("result", list(results))
    out.coords["unit"] = ("result", [result.unit for result in results.values()])
    out.coords["input"] = ("input", [str(ds[name].attrs.get("parameter", "random fields")) for name in names])
    tables: dict[str, Floats] = {}
    for k, result in enumerate(results.values()):
        f = result.values[:used].reshape(-1, size)
        draws = np.flatnonzero(np.isfinite(f).all(axis=1))
        finite = np.isfinite(result.values)
        row: dict[str, Any] = {
            "share": finite.sum() / max((ds["status"].values == 0).sum(), 1),
            "spread": result.values[finite].std() if finite.any() else np.nan,
            "number": finite.sum() if result.partial else draws.size,
        }  # fmt: skip
        if result.partial:
            row |= _correlations(inputs, result.values, size, random)
        elif draws.size > 1:
            row |= _effects(f[draws], x[:, draws], random) if plan == "morris" else _sobol(f[draws], random)
        for name, value in row.items():
            shape = (len(results), len(names))[: 1 + np.ndim(value)]
            tables.setdefault(name, np.full(shape, np.nan))[k] = value
    for name, table in tables.items():
        about = {"long_name": ABOUT.get(name, f"end of the interval of {name.rpartition('_')[0]}")}
        out[name] = (("result", "input")[: table.ndim], table, about)
    out.attrs["note"] = _width_note(out)
    return out


def _width_note(sensitivities: xr.Dataset) -> str:
    """Return a sentence where total indices are too uncertain for more than an order of the inputs, else nothing."""
    if "total" not in sensitivities:
        return ""
    width = float((sensitivities["total_high"] - sensitivities["total_low"]).max())
    if not width > WIDE:
        return ""
    return f"90 % intervals of total indices are up to {width:.2g} wide: read the order of the inputs, or add draws"


ABOUT: Final = {
    "share": "part of the members that have the result",
    "number": "draws that count; members for rank correlations",
    "spread": "standard deviation of the result over all members",
    "effect": "mean absolute change of the result where the input moves by 40 % of its distribution",
    "signed_effect": "mean change where it rises",
    "scatter": "standard deviation of that change: by other inputs, or where the result is not linear",
    "first": "first-order index: part of the variance from the input alone",
    "total": "total index: part of the variance from the input with all others",
    "correlation": "Spearman's rank correlation over the members that have the result",
}
"""Meaning of the numbers; those with an interval have ``_low`` and ``_high`` beside them."""


def _numbers(values: Any) -> Floats:
    """Return an input as numbers; words by their order."""
    return np.asarray(values if values.dtype.kind in "fiu" else np.unique(values, return_inverse=True)[1], float)


def _bounds(name: str, drawn: Floats) -> dict[str, Any]:
    low, high = np.nanquantile(drawn, [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0], axis=0)
    return {f"{name}_low": low, f"{name}_high": high}


def _effects(f: Floats, x: Floats, random: np.random.Generator) -> dict[str, Any]:
    """Return Morris' measures of results (draws, 1 + inputs); ``x``: the inputs (inputs, draws, 1 + inputs)."""
    change = f[:, 1:] - f[:, :1]
    rise = np.sign(np.einsum("idi->di", x[:, :, 1:]) - x[:, :, 0].T)
    drawn = np.abs(change)[random.integers(0, len(f), (BOOTSTRAPS, len(f)))].mean(axis=1)
    return {
        "effect": np.abs(change).mean(axis=0), **_bounds("effect", drawn),
        "signed_effect": (change * rise).mean(axis=0), "scatter": (change * rise).std(axis=0, ddof=1),
    }  # fmt: skip


def _sobol(f: Floats, random: np.random.Generator) -> dict[str, Any]:
    """Return first-order (Saltelli and others 2010) and total indices (Jansen 1999) of results (draws, inputs + 2)."""

    def estimates(g: Floats) -> tuple[Floats, Floats]:  # g: (..., draws, inputs + 2)
        g = g - g[..., [0, -1]].mean(axis=(-2, -1), keepdims=True)  # a mean far from 0 would be noise in the products
        # A result that is the same for all members has no variance to divide: all indices are 0.
        variance = np.maximum(g[..., [0, -1]].var(axis=(-2, -1)), 1e-300)[..., None]
        first, turned, second = g[..., :1], g[..., 1:-1], g[..., -1:]
        first_order = (second * (turned - first)).mean(axis=-2) / variance
        return first_order, 0.5 * ((turned - first) ** 2).mean(axis=-2) / variance

    first, total = estimates(f)
    drawn = estimates(f[random.integers(0, len(f), (BOOTSTRAPS, len(f)))])
    return {"first": first, **_bounds("first", drawn[0]), "total": total, **_bounds("total", drawn[1])}


def _correlations(x: Mapping[str, Floats], y: Floats, size: int, random: np.random.Generator) -> dict[str, Any]:
    """Return rank correlations of inputs with a result that some members have; ``size``: members of a draw."""
    from scipy.stats import rankdata

    finite = np.isfinite(y)
    draws = np.unique(np.flatnonzero(finite) // size)
    if draws.size < 4:
        return {}

    def rho(rows: Any) -> Floats:
        ranks = np.stack([rankdata(values[rows]) for values in (*x.values(), y)])
        ranks -= ranks.mean(axis=1, keepdims=True)
        length = np.maximum(np.sqrt((ranks**2).sum(axis=1)), 1e-300)
        return np.asarray((ranks[:-1] @ ranks[-1]) / (length[:-1] * length[-1]))

    # Members of one draw differ in one input, so that whole draws are drawn anew.
    members = [np.flatnonzero(finite[k * size : (k + 1) * size]) + k * size for k in draws]
    again = random.integers(0, draws.size, (BOOTSTRAPS // 5, draws.size))
    drawn = np.stack([rho(np.concatenate([members[k] for k in row])) for row in again])
    return {"correlation": rho(np.flatnonzero(finite)), **_bounds("correlation", drawn)}


def sensitivity(
    experiment: str | Path | Maker,
    vary: Mapping[str, Any] | Iterable[str] = (),
    *,
    method: Literal["morris", "sobol"] = "morris",
    at_days: Iterable[float] = (),
    results: Mapping[str, Callable[[xr.Dataset], Any]] | None = None,
    default_errors: bool = True,
    **options: Any,
) -> xr.Dataset:
    """Run an experiment with its inputs varied, and return how much each of them matters.

    Parameters
    ----------
    experiment : str, path or callable
        As for `riftberg.sweep`.
    vary : mapping, or iterable of str, optional
        Distributions beside, or instead of, the errors of a forecast, as for `riftberg.forecast`.
    method : {"morris", "sobol"}, optional
        Morris' effects, for a first look at many inputs, or Sobol' indices, parts of the variance.
    at_days : iterable of float, optional
        Days by which is asked whether the berg is broken and aground; by default the middle and the end of the runs.
    results : mapping, optional
        Further results by name: functions that take the result of the sweep and return one number for each member.
    default_errors : bool, optional
        Vary the default errors of a forecast too.
    **options
        As for `riftberg.sweep`. ``members`` is the number of draws: with d inputs, d + 1 runs each for ``morris`` (16 draws by
        default), d + 2 for ``sobol`` (64).

    Returns
    -------
    xarray.Dataset
        Dimensions ``result`` and ``input``. For ``morris`` ``effect``, ``signed_effect`` and ``scatter``, for ``sobol``
        ``first`` and ``total``; for dates and places of a break-up ``correlation`` over the ``share`` of members that have it.
        With ``_low`` and ``_high`` of 90 % intervals.

    Raises
    ------
    InputError
        If an input cannot be varied; before the first run.
    """
    if method not in METHODS:
        raise InputError(f"{method!r} is no method", where="method", remedy=f"Use {' or '.join(METHODS)}")
    check_names({k: v for k, v in options.items() if k in SweepOptions.__annotations__}, SweepOptions)
    merged = forecast_errors(experiment, vary, defaults=default_errors)
    options = {"members": USUAL_DRAWS[method], **options, "plan": METHODS[method]}
    ds = sweep(experiment, merged, **options)
    all_results = select_results(ds, at_days)
    for name, function in (results or {}).items():
        values = np.asarray(function(ds))
        if values.shape != (ds.sizes["member"],) or values.dtype.kind not in "fiub":
            raise InputError(
                f"the function of {name!r} returns {value_shown(function(ds))}", where="results",
                remedy=f"Return one number for each of the {ds.sizes['member']} members, in their order",
            )  # fmt: skip
        all_results[name] = Result(values.astype(float), "1")
    return indices(ds, all_results)
