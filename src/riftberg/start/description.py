"""A run in plain words: its heading, what should be known of it before it starts, and its parameters."""

from __future__ import annotations

import numpy as np

from riftberg.config.usual_ranges import unusual
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.reserves import reserve_lines
from riftberg.engines.common.rift_tips import rift_notices
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.slenderness import narrow_warning
from riftberg.engines.schemes import resonance_warning
from riftberg.life.coming import coming_text
from riftberg.ocean.floor_notices import floor_notices


def heading(run: RunState) -> list[str]:
    """Return date, step and size of a run, a line each."""
    p = run.parameters
    return [
        f"Model at {run.date:%Y-%m-%d %H:%M}, step {run.step_number} of {p.time_step:g} s "
        f"({run.substeps} sub-steps, scheme {p.stepping.scheme})",
        f"  {run.elements.mass.size} elements, {run.bonds.first.size} bonds, {run.bonds_broken} broken",
        *([f"  {text}"] if (text := coming_text(run.remembered, run.start)) else []),
    ]


def describe_run(run: RunState, notices: tuple[str, ...], step_reason: str) -> str:
    """Return heading, notices, forcing, ice and parameters of a run; ``step_reason``: why its time step was chosen."""
    from riftberg.life.edges import EdgeIce, front_lines  # with shapely, half a second

    e, p = run.elements, run.parameters
    names = {row.number: row.name for row in run.fragments.rows}
    if not names:  # before the first step
        begins = np.cumsum([0, *(count for _, count in run.fragments.bergs)])
        names = {int(e.berg[k]): name for k, (name, _) in zip(begins, run.fragments.bergs, strict=False)}
    fronts = front_lines(EdgeIce(e.lon, e.lat, e.length, e.width, e.thickness), e.berg, p)
    reserves = reserve_lines(e.berg, e.thickness, e.length * e.width, names, p)
    return "\n".join(
        [
            *heading(run),
            *([f"  time step of {p.time_step:g} s: {step_reason}"] if step_reason else []),
            *(f"  notice: {text}" for text in notices),
            f"  forcing: {run.forcing.describe()}",
            *(f"  ice: {text}" for text in (*fronts, *reserves)),
            p.describe(),
        ]
    )


def list_notices(run: RunState) -> tuple[str, ...]:
    """Return what should be known of a run with these parameters, a sentence each."""
    bonds, elements, p = run.bonds, run.elements, run.parameters
    single = (sea_level_notice(run), resonance_warning(elements, bonds, p), narrow_warning(elements, p))
    return (
        *filter(None, single),
        *rift_notices(elements, bonds, p),
        *floor_notices(run.forcing, elements, p, placed=run.step_number == 0),
        *find_unusual(run).values(),
    )


def sea_level_notice(run: RunState) -> str:
    """Return what is assumed of the sea level where no data give one, with a figure for the largest berg; else nothing."""
    if not (run.forcing.assumes_slope or run.forcing.level_gaps):
        return ""
    from riftberg.ocean.balance import slope_notice

    body, bonds = run.elements.body, run.bonds
    component = connected_parts(body.id.size, bonds.first, bonds.second, bonds.status)
    areas = np.bincount(component, weights=body.length * body.width)
    largest = np.flatnonzero(component == areas.argmax()) if areas.size else component
    return slope_notice(run.forcing, run.elements, largest, run.parameters)


def find_unusual(run: RunState) -> dict[str, str]:
    """Return what lies outside its usual range or has no effect, a sentence for each name."""
    return unusual(run.parameters, run.elements, run.forcing, placed=run.step_number == 0)
