"""A68a and small bergs in a channel of the ocean model Veros: they drift and melt, and their fresh water drifts with them.

    python docs/examples/veros_channel.py               3 days: figures on the screen, the fresh pool in veros-channel.png
    python docs/examples/veros_channel.py --days 30

Needs `pip install riftberg[veros]`, and no data: front, wind and floor are formulas. The channel is a piece of the Southern
Ocean, 30 degrees long and joined at its ends, without any source of heat or water but the bergs.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("VEROS_LOGLEVEL", "warning")

import numpy as np
from veros import VerosSetup, veros_routine
from veros.core.density import get_rho
from veros.core.operators import at, update
from veros.tools import get_vinokur_grid_steps

from riftberg import Iceberg, Model, Parameters, VerosBergs, veros_forcing

LAYERS = get_vinokur_grid_steps(15, 3000.0, 20.0, refine_towards="lower")
"""Layers of the water, m, from the floor up. Veros finds their middles from floor to surface, each from the one below: layers
that do not grow evenly have distances below zero there, and friction between them feeds the shear until the current bursts."""
KEEL = 200.0
"""Depth of the water that the bergs feel and give to, m."""
STEP = 1800.0
"""Of the ocean and of the bergs, s."""
PARAMETERS = Parameters(
    earth={"period": 30.0}, stepping={"time_step": STEP}, rolling={"enabled": True},
    melt={"enabled": True, "base": "three_equation", "bits_fraction": 0.3},
)  # fmt: skip


class Channel(VerosSetup):
    """A channel between walls at 62 and 54 degrees south, with a front in balance with its current, and a west wind."""

    @veros_routine
    def set_parameter(self, state: Any) -> None:
        """Size, steps, mixing, and the sources through which bergs give."""
        s = state.settings
        s.identifier, s.nx, s.ny, s.nz = "channel", 60, 32, len(LAYERS)
        s.dt_mom = s.dt_tracer = STEP
        s.x_origin, s.y_origin, s.coord_degree, s.enable_cyclic_x = 0.0, -62.0, True, True
        s.enable_streamfunction = False  # the surface is free, so there is a sea level
        s.enable_tempsalt_sources = s.enable_momentum_sources = True
        s.eq_of_state_type = 3
        s.enable_hor_friction, s.A_h = True, 500.0
        s.enable_hor_diffusion, s.K_h = True, 100.0
        s.enable_superbee_advection = True
        s.enable_implicit_vert_friction, s.kappaM_0, s.kappaH_0 = True, 1e-3, 2e-5
        s.enable_bottom_friction, s.r_bot = True, 1e-5

    @veros_routine
    def set_grid(self, state: Any) -> None:
        """Half a degree by a quarter: some 30 km."""
        vs = state.variables
        vs.dxt = update(vs.dxt, at[...], 0.5)
        vs.dyt = update(vs.dyt, at[...], 0.25)
        vs.dzt = update(vs.dzt, at[...], np.array(LAYERS))

    @veros_routine
    def set_coriolis(self, state: Any) -> None:
        """Of the sphere."""
        vs, s = state.variables, state.settings
        vs.coriolis_t = update(vs.coriolis_t, at[...], 2.0 * s.omega * np.sin(np.deg2rad(vs.yt))[None, :])

    @veros_routine
    def set_topography(self, state: Any) -> None:
        """A flat floor."""
        state.variables.kbot = update(state.variables.kbot, at[...], 1)

    @veros_routine
    def set_initial_conditions(self, state: Any) -> None:
        """A front in the middle: 0 degrees in the south, 4 in the north, at rest on the floor; wind from the west."""
        vs, s = state.variables, state.settings
        depth = -np.asarray(vs.zt)
        front = 0.5 * (1.0 + np.tanh((np.asarray(vs.yt) + 58.0) / 1.5))
        temperature = 4.0 * front[:, None] * np.exp(-depth / 1500.0) + 0.5 * (1.0 - np.exp(-depth / 300.0))
        salinity = np.broadcast_to(34.0 + 0.7 * (1.0 - np.exp(-depth / 400.0)), temperature.shape)
        vs.temp = update(vs.temp, at[...], temperature[None, :, :, None] * np.asarray(vs.maskT)[..., None])
        vs.salt = update(vs.salt, at[...], salinity[None, :, :, None] * np.asarray(vs.maskT)[..., None])
        density = np.asarray(get_rho(state, salinity, temperature, depth))
        pressure = s.grav / s.rho_0 * np.cumsum((density * np.array(LAYERS))[:, ::-1], axis=1)[:, ::-1]
        pressure -= 0.5 * s.grav / s.rho_0 * density * np.array(LAYERS)
        surface = -pressure[:, :1]  # what makes the pressure on the floor the same everywhere
        distance = np.asarray(vs.yt) * s.degtom
        coriolis = np.asarray(vs.coriolis_t)[0]
        u = -np.gradient(pressure + surface, distance, axis=0) / coriolis[:, None]
        vs.u = update(vs.u, at[...], u[None, :, :, None] * np.asarray(vs.maskU)[..., None])
        vs.psi = update(vs.psi, at[...], (surface[:, 0] - surface.mean())[None, :, None])
        wind = 0.1 * np.sin(np.pi * (np.asarray(vs.yt) + 62.0) / 8.0)
        vs.surface_taux = wind[None, :] * np.asarray(vs.maskU)[..., -1]

    @veros_routine
    def set_forcing(self, state: Any) -> None:
        """Nothing changes but what the bergs give."""

    @veros_routine
    def set_diagnostics(self, state: Any) -> None:
        """None: no files are written."""
        for diagnostic in state.diagnostics.values():
            diagnostic.sampling_frequency = diagnostic.output_frequency = 0.0

    @veros_routine
    def after_timestep(self, state: Any) -> None:
        """Nothing."""


def bergs() -> Iceberg:
    """Return a berg of the size of A68a, 150 km by 48 km in bonded elements, and 40 small ones around it."""
    large = Iceberg.rectangle(150e3, 48e3, thickness=230.0, radius=3000.0, placement=(7.0, -58.0))
    small = Iceberg.field(40, (4.0, 20.0, -60.0, -58.6), sizes="gladstone", seed=1)
    return Iceberg.join([large, small], names=["A68a", "small bergs"])


def coupled() -> tuple[Channel, VerosBergs]:
    """Return ocean and bergs before their first step."""
    channel = Channel()
    channel.setup()
    model = Model(bergs(), veros_forcing(channel.state), PARAMETERS)
    return channel, VerosBergs(channel.state, model, keel=KEEL)


class Costs(NamedTuple):
    """Seconds of a step of the ocean, and of the bergs' beside it, the first of both left out."""

    ocean: float
    bergs: float


