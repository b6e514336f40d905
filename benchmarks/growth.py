"""How cost grows with the elements of a berg, with single bergs and with the members of a forecast; draws a figure.

python benchmarks/growth.py            print the numbers and draw docs/figures/growth.png

Processor seconds a day, the least of two days after the first; of members all days of all of them, by the days of one.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.ensembles.forecast import forecast_plan
from riftberg.ensembles.member import run_member
from riftberg.ensembles.vary import Draws
from riftberg.experiments import Options

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "growth.png"
ELEMENTS = (500, 1_000, 2_000, 5_000, 10_000, 20_000, 50_000)
BERGS = (10, 100, 1_000, 10_000, 50_000)
MEMBERS = (1, 2, 5, 10)
MEMBER_DAYS = 4.0


def cheapest_day(model: Model) -> float:
    """Return the processor seconds of the cheaper one of two days after the first."""
    model.advance(days=1.0)
    costs = []
    for _ in range(2):
        began = time.process_time()
        model.advance(days=1.0)
        costs.append(time.process_time() - began)
    return min(costs)


def berg(elements: int) -> Model:
    """Return a berg of 3-km elements in an eddy, afloat."""
    rows = round(math.sqrt(elements / 2.0))
    ice = Iceberg.rectangle(6e3 * rows, 3e3 * rows, thickness=250.0, radius=1500.0, placement=(-40.0, -60.0))
    sea = Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0), depth=3000.0) + Forcing.eddy((-40.0, -61.0), 60e3, 0.1)
    return Model(ice, sea, Parameters(fracture={"enabled": False}))


def field(bergs: int) -> Model:
    """Return single bergs, four degrees squared for each thousand."""
    side = 4.0 * math.sqrt(bergs / 1000.0)
    ice = Iceberg.field(bergs, (-40.0, -40.0 + min(side, 60.0), -70.0, -70.0 + min(0.5 * side, 20.0)), seed=1)
    return Model(ice, Forcing.uniform((0.1, 0.05), wind=(8.0, 2.0), depth=3000.0), Parameters())


def cost_members() -> list[float]:
    """Return the processor seconds of members of a forecast of A68a, from the start of each to its files, by the day."""
    costs = []
    with TemporaryDirectory() as folder:
        plan = forecast_plan("a68a", (), Options(days=MEMBER_DAYS), None, Draws(max(MEMBERS), "random"))
        for number in range(max(MEMBERS)):
            began = time.process_time()
            outcome = run_member(plan.job(number, Path(folder), save_seconds=1e9))
            assert outcome.status == "done", outcome.message
            costs.append((time.process_time() - began) / MEMBER_DAYS)
    return costs


def main() -> None:
    """Measure, print and draw."""
    lines = {
        "elements of one berg": [(n, cheapest_day(berg(n))) for n in ELEMENTS],
        "single bergs": [(n, cheapest_day(field(n))) for n in BERGS],
    }
    costs = cost_members()
    lines["members of a forecast of A68a"] = [(n, sum(costs[:n])) for n in MEMBERS]
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for (name, points), marker in zip(lines.items(), "os^", strict=True):
        print(name, *(f"{n}: {cost:.3g}" for n, cost in points))
        axes.plot(*zip(*points, strict=True), marker=marker, label=name)
    axes.set(
        xscale="log", yscale="log", xlabel="number of elements, bergs or members", ylabel="processor time of a day (s)"
    )
    axes.grid(visible=True, which="major", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(FIGURE, dpi=150)


if __name__ == "__main__":
    main()
