"""Stress in the bonds against the long step, for the explicit and the quasi-static scheme: to what does it converge.

python benchmarks/convergence.py             print the table
python benchmarks/convergence.py --write     also put it into docs/evidence/stress-and-step.md, and draw its figure

The built-in A68a without its shoal and without breaks, while the current loads the finger (19 to 21 December). All runs
are compared, hour by hour and bond by bond, with the quasi-static scheme at its shortest long step. Its ice bears another stress
than the published bonds of the explicit scheme: of these the equilibrium is found here, under the loads of the quasi-static run.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import coo_array, dia_array
from scipy.sparse.linalg import splu
from story import put, table

from riftberg.experiments import Options
from riftberg.experiments.a68a import story_model
from riftberg.runs.model import Model
from riftberg.state import Floats
from riftberg.viz import colours, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE, FIGURE = DOCS / "evidence" / "stress-and-step.md", DOCS / "figures" / "stress-and-long-step.png"
HOURS = range(248, 285)
"""Hours since the start at which stresses are compared; the finger is loaded from 255 on."""

SUBSTEP = 20.0
"""Sub-step of the explicit scheme, s: that of the publication."""

EXPLICIT, QUASI_STATIC = "mts", "quasi_static"
STEPS = {EXPLICIT: (1800.0, 900.0, 450.0, 300.0, 150.0), QUASI_STATIC: (3600.0, 1800.0, 900.0, 450.0)}
"""Long steps that are compared, s."""

EXPLICIT_COLOUR, QUASI_STATIC_COLOUR, SHORT_COLOUR = (
    colours.FRAGMENTS[3],
    colours.FRAGMENTS[1],
    colours.OBSERVED_DAYS[3],
)

TRUTH = 225.0
"""Long step (s) of the quasi-static run that all are compared with."""

NAMES = {EXPLICIT: "explicit (`mts`)", QUASI_STATIC: "`quasi_static`"}


@dataclass(frozen=True)
class Load:
    """Stresses of a run, Pa: ``stress[hour, bond]``, and ``peak[hour]`` the largest of any bond in the last long step."""

    stress: Floats
    peak: Floats

    @property
    def largest(self) -> Floats:
        """Largest tensile stress of any bond by hour, Pa."""
        return self.stress.max(axis=1)


class Beams:
    """The published bonds of a berg (equations 5.4), in equilibrium with the loads that its quasi-static run has found.

    For elements of one thickness and size: extension, slip and bend of each bond are stiff by E H w / l, by this over 2 (1 + nu)
    and by this times w^2 / 12.
    """

    def __init__(self, model: Model) -> None:
        p, el, first, second = model.parameters.bonds, model.elements, model.bonds.first, model.bonds.second
        xy, number = model._stepper.memory.lattice.xy, np.arange(first.size)  # type: ignore[attr-defined]
        width, thickness = float(el.length[0]), float(el.thickness[0])
        away = xy[first] - xy[second]
        nx, ny = (away / np.hypot(*away.T)[:, None]).T
        one, arm = np.ones(first.size), np.full(first.size, 0.5 * width)
        # Rows of extension, slip and bend; columns of the displacements of both ends (m, m, rad).
        entries = (
            (0, first, 0, nx), (0, first, 1, ny), (0, second, 0, -nx), (0, second, 1, -ny),
            (1, first, 0, ny), (1, first, 1, -nx), (1, second, 0, -ny), (1, second, 1, nx),
            (1, first, 2, arm), (1, second, 2, arm), (2, first, 2, one), (2, second, 2, -one),
        )  # fmt: skip
        rows = np.concatenate([3 * number + row for row, *_ in entries])
        columns = np.concatenate([3 * end + freedom for _, end, freedom, _ in entries])
        values = np.concatenate([value for *_, value in entries])
        self._strain = coo_array((values, (rows, columns)), shape=(3 * first.size, 3 * el.size)).tocsr()
        normal = p.youngs_modulus * thickness
        stiffness = np.tile([normal, 0.5 * normal / (1.0 + p.poisson), normal * width**2 / 12.0], first.size)
        matrix = (
            self._strain.T @ dia_array((stiffness[None], [0]), shape=(stiffness.size, stiffness.size)) @ self._strain
        )
        # Springs at one element hold the berg, and bear nothing: its loads are in balance.
        held = np.zeros(3 * el.size)
        held[:3] = [normal, normal, normal * width**2]
        self._factors = splu((matrix + dia_array((held[None], [0]), shape=matrix.shape)).tocsc())
        self._modulus, self._width = p.youngs_modulus / width, width

    def stress(self, model: Model) -> Floats:
        """Tensile stress (Pa) of each bond, at the edge where it is largest."""
        load = model._stepper.memory.state.load  # type: ignore[attr-defined]
        extension, _, bend = (self._strain @ self._factors.solve(load.ravel())).reshape(-1, 3).T
        return np.asarray(self._modulus * (extension + 0.5 * self._width * np.abs(bend)))


def loaded(scheme: str, step: float) -> Load:
    """Run the berg and take the stresses of all published bonds at each of the hours."""
    stepping: dict[str, Any] = {"scheme": scheme, "time_step": step}
    if scheme == EXPLICIT:
        stepping["substeps"] = round(step / SUBSTEP) or 1
    changes = {"stepping": stepping, "fracture": {"enabled": False}}
    options = Options(changes, without=("shoal",))
    model, beams = story_model(options), None
    stress, peak = [], []
    for hour in HOURS:
        model.advance(steps=round((hour * 3600.0 - model.time) / step))
        if scheme == EXPLICIT:
            stress.append(model.bonds.normal_stress.copy())
            peak.append(model.bonds.peak_stress.max())
        else:
            beams = beams or Beams(model)
            stress.append(beams.stress(model))
            peak.append(stress[-1].max())
    return Load(np.array(stress), np.array(peak))


def difference(run: Load, truth: Load) -> float:
    """Root mean square of the differences over bonds and hours, as a part of the largest stress."""
    return float(np.sqrt(((run.stress - truth.stress) ** 2).mean()) / truth.largest.max())


def row(scheme: str, step: float, run: Load, truth: Load) -> list[str]:
    """Words of one run."""
    when = truth.largest.argmax()
    correlation = np.corrcoef(run.stress.ravel(), truth.stress.ravel())[0, 1]
    kilopascals = (1e-3 * run.largest[when], 1e-3 * run.peak[when])
    return [
        NAMES[scheme], f"{step:.0f} s", f"{100.0 * difference(run, truth):.2g} %", f"{correlation:.4f}",
        *(f"{value:.1f}" for value in kilopascals),
    ]  # fmt: skip


def rows(runs: dict[tuple[str, float], Load], truth: Load) -> Iterator[list[str]]:
    """Rows of the table, and last the run that all are compared with."""
    for (scheme, step), run in runs.items():
        yield row(scheme, step, run, truth)
    when = truth.largest.argmax()
    largest, peak = 1e-3 * truth.largest[when], 1e-3 * truth.peak[when]
    yield [NAMES[QUASI_STATIC], f"{TRUTH:.0f} s", "0", "1", f"{largest:.1f}", f"{peak:.1f}"]


def draw(runs: dict[tuple[str, float], Load], truth: Load) -> None:
    """Draw the largest stress by hour, and the difference against the long step."""
    figure = style.new_figure(11.0, 4.2, 110)
    figure.set_layout_engine("constrained")
    panels = figure.subplots(1, 2)
    for axes, draw_into in zip(panels, (_draw_hours, _draw_convergence), strict=True):
        draw_into(axes, runs, truth)
        style.plain_axes(axes)
    style.letters(list(panels))
    style.save_figure(figure, FIGURE)


def _draw_hours(axes: Axes, runs: dict[tuple[str, float], Load], truth: Load) -> None:
    days = np.array(HOURS) / 24.0
    long = runs[EXPLICIT, 1800.0]
    axes.plot(days, 1e-3 * truth.largest, color=colours.OBSERVED, lw=2.5, label="equilibrium")
    axes.plot(days, 1e-3 * long.peak, color=EXPLICIT_COLOUR, ls="--", label="explicit, 1800 s: between records")
    axes.plot(days, 1e-3 * long.largest, color=EXPLICIT_COLOUR, label="explicit, 1800 s: at records")
    axes.plot(days, 1e-3 * runs[EXPLICIT, 150.0].largest, color=SHORT_COLOUR, lw=1.2, label="explicit, 150 s")
    axes.plot(
        days,
        1e-3 * runs[QUASI_STATIC, 1800.0].largest,
        color=QUASI_STATIC_COLOUR,
        ls=":",
        lw=2.5,
        label="quasi-static, 1800 s",
    )
    axes.set(xlabel="days since the start", ylabel="largest tensile stress of any bond (kPa)", ylim=(0.0, None))
    axes.legend(frameon=False, fontsize="small", loc="upper left")


def _draw_convergence(axes: Axes, runs: dict[tuple[str, float], Load], truth: Load) -> None:
    for scheme, colour, name in (
        (EXPLICIT, EXPLICIT_COLOUR, "explicit"),
        (QUASI_STATIC, QUASI_STATIC_COLOUR, "quasi-static"),
    ):
        steps = STEPS[scheme]
        apart = [100.0 * difference(runs[scheme, step], truth) for step in steps]
        axes.loglog(steps, apart, "o-", color=colour, label=name)
    axes.set(xlabel="long step (s)", ylabel="difference from equilibrium\n(% of the largest stress)")
    ticks = sorted({step for some in STEPS.values() for step in some})
    axes.set_xticks(ticks, [f"{step:.0f}" for step in ticks])
    axes.minorticks_off()
    axes.legend(frameon=False)


def main() -> None:
    """Run all, print the table, write it where that is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name} and draw its figure")
    asked = parser.parse_args()
    truth = loaded(QUASI_STATIC, TRUTH)
    runs = {(scheme, step): loaded(scheme, step) for scheme, steps in STEPS.items() for step in steps}
    head = ["scheme", "long step", "difference, all bonds and hours", "correlation",
            "largest stress at the height of the load, at records (kPa)", "within the step (kPa)"]  # fmt: skip
    text = table(head, list(rows(runs, truth)))
    print(text)
    if asked.write:
        PAGE.write_text(put(PAGE.read_text("utf-8"), "convergence", text), "utf-8")
        draw(runs, truth)


if __name__ == "__main__":
    main()
