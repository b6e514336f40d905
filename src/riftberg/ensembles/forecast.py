"""A forecast: an experiment with errors of all that is not known exactly, as an ensemble with probabilities."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Unpack

from riftberg.config.values import check_names, number
from riftberg.ensembles.distributions import PLANS, POINTS
from riftberg.ensembles.sweep import MEMBER, Plan, SweepOptions, common_options, make_plan, read_draws, run_plan
from riftberg.ensembles.vary import Draws, Varied, read_varied, vary_with_file
from riftberg.errors import InputError, RiftbergError
from riftberg.experiments.registry import EXPERIMENTS, Options

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.ensembles.member import Maker


class DefaultError(NamedTuple):
    """One line of the table of a forecast's default errors."""

    text: str
    vary: tuple[str, ...]
    source: str


DEFAULTS: Final = (
    DefaultError("current 0.1 m/s, 50 km, 3 days", (
        "current_error.speed=0.1 m/s", "current_error.length=50 km", "current_error.time=3 day",
    ), "a round number; two products of your region give a lower bound"),
    DefaultError("wind 2 m/s, 300 km, 1 day", (
        "wind_error.speed=2 m/s", "wind_error.length=300 km", "wind_error.time=1 day",
    ), "the speed of ERA5 is off by less than 1.5 m/s (rms) over the Atlantic outside of extremes"),
    DefaultError("thickness 15 %", ("start.thickness~lognormal(1, 15 %)",), "a round number"),
    DefaultError("start 3 km", (
        "start.east~normal(0 km, 3 km)", "start.north~normal(0 km, 3 km)",
    ), "a round number for outlines from images"),
    DefaultError("strength 30 %", (
        "start.strength~lognormal(1, 30 %)",
    ), "a round number; beams of ice from four bergs and a glacier differ significantly in their mean strength"),
)  # fmt: skip
"""Errors of a forecast. None of them was fitted; most are round numbers to start from."""

FLOOR: Final = DefaultError("floor 10 % or 30 m, 10 km", (
    "floor_error.share=0.1", "floor_error.spread=30 m", "floor_error.length=10 km",
), "a round number. Of depths from altimetry, where nobody has sounded, half are off by less than 49 m")  # fmt: skip
"""Left out where the ocean of a built-in experiment is a formula: its floor was fitted to a grounding, and is no chart."""

LATTICE: Final = DefaultError("lattice rotated and shifted", (
    "berg.lattice_angle~uniform(0, 90)", "berg.offset~uniform(0, 1)",
), "numbers that depend on the lattice show it in their spread")  # fmt: skip
"""Where the berg of the experiment takes another lattice."""

MEMBERS: Final = 200
"""Members, unless another number is given."""


def product_members(experiment: object, data: Path | None = None) -> dict[str, int]:
    """Return of how many members the files of an experiment give a quantity, by its canonical name."""
    from riftberg.experiments.yaml_file import read_file
    from riftberg.ocean.files_forcing import count_members
    from riftberg.ocean.files_schema import FileForcing

    try:
        forcing = read_file(Path(str(experiment)), data=data)[0].forcing
        if not isinstance(forcing, FileForcing):
            return {}
        return count_members(forcing, data or Path(str(experiment)).parent)
    except RiftbergError:  # said where the experiment is built, with the options that it is built with
        return {}


def default_errors(experiment: object, data: Path | None = None) -> tuple[DefaultError, ...]:
    """Return the errors of an experiment's forecast; ``data``: folder of its files.

    A product with members of its own shows its error by them, so no random error is put on top.
    """
    name = str(experiment)
    from_yaml = isinstance(experiment, str | Path) and name.endswith((".yaml", ".yml"))
    count = product_members(experiment, data) if from_yaml else {}
    random = [error for error, quantities in zip(DEFAULTS, (("uo",), ("ua", "taux")), strict=False)
              if any(quantity in count for quantity in quantities)]  # fmt: skip
    products: tuple[DefaultError, ...] = ()
    if count:
        most = max(count.values())
        products = (DefaultError(
            f"{most} members of the products in turn", (f"forcing.member~each({', '.join(map(str, range(most)))})",),
            "the ensemble of the product",
        ),)  # fmt: skip
    entry = next((entry for entry in EXPERIMENTS if entry.name == name), None)
    floor = (FLOOR,) if entry is None or entry.fetches else ()
    fixed = (error for error in DEFAULTS if error not in random)
    return (*products, *fixed, *floor, *((LATTICE,) if from_yaml or (entry is not None and entry.lattice) else ()))


