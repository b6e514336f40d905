"""A speed that no ice reaches ends a run in every scheme, for the true reason; what pushes the ice is named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.errors import InputError, RunError
from riftberg.parameters import Compatibility

SCHEMES: dict[str, dict[str, Any]] = {
    "quasi_static": {"stepping": {"scheme": "quasi_static"}},
    "mts with beams": {"stepping": {"scheme": "mts"}, "bonds": {"law": "dem"}},
    "mts with springs": {"stepping": {"scheme": "mts"}, "bonds": {"law": "spring"}},
    "mts with springs, implicit": {"stepping": {"scheme": "mts", "explicit_substeps": False}, "bonds": {"law": "spring"}},
    "verlet": {"stepping": {"scheme": "verlet"}, "bonds": {"law": "spring"}},
    "runge_kutta": {"stepping": {"scheme": "runge_kutta"}, "bonds": {"law": "spring"}},
    "runge_kutta, no bonds": {"stepping": {"scheme": "runge_kutta"}, "bonds": {"law": "none"}},
}  # fmt: skip


class Spoilt(Forcing.uniform):
    """Still water, but one value is what it cannot be: at all elements or some, from some time on."""

    def __init__(self, since: float = 0.0, rows: slice = slice(None), **values: float) -> None:
        super().__init__(current=(0.1, 0.0), slope=(0.0, 0.0))
        self.since, self.rows, self.values = since, rows, values

    def sample(self, elements: Any, time: float) -> None:
        super().sample(elements, time)
        if time >= self.since:
            for name, value in self.values.items():
                getattr(elements, name)[self.rows] = value


def model_of(scheme: str, forcing: Forcing, **stepping: Any) -> Model:
    wishes = SCHEMES[scheme]
    dt = 10.0 if scheme in ("verlet", "runge_kutta") else 600.0
    p = Parameters(**{**wishes, "stepping": {"time_step": dt, **wishes["stepping"], **stepping}})
    berg = Iceberg.rectangle(
        "12 km", "3 km", thickness="200 m", placement=(-38.0, -56.0), radius="1.5 km", packing="square"
    )
    return Model(berg, forcing, p, start="2020-12-09 13:00")


def advanced(model: Model, steps: int = 300) -> str:
    with pytest.raises(RunError) as caught:
        model.advance(steps=steps)
    fastest = np.hypot(model.elements.u, model.elements.v).max()
    assert fastest <= 10.0, "the state left is the last good one"
    return str(caught.value)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_current_that_no_sea_has_ends_the_run(scheme: str) -> None:
    """A current of 60 m/s: before, the berg went with it, exit 0."""
    model = model_of(scheme, Spoilt(uo=60.0))
    text = advanced(model)
    for words in (
        f"element {int(model.elements.id[0])} moves at ", "no ice is faster than 10 m/s", "2020-12-", "in step ",
        "drag of the water, ", "the water moves at 60 m/s", "stepping.speed_limit",
    ):  # fmt: skip
        assert words in text
    assert "unstable" not in text


@pytest.mark.quick(4)
@pytest.mark.parametrize("scheme", [name for name in SCHEMES if "implicit" not in name])
@pytest.mark.parametrize(("name", "value"), [("uo", np.inf), ("slope_y", np.nan), ("ua", -np.inf)])
def test_infinite_forcing_is_the_reason_that_is_given(scheme: str, name: str, value: float) -> None:
    model = model_of(scheme, Spoilt(rows=slice(1, 2), **{name: value}))
    text = advanced(model, 5)
    assert f"The reason is the forcing: {name} = {value} at element {int(model.elements.id[1])} (-38.0" in text
    assert "unstable" not in text
    assert "sub-steps" not in text


def test_forcing_that_fails_on_the_way_is_named_with_its_date() -> None:
    text = advanced(model_of("quasi_static", Spoilt(since=3600.0, uo=np.inf)), 30)
    assert "in step 6 (2020-12-09 13:50)" in text
    assert "uo = inf" in text


@pytest.mark.parametrize("scheme", ["quasi_static", "mts with beams", "verlet"])
def test_a_limit_that_is_set_is_the_limit(scheme: str) -> None:
    """A scene that means it sets the limit; one that is lower ends the run earlier."""
    model_of(scheme, Spoilt(uo=12.0), speed_limit=50.0).advance(steps=20)
    model = model_of(scheme, Spoilt(uo=2.0), speed_limit=0.5)
    with pytest.raises(RunError, match=r"no ice is faster than 0.5 m/s"):
        model.advance(steps=500)


def test_wind_and_slope_are_named_where_they_push() -> None:
    model = model_of("quasi_static", Spoilt(ua=900.0), speed_limit=1.0)
    with pytest.raises(RunError, match=r"largest force on it is the drag of the wind, .* the air at 900 m/s"):
        model.advance(steps=300)
    model = model_of("runge_kutta, no bonds", Spoilt(rows=slice(1, 2), slope_x=-1.0))
    with pytest.raises(RunError, match=r"element 2 .*largest force on it is the slope of the sea surface"):
        model.advance(steps=300)


def test_neighbours_are_named_where_they_push_and_never_else() -> None:
    """What no force explains is the push of neighbours: nothing of a lone berg, nearly all of one that a pressed bond throws."""
    for scheme in ("runge_kutta, no bonds", "quasi_static"):
        text = advanced(model_of(scheme, Spoilt(ua=900.0), speed_limit=1.0))
        assert "largest force on it is the drag of the wind" in text, scheme
    model = model_of("verlet", Forcing.uniform())
    model.elements.lon[1] = model.elements.lon[0] + 0.3 * (model.elements.lon[1] - model.elements.lon[0])
    assert "largest force on it is the push of its neighbours" in advanced(model)


def test_elements_that_begin_too_fast_are_refused_before_the_first_step() -> None:
    for velocity, reason in (((22.0, 0.0), "it begins with a speed of 22 m/s"), ((0.0, -1e5), "100000 m/s")):
        berg = Iceberg.rectangle(
            "12 km", "3 km", thickness="200 m", placement=(-38.0, -56.0), radius="1.5 km", packing="square"
        )
        berg.elements.u[1:], berg.elements.v[1:] = velocity
        with pytest.raises(InputError, match=rf"element 2 .*{reason}.*stepping.speed_limit"):
            Model(berg, Forcing.uniform())
    with pytest.raises(InputError, match=r"fixed_velocity of 50 m/s"):
        model_of("verlet", Forcing.uniform(), fixed_velocity=(30.0, 40.0))


def test_debris_of_the_references_contact_may_be_faster_but_not_what_is_driven() -> None:
    """The reference flings pieces at 100 m/s (Q42); what the sea drives is held to the limit there too."""
    berg = Iceberg.rectangle(
        "12 km", "3 km", thickness="200 m", placement=(-38.0, -56.0), radius="1.5 km", packing="square"
    )
    p = Parameters(
        stepping={"scheme": "mts", "time_step": 60.0}, bonds={"law": "dem"}, compatibility=Compatibility.kid()
    )
    berg.elements.u[0] = 40.0
    model = Model(berg, Forcing.uniform(), p.changed(bonds={"law": "none"}))
    model.advance(steps=1)
    assert model.elements.u[0] > 10.0
    berg.elements.u[:] = 40.0
    with pytest.raises(InputError, match="begins with a speed of 40 m/s"):
        Model(berg, Forcing.uniform(), p)
    berg.elements.u[:] = 0.0
    model = Model(berg, Spoilt(uo=60.0), p)
    with pytest.raises(RunError, match="drag of the water"):
        model.advance(steps=100)
