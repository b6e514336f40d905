"""Values as people give them: numbers of any kind, texts with units, dates; the same words in Python as in YAML."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import riftberg
from riftberg import A68A_2022, DatasetForcing, Forcing, GriddedForcing, Iceberg, Model, Parameters, build
from riftberg.config.values import moment
from riftberg.errors import BergError, ForcingError, InputError
from riftberg.parameters import ExplicitParameters, QuasiStaticParameters, fields_by_path

NOON = datetime(2020, 12, 9, 12)


def block(**options: Any) -> Iceberg:
    return Iceberg.rectangle(
        **{"length": 6e3, "width": 6e3, "thickness": 200.0, "placement": (-37.0, -56.0), **options}
    )


def drifting(speed: float) -> Model:
    return Model(block(), Forcing.uniform(current=(speed, 0.0), slope=(0.0, 0.0)), start="2020-12-09")


@pytest.mark.parametrize(
    "given",
    [
        NOON, "2020-12-09 12:00", "2020-12-09T12:00:00Z", np.datetime64("2020-12-09T12"), pd.Timestamp(NOON),
        pd.Timestamp("2020-12-09 13:00", tz="Europe/Paris"), NOON.replace(tzinfo=UTC), xr.DataArray(np.datetime64(NOON)),
        np.array("2020-12-09T12", dtype="datetime64[ns]"),
    ],
    ids=str,
)  # fmt: skip
def test_dates_of_every_kind(given: Any) -> None:
    assert moment(given, where="start") == NOON
    assert Model(block(), Forcing.uniform(), start=given).start == NOON


@pytest.mark.parametrize(
    "text",
    [
        "2020-12-09 12:00 UTC", "2020-12-09 12:00 GMT", "2020-12-09 15:00 +03:00", "2020-12-09T12", "2020-12-09 12:00z",
        "2020-12-09 09:00 -03", "2020-12-09  12:00:00utc", "2020/12/09 12:00", "2020-12-09T1200Z",
    ],
)  # fmt: skip
def test_dates_are_read_as_people_write_them_in_python_and_in_a_file(text: str, tmp_path: Path) -> None:
    """Bug: 'is not possible. Allowed: a date', for a date."""
    from riftberg.experiments.yaml_file import read_file

    file = tmp_path / "e.yaml"
    file.write_text(f"name: e\nstart: \"{text}\"\ndays: 1\nforcing: {{uniform: {{current: [0.1, 0.0], slope: [0, 0]}}}}\n"
                    "berg: {thickness: 200, rectangle: {length: 9 km, width: 6 km}, placement: [-37, -56]}\n")  # fmt: skip
    assert read_file(file)[0].start == moment(text, where="start") == NOON
    assert moment("2020-12-09 6:00", where="start") == NOON.replace(hour=6)


@pytest.mark.parametrize("text", ["2020-12-09 12:00 EST", "2020-12-09 6 am", "2020-12-09 25:00", "9 Dec 2020"])
def test_a_date_that_cannot_be_read_is_answered_with_an_example(text: str, tmp_path: Path) -> None:
    from riftberg.experiments.yaml_file import read_file

    file = tmp_path / "e.yaml"
    file.write_text(f'name: e\nstart: "{text}"\ndays: 1\n')
    with pytest.raises(InputError, match=rf"start: .*'{text}' is not a date.*Write it like 2020-12-09 13:00"):
        read_file(file)


@pytest.mark.parametrize("key", ["title", "name"])
@pytest.mark.parametrize("control", ["\\e[31m", "\\a", "\\u202e", "\\x9b"])
def test_text_that_steers_a_terminal_is_refused_and_shown(key: str, control: str, tmp_path: Path) -> None:
    """Bug: ``title`` was taken, and a warning of matplotlib came out."""
    from riftberg.experiments.yaml_file import read_file

    file = tmp_path / "e.yaml"
    file.write_text(f'{key}: "a{control}b"\nstart: 2020-12-09\ndays: 1\n')
    with pytest.raises(InputError, match=f"{key}: control characters stand in") as caught:
        read_file(file)
    assert all(c.isprintable() or c == "\n" for c in str(caught.value))


def test_a_day_begins_at_midnight() -> None:
    assert moment(date(2020, 12, 9), where="start") == moment("2020-12-09", where="start") == datetime(2020, 12, 9)


@pytest.mark.parametrize("given", ["tomorrow", "2020-02-31", 5, pd.NaT, np.datetime64("NaT"), True, [NOON]])
def test_what_is_no_date_is_refused(given: Any) -> None:
    with pytest.raises(InputError, match=r"start: .* is not a date. Write it like 2020-12-09 13:00"):
        Model(block(), Forcing.uniform(), start=given)


@pytest.mark.parametrize(
    "length",
    [6e3, 6000, "6 km", np.float32(6e3), np.int16(6000), np.array(6e3), pd.Series([6e3])[0], xr.DataArray(6e3)],
)
def test_a_length_of_every_kind(length: Any) -> None:
    assert block(length=length).area == pytest.approx(36e6)


@pytest.mark.parametrize(
    "thickness",
    [200, "200 m", "0.2 km", np.float32(200), [200.0] * 4, pd.Series([200.0] * 4), np.full(4, 200), ["200 m"] * 4,
     xr.DataArray(200.0).item()],
    ids=str,
)  # fmt: skip
def test_a_thickness_of_every_kind(thickness: Any) -> None:
    assert block(thickness=thickness).elements.thickness.tolist() == [200.0] * 4


def test_points_from_a_table() -> None:
    table = pd.DataFrame({"lon": [0.0, 3000.0], "lat": [0.0, 0.0], "h": [200, 210]})
    berg = Iceberg.from_points(table["lon"], table["lat"], thickness=table["h"], latlon=False, radius="1.5 km")
    assert berg.elements.thickness.tolist() == [200.0, 210.0]
    assert len(berg.bonds.first) == 1


def test_units_in_every_constructor() -> None:
    assert Parameters(fracture={"normal_strength": "25 kPa"}).fracture.normal_strength == 25e3
    assert A68A_2022.changed(stepping={"time_step": "15 min"}).stepping.time_step == 900.0
    sea = Forcing.uniform(
        current=("20 cm/s", np.float32(0.5)), wind=pd.Series([5, -2]), depth="0.5 km", slope=(0.0, 0.0)
    )
    assert (sea.current, sea.wind, sea.water) == ((0.2, 0.5), (5.0, -2.0), 500.0)
    berg = block(velocity=("20 cm/s", 0.0), rotation="0.5 rad", spin="1e-6 rad/s", radius="750 m", density="0.9 t/m3")
    assert berg.elements.u.mean() == pytest.approx(0.2, abs=1e-6)
    assert set(berg.elements.spin) == {1e-6}
    assert berg.radius == 750.0
    assert berg.density == 900.0


@pytest.mark.parametrize("days", ["1 h", 1 / 24, np.float64(1 / 24), pd.Timedelta("1h"), timedelta(hours=1)], ids=str)
def test_the_length_of_a_run_of_every_kind(days: Any) -> None:
    model = Model(block(), Forcing.uniform())
    model.advance(days)
    assert model.step_number == 2


MISTAKES: list[tuple[str, str, Callable[[Any], object]]] = [
    # What stands in a file after "berg:" and the like, and the same in Python.
    ("  rectangle: {length: VALUE, width: 6 km}", "berg.rectangle.length", lambda v: block(length=v)),
    ("  rectangle: {length: 6 km, width: VALUE}", "berg.rectangle.width", lambda v: block(width=v)),
    ("  radius: VALUE", "berg.radius", lambda v: block(radius=v)),
    ("  velocity: [VALUE, 0]", "berg.velocity", lambda v: block(velocity=(v, 0))),
    ("  rotation: VALUE", "berg.rotation", lambda v: block(rotation=v)),
    ("  packing: VALUE", "berg.packing", lambda v: block(packing=v)),
    ("current: [VALUE, 0]", "forcing.current", lambda v: Forcing.uniform(current=(v, 0.0), slope=(0.0, 0.0))),
    ("wind: [0, VALUE]", "forcing.wind", lambda v: Forcing.uniform(wind=(0.0, v))),
    ("depth: VALUE", "forcing.depth", lambda v: Forcing.uniform(depth=v)),
    ("fracture: {normal_strength: VALUE}", "parameters.fracture.normal_strength",
     lambda v: Parameters(fracture={"normal_strength": v})),
    ("fracture: {enabled: VALUE}", "parameters.fracture.enabled", lambda v: A68A_2022.changed(fracture={"enabled": v})),
    ("stepping: {time_step: VALUE}", "parameters.stepping.time_step",
     lambda v: A68A_2022.changed(stepping={"time_step": v})),
]  # fmt: skip

FILE = """start: 2020-12-09
days: 1
berg:
  placement: [-37, -56]
{berg}
forcing:
  uniform: {{{forcing}}}