def errors_line(varied: Sequence[Varied]) -> str:
    """Return in one line the default errors of a forecast, and its other varied inputs."""
    inputs = {v.name: v.plain() for v in varied}
    descriptions = [f"{len(v.distribution.choices if v.distribution else v.values)} members of the products in turn"
             for v in varied if v.name == MEMBER]  # fmt: skip
    inputs.pop(MEMBER, None)
    for error in (*DEFAULTS, FLOOR, LATTICE):
        names = {v.name: v.plain() for v in read_varied(error.vary)}
        if names.items() <= inputs.items():
            descriptions.append(error.text)
            inputs = {name: value for name, value in inputs.items() if name not in names}
    return "Errors: " + "; ".join([*descriptions, *inputs])


def forecast_plan(
    experiment: str | Path | Maker, vary: Mapping[str, Any] | Iterable[str], options: Options, every_hours: float | None,
    draws: Draws, *, defaults: bool = True, cells: float | None = None,
) -> Plan:  # fmt: skip
    """Return the plan of a forecast."""
    if draws.plan in POINTS:
        raise InputError(
            f"{draws.plan!r} draws for a sensitivity: its members have no probability", where="plan",
            remedy=f"Use {', '.join(plan for plan in PLANS if plan not in POINTS)}, or riftberg sensitivity",
        )  # fmt: skip
    merged = forecast_errors(experiment, vary, defaults=defaults, data=options.data)
    drawn = Draws(draws.number or MEMBERS, draws.plan, draws.seed)
    return make_plan(experiment, merged, options, every_hours, cells, drawn, forecast=True)


def forecast_errors(
    experiment: object, vary: Mapping[str, Any] | Iterable[str], *, defaults: bool = True, data: Path | None = None
) -> dict[str, Any]:
    """Return the varied inputs of a forecast: the user's first, then those of the file, then the default errors."""
    given = vary_with_file(experiment, vary, data)
    standard = {
        v.name: v.plain()
        for error in (default_errors(experiment, data) if defaults else ())
        for v in read_varied(error.vary)
    }
    return {**standard, **given}


def forecast(
    experiment: str | Path | Maker,
    vary: Mapping[str, Any] | Iterable[str] = (),
    *,
    days: float | str | None = None,
    every_hours: float | str | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    progress: bool = False,
    default_errors: bool = True,
    **options: Unpack[SweepOptions],
) -> xr.Dataset:
    """Run an experiment as an ensemble with errors of ocean, air, floor, start and ice, and return probabilities.

    Parameters
    ----------
    experiment : str, path or callable
        As for `riftberg.sweep`.
    vary : mapping, or iterable of str, optional
        Inputs to vary beside, or instead of, the default errors of a forecast (`riftberg.ensembles.forecast.DEFAULTS`).
    days, every_hours, output, resume, progress
        As for `riftberg.sweep`.
    default_errors : bool, optional
        Add the default errors of a forecast.
    **options
        As for `riftberg.sweep`; ``members`` is 200 by default.

    Returns
    -------
    xarray.Dataset
        The result of a sweep with probabilities, see "The file of an ensemble" in the documentation.

    Raises
    ------
    InputError
        If an input cannot be varied; before the first run.
    """
    check_names(options, SweepOptions)
    every = None if every_hours is None else number(every_hours, "h", where="every_hours")
    plan = forecast_plan(
        experiment, vary, common_options(days, options), every, read_draws(options), defaults=default_errors,
        cells=options.get("cells"),
    )  # fmt: skip
    return run_plan(plan, output, resume, progress, options)