def run(channel: Channel, life: VerosBergs, days: float) -> Costs:
    """Step bergs and ocean in turn."""
    marks = []
    for _ in range(round(days * 86400.0 / STEP)):
        start = time.perf_counter()
        life.step()
        between = time.perf_counter()
        channel.step(channel.state)
        marks.append((time.perf_counter() - between, between - start))
    return Costs(*np.mean(marks[1:] or marks, axis=0))


def draw(channel: Channel, life: VerosBergs, path: Path, track: np.ndarray, days: float) -> None:
    """Draw how much fresher and colder the upper 200 m are than in a channel without bergs, and where the bergs are."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    alone = Channel()
    alone.setup()
    for _ in range(round(days * 86400.0 / STEP)):
        alone.step(alone.state)
    with_bergs, without = life.taken(), VerosBergs(alone.state, life.exchange.model, keel=KEEL).taken()
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    for axes, name, label in zip(
        figure.subplots(2, 1, sharex=True), ("sea_surface_salinity", "sea_surface_temperature"),
        ("fresher by (g/kg)", "colder by (degC)"), strict=True,
    ):  # fmt: skip
        change = without[name] - with_bergs[name]
        filled = axes.pcolormesh(
            np.asarray(channel.state.variables.xt)[2:-2], np.asarray(channel.state.variables.yt)[2:-2], change,
            cmap="Blues", vmin=0.0, vmax=max(float(change.max()), 1e-9), shading="nearest", rasterized=True,
        )  # fmt: skip
        figure.colorbar(filled, ax=axes, label=label)
        elements = life.exchange.model.elements
        axes.plot(elements.place.lon % 30.0, elements.place.lat, ".", color="black", markersize=1.5)
        axes.plot(track[:, 0], track[:, 1], color="#cc6677", linewidth=1.0)
        axes.set(ylabel="latitude", ylim=(-61.0, -56.0))
    axes.set(xlabel="longitude", xlim=(0.0, 30.0))
    figure.axes[0].set_title(f"Mean of the upper {KEEL:.0f} m after {days:g} days, against the channel without bergs")
    figure.savefig(path, dpi=120)


def main() -> None:
    """Run, print and draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--days", type=float, default=3.0)
    parser.add_argument("--picture", type=Path, default=Path("veros-channel.png"))
    options = parser.parse_args()
    channel, life = coupled()
    track, costs = [], []
    large = life.exchange.model.elements.body.berg == life.exchange.model.elements.body.berg[0]
    ids = life.exchange.model.elements.body.id[large]
    for _ in range(round(options.days)):
        costs.append(run(channel, life, 1.0))
        place, known = life.exchange.model.elements.place, np.isin(life.exchange.model.elements.body.id, ids)
        track.append((place.lon[known].mean(), place.lat[known].mean()))
    closure, cost = life.closure(), np.mean(costs, axis=0)
    print(f"melt water {closure.water / 1e12:.4g} Gt, heat {closure.heat / 1e18:.4g} EJ")
    print(
        f"did not arrive: {closure.water_error:.1e} of the water, {closure.heat_error:.1e} of the heat, of what both hold"
    )
    print(f"a step of the ocean {1e3 * cost[0]:.0f} ms, of the bergs with the exchange {1e3 * cost[1]:.0f} ms")
    print(life.exchange.balance().describe())
    draw(channel, life, options.picture, np.array(track), options.days)
    print(options.picture)


if __name__ == "__main__":
    main()