parameters:
  {parameters}
"""


def said_of_file(tmp_path: Path, line: str, value: str) -> str:
    """Return what is said of a file with a value, without the place."""
    line = line.replace("VALUE", value)
    shape = "" if "rectangle" in line else "  rectangle: {length: 6 km, width: 6 km}\n"
    kind = "berg" if line.startswith("  ") else "parameters" if "{" in line else "forcing"
    parts = {"berg": shape.rstrip(), "forcing": "slope: [0, 0]", "parameters": "preset: a68a-2022"}
    parts[kind] = shape + line if kind == "berg" else line
    path = tmp_path / "case.yaml"
    path.write_text(FILE.format(**parts))
    with pytest.raises(InputError) as caught:
        build(str(path))
    return f"{caught.value.what}. {caught.value.remedy}"


@pytest.mark.quick(8)
@pytest.mark.parametrize(("line", "key", "python"), MISTAKES, ids=[key for _, key, _ in MISTAKES])
@pytest.mark.parametrize(("text", "value"), [("25 kN", "25 kN"), ("many", "many"), ("2 parsec", "2 parsec")])
def test_a_mistake_gets_the_same_words_in_python_as_in_a_file(
    line: str, key: str, python: Callable[[Any], object], text: str, value: Any, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        python(value)
    assert f"{caught.value.what}. {caught.value.remedy}" == said_of_file(tmp_path, line, text)
    assert key.endswith(caught.value.where)


@pytest.mark.parametrize(
    ("line", "value", "python"),
    [
        ("  radius: VALUE", -3, lambda v: block(radius=v)),
        ("  radius: VALUE", True, lambda v: block(radius=v)),
        ("  velocity: [VALUE, 0]", 50, lambda v: block(velocity=(v, 0))),
        ("  rectangle: {length: 6 km, width: VALUE}", 0, lambda v: block(width=v)),
        ("depth: VALUE", -5, lambda v: Forcing.uniform(depth=v)),
        ("wind: [VALUE, 0]", 500, lambda v: Forcing.uniform(wind=(v, 0.0))),
        ("sea_ice: [0, 0, VALUE]", -1, lambda v: Forcing.uniform(sea_ice=(0.0, 0.0, v))),
        ("stepping: {time_step: VALUE}", -3, lambda v: Parameters(stepping={"time_step": v})),
        ("fracture: {normal_strength: VALUE}", True, lambda v: Parameters(fracture={"normal_strength": v})),
    ],
)
def test_an_impossible_number_gets_the_same_words(
    line: str, value: Any, python: Callable[[Any], object], tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        python(value)
    said = said_of_file(tmp_path, line, str(value).lower())
    assert f"{caught.value.what}. {caught.value.remedy}".replace(".0", "") == said.replace(".0", "")


@pytest.mark.parametrize("place", [(-56.0, -137.0), (10.0, 95.0), (0.0, 90.5)])
def test_latitudes_beyond_the_pole_are_refused(place: tuple[float, float]) -> None:
    with pytest.raises(BergError, match="has no sea for a berg: are longitude and latitude swapped"):
        block(placement=place)
    with pytest.raises(BergError, match="has no sea for a berg"):
        Iceberg.from_table([(0, 0, 1)], thickness=200.0, placement=place)
    with pytest.raises(ForcingError, match=r"latitude: .* is not possible"):
        Forcing.uniform((0.1, 0.0), latitude=place[1])


def test_arguments_in_the_wrong_order_are_named() -> None:
    berg = block()
    with pytest.raises(InputError, match=r"Model, berg: .* is no berg. Give an Iceberg"):
        Model(Forcing.uniform(), berg)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"Model, forcing: .* is no forcing"):
        Model(berg, A68A_2022)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"Model, parameters: .* is no parameters"):
        Model(berg, Forcing.uniform(), {"fracture": {}})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        ({"fractur": {}}, "fractur: there is no such group of parameters. Did you mean 'fracture'?"),
        ({"fracture": {"strength": 1.0}}, "fracture.strength: there is no such parameter.*fracture has enabled"),
        ({"fracture": 5}, "fracture: 5 is no group of parameters"),
    ],
)
def test_unknown_parameters_are_named(groups: dict[str, Any], message: str) -> None:
    for make in (lambda: Parameters(**groups), lambda: A68A_2022.changed(**groups)):
        with pytest.raises(InputError, match=message):
            make()


def test_forcing_from_datasets_takes_dates_as_text() -> None:
    time = pd.date_range("2020-12-09", periods=3)
    axes = {"time": time, "lat": [-58.0, -56.0, -54.0], "lon": [-40.0, -37.0, -34.0]}
    names = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
    ds = xr.Dataset(
        {n: (tuple(axes), np.full((3, 3, 3), 0.1), {"standard_name": s, "units": "m s-1"}) for n, s in names.items()},
        {**axes, "lat": ("lat", axes["lat"], {"units": "degrees_north"}), "lon": ("lon", axes["lon"], {"units": "degrees_east"})},
    )  # fmt: skip
    forcing = DatasetForcing.from_xarray(ds, "2020-12-09", draft="150 m")
    assert forcing.draft == 150.0
    with pytest.raises(InputError, match="start: 'soon' is not a date"):
        DatasetForcing.from_xarray(ds, "soon")


def test_numbers_of_numpy_and_lengths_of_time_are_taken_everywhere() -> None:
    fixed = Parameters(stepping={"fixed_velocity": (np.float64(1.0), np.int8(2))}).stepping.fixed_velocity
    assert fixed == (1.0, 2.0)
    run = Model(block(), Forcing.uniform()).run("3 h", every_hours=np.timedelta64(90, "m"))
    assert run.sizes["time"] == 3
    assert block(placement=["1 km", 5], latlon=False).centroid == pytest.approx((1000.0, 5.0))
    with pytest.raises(InputError, match="every_hours: True is no number"):
        Model(block(), Forcing.uniform()).run("3 h", every_hours=True)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: block(offset="a"), "offset: 'a' is not a number"),
        (lambda: block(offset=(0.5, "x")), "offset: 'x' is not a number"),
        (lambda: block(latlon=False, placement=5), "placement: 5 is not possible. Allowed: 2 numbers, in m"),
        (lambda: block(latlon=False, placement=("3 kPa", 0)), "placement: '3 kPa' is in kPa"),
        (lambda: block(velocity=None), "velocity: None is not possible"),
        (lambda: block(thickness=None), "thickness: None is not possible"),
        (lambda: block(thickness=True), "thickness: true is no number"),
        (lambda: block(thickness="200 kPa"), "thickness: '200 kPa' is in kPa"),
        (lambda: block(conformal="perhaps"), "conformal: 'perhaps' is neither true nor false"),
        (
            lambda: Iceberg.from_points([0, 3e3], [0, 0], thickness=200, latlon=False, bond_length="x"),
            "bond_length: 'x'",
        ),
        (lambda: Iceberg.from_points(["a", 3e3], [0, 0], thickness=200, latlon=False), "lon: 'a' is not a number"),
        (lambda: Iceberg.from_table([(0, 0)], thickness=200, placement=(1, 1)), "rows: .* is not possible"),
        (lambda: Iceberg.from_mask("x.nc", threshold="a"), "threshold: 'a' is not a number"),
        (lambda: block().with_strength("weibull", shape="a"), "shape: 'a' is not a number"),
        (lambda: block().with_strength("weibull", shape=3, seed=-1), "-1 is no seed"),
        (lambda: block().with_rifts([[1, 2], [3, 4]], strength="x"), "strength: 'x' is not a number"),
        (lambda: GriddedForcing(5, []), "grid: 5 cannot be used here. Give a Grid"),
        (lambda: DatasetForcing(5), "parts: 5 cannot be used here"),
        (lambda: DatasetForcing.from_xarray(5, "2020-01-01"), "from_xarray: 5 cannot be used here"),
        (lambda: riftberg.open_run(5), "open_run: 5 cannot be used here"),
        (lambda: riftberg.open_sweep(5), "open_sweep: 5 cannot be used here"),
        (lambda: riftberg.draw_map(5), "draw_map: 5 cannot be used here"),
        (lambda: riftberg.draw_sweep(5, "a.png"), "draw_sweep: 5 cannot be used here"),
        (lambda: Model.resume(5, Forcing.uniform()), "Model.resume: 5 cannot be used here"),
    ],
)
def test_arguments_of_the_wrong_kind_are_refused_in_words(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "place", [("37.5 W", "56 S"), ("37.5°W", "56.0°S"), "37.5 W, 56 S", ("-37.5 deg", -56)], ids=str
)
def test_a_place_may_be_written_as_a_map_has_it(place: Any) -> None:
    lon, lat = block(placement=place).centroid
    assert (lon, lat) == pytest.approx((-37.5, -56.0), abs=1e-3)
    assert Forcing.eddy(place, "30 km", 0.5).centre == (-37.5, -56.0)


def test_letters_tell_a_place_with_its_numbers_swapped() -> None:
    with pytest.raises(BergError, match="'56 S' is a latitude where a longitude belongs"):
        block(placement=("56 S", "37 W"))
    with pytest.raises(ForcingError, match="'56 W' is a longitude where a latitude belongs"):
        Forcing.uniform((0.1, 0.0), latitude="56 W")
    assert Parameters(earth={"reference_latitude": "56 S"}).earth.reference_latitude == -56.0


@pytest.mark.parametrize("step", [pd.Timedelta("10min"), timedelta(minutes=10), np.timedelta64(600, "s"), "10 minutes"])
def test_a_length_of_time_is_one_wherever_seconds_are(step: Any) -> None:
    assert Parameters(stepping={"time_step": step}).stepping.time_step == 600.0
    assert Forcing.tide(0.1, period=step).period == 600.0
    with pytest.raises(InputError, match="this is measured in m"):
        Parameters(earth={"radius": step})


@pytest.mark.parametrize(("given", "held"), [("no", False), ("false", False), (np.False_, False), ("yes", True)])
def test_flags_are_words_too(given: Any, held: bool) -> None:
    """Of a formula, latlon="no" was taken for true: a text is."""
    assert Iceberg.rectangle(6e3, 6e3, thickness=200.0, latlon=given).latlon is held
    assert Forcing.uniform(latlon=given, latitude=-60.0).latlon is held
    assert Forcing.turning_wind(5.0, latlon=given).latlon is held
    with pytest.raises(ForcingError, match="'perhaps' is neither true nor false"):
        Forcing.seamount((0.0, 0.0), 300.0, 1e4, 500.0, latlon="perhaps")


def test_parts_with_units_of_their_own_take_them() -> None:
    assert Forcing.uniform(depth=None).depth(np.zeros(1), np.zeros(1)) == np.inf
    assert Forcing.uniform(sea_ice=("10 cm/s", 0, "50 cm")).sea_ice == (0.1, 0.0, 0.5)
    assert Forcing.turning_wind("20 kn", turning="360 deg/day").turning == pytest.approx(15.0)
    assert Forcing.front((-37, -56), 90, "20 cm", "15 km", temperature=("-1 °C", 2)).temperature == (-1.0, 2.0)
    sea = Forcing.uniform(temperature="2 degC", salinity=np.float32(34.0), ice_fraction="50 %")
    assert (sea.temperature, sea.salinity, sea.ice_fraction) == (2.0, 34.0, 0.5)


@pytest.mark.parametrize("name", ["current", "wind"])
def test_a_formula_knows_what_no_water_and_no_air_does(name: str) -> None:
    with pytest.raises(ForcingError, match="is not possible; the most is"):
        Forcing.uniform(**{name: (200.0, 0.0)})
    with pytest.raises(ForcingError, match=r"velocity: .* is not possible"):
        Forcing.eddy((-37.0, -56.0), 3e4, 0.5, velocity=(200.0, 0.0))


def test_a_field_of_bergs_takes_units_and_refuses_in_words() -> None:
    box = ("40 W", "39 W", "58 S", "57.5 S")
    field = Iceberg.field(3, box, sizes=["1 km2", 2e6], gap="2 km", seed=np.int64(1))
    assert set(np.round(field.elements.length * field.elements.width)) <= {1e6, 2e6}
    for wrong, message in (
        ({"n": 2.5}, "2.5 is not possible"), ({"n": -1}, "-1 is not possible"), ({"area": (-40, -38)}, "area:"),
        ({"area": (-40, -38, -98, -57)}, "latitude -98"), ({"sizes": ["1 km"]}, "measured in m2"),
        ({"gap": "far"}, "'far' is not a number"), ({"seed": "a"}, "'a' is no seed"),
    ):  # fmt: skip
        with pytest.raises(BergError, match=message):
            Iceberg.field(**{"n": 3, "area": box, **wrong})


def test_parameters_are_not_changed_in_place() -> None:
    """The words of pydantic, with an address, said what went wrong."""
    for group, name in ((Parameters().fracture, "normal_strength"), (Parameters(), "fracture")):
        with pytest.raises(InputError, match=r"not changed in place. Make new ones, such as parameters.changed\("):
            setattr(group, name, 3.0)
    assert Parameters().model_copy() == Parameters()


@pytest.mark.parametrize("thing", [3, None, "file.nc", xr.DataArray([1.0]), [xr.Dataset(), 3], []], ids=str)
def test_what_is_no_dataset_is_refused_in_words(thing: Any) -> None:
    with pytest.raises(ForcingError, match="Give a dataset of xarray, or a list of them"):
        Forcing.from_xarray(thing)


def test_forcing_is_summed_by_sum() -> None:
    parts = [Forcing.uniform(current=(0.1, 0.0)), Forcing.tide(0.1)]
    assert sum(parts).describe() == (parts[0] + parts[1]).describe()


def test_bergs_are_joined_by_name_and_compared_and_hashed_without_an_error() -> None:
    bergs = {"A": block(), "B": block(placement=(-36.0, -56.0))}
    assert Iceberg.join(bergs).names == ("A", "B")
    assert bergs["A"] != block()  # the arrays of two bergs were compared, which has no truth
    assert len({bergs["A"], bergs["A"], bergs["B"]}) == 2


def test_more_of_the_wrong_kind_is_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no forcing. Give a forcing"):
        Model(block(), Forcing)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Give the path of a restart file"):
        Model(block(), Forcing.uniform()).save(3)  # type: ignore[arg-type]
    for wrong in (3, [3]):
        with pytest.raises(InputError, match="Give recorders in a list"):
            Model(block(), Forcing.uniform()).run(steps=1, recorders=wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Give the path of a run file"):
        Model(block(), Forcing.uniform()).run(steps=1, output=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="this dataset is no run of Riftberg"):
        riftberg.draw_map(xr.Dataset())
    with pytest.raises(InputError, match="vary: None cannot be used here"):
        riftberg.sweep("a68a", None)  # type: ignore[arg-type]
    short = riftberg.sweep(drifting, {"speed": [0.1]}, days="1 h", workers=0)
    assert short.sizes["time"] == 2  # by default as far apart as a run is long that is shorter than 6 h
    for workers in (-1, "two", 1.5):
        with pytest.raises(InputError, match=r"workers: .* processes. Give a whole number, 0 or more"):
            riftberg.sweep("a68a", {"fracture.normal_strength": [1e3]}, days="1 h", workers=workers)  # type: ignore[arg-type]
    for wrong in (None, np.ones((3, 3))):
        with pytest.raises(BergError, match="Give a file, a DataArray, a Dataset or a Raster"):
            Iceberg.from_mask(wrong)
    for make in (
        lambda: block(placement=None),
        lambda: Iceberg.from_table([(0, 0, 2)], thickness=200.0, placement=None),
    ):
        with pytest.raises(BergError, match="placement: no place"):
            make()


def _whole_numbers() -> list[tuple[str, str, str]]:
    return [
        (*path.split("."), scheme)
        for engine, scheme in ((QuasiStaticParameters, "quasi_static"), (ExplicitParameters, "mts"))
        for path, field in fields_by_path(engine).items()
        if field.annotation in (int, int | None)
    ]


@pytest.mark.parametrize(("group", "key", "scheme"), _whole_numbers())
def test_whole_numbers_beyond_any_array_are_refused(group: str, key: str, scheme: str) -> None:
    """``contact.max_iterations = 1e30`` ended in a TypingError of numba."""
    with pytest.raises(InputError, match=rf"{group}\.{key}"):
        Parameters(stepping={"scheme": scheme}).changed(**{group: {key: 10**30}})


def test_all_whole_numbers_are_tried() -> None:
    assert {("contact", "max_iterations", "mts"), ("footloose", "seed", "quasi_static")} <= set(_whole_numbers())
