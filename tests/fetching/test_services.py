"""Fetching from data services through their clients: what is asked, what comes, missing clients and logins. No network."""

from __future__ import annotations

import base64
import sys
import types
from pathlib import Path

import pytest

pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")

from fetching.fake_clients import Cdsapi, Copernicusmarine, Earthaccess
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.fetching import services
from riftberg.fetching.services import fetch_product
from riftberg.ocean.doctor import doctor

PLACE = {"lon": (-43.0, -33.0), "lat": (-59.0, -53.0), "time": ("2020-12-09", "2020-12-25")}
EXTRAS = {"earthaccess": "oscar", "copernicusmarine": "copernicus", "cdsapi": "era5"}
CLIENTS = [("oscar", "earthaccess"), ("glorys", "copernicusmarine"), ("duacs", "copernicusmarine"), ("era5", "cdsapi")]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home of someone without any login: an empty folder, and no variables."""
    names = ("EARTHDATA_TOKEN", "EARTHDATA_USERNAME", "EARTHDATA_PASSWORD", "NETRC")
    more = ("COPERNICUSMARINE_SERVICE_USERNAME", "COPERNICUSMARINE_SERVICE_PASSWORD")
    for name in (*names, *more, "COPERNICUSMARINE_CREDENTIALS_DIRECTORY", "CDSAPI_URL", "CDSAPI_KEY", "CDSAPI_RC"):
        monkeypatch.delenv(name, raising=False)
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.setattr(Path, "home", lambda: folder)
    return folder


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> object:
    """Install a stand-in of a client."""

    def install(module: types.ModuleType) -> None:
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(services, "find_spec", lambda package: object() if package == module.__name__ else None)

    return install


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """Someone who is known to every service."""
    for name in ("EARTHDATA_TOKEN", "COPERNICUSMARINE_SERVICE_USERNAME", "COPERNICUSMARINE_SERVICE_PASSWORD"):
        monkeypatch.setenv(name, "something")
    monkeypatch.setenv("CDSAPI_URL", "https://cds.climate.copernicus.eu/api")
    monkeypatch.setenv("CDSAPI_KEY", "something")


# ---- clients and logins ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "package"), CLIENTS)
def test_missing_client_is_named(name: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "find_spec", lambda package: None)
    with pytest.raises(ForcingError, match=rf"{package} is not installed.*pip install 'riftberg\[{EXTRAS[package]}\]'"):
        fetch_product(name, tmp_path, **PLACE)  # type: ignore[arg-type]


def test_the_extras_that_messages_name_are_there() -> None:
    tomllib = pytest.importorskip("tomllib")
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    for package, extra in EXTRAS.items():
        assert any(needed.startswith(package) for needed in project["optional-dependencies"][extra])


@pytest.mark.parametrize(("name", "package"), CLIENTS)
def test_missing_login_says_where_to_get_one(name: str, package: str, tmp_path: Path, installed) -> None:
    installed(types.ModuleType(package))
    with pytest.raises(ForcingError, match=r"wants a login and none was found.*Make a free account at https://"):
        fetch_product(name, tmp_path, **PLACE)  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "package"), CLIENTS[:3])
def test_a_netrc_for_other_machines_is_no_login(name: str, package: str, home: Path, tmp_path: Path, installed) -> None:
    installed(types.ModuleType(package))
    text = "machine ftp.example.org login someone password something\n"
    (home / ".netrc").write_text(text + "machine urs.earthdata.nasa.gov login someone\n")
    with pytest.raises(ForcingError, match="wants a login and none was found"):
        fetch_product(name, tmp_path, **PLACE)  # type: ignore[arg-type]


@pytest.mark.parametrize("place", ["home", "variable"])
def test_a_netrc_for_earthdata_is_a_login(
    place: str, home: Path, tmp_path: Path, installed, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = Earthaccess()
    installed(client)
    path = home / (".netrc" if place == "home" else "logins")
    path.write_text("machine urs.earthdata.nasa.gov login someone password something\n")
    if place == "variable":
        monkeypatch.setenv("NETRC", str(path))
    assert len(fetch_product("oscar", tmp_path, **PLACE)) == 2
    assert client.asked["strategy"] == "netrc"


def test_a_netrc_that_cannot_be_read_is_explained(home: Path, tmp_path: Path, installed) -> None:
    installed(Earthaccess())
    (home / ".netrc").write_text("machine urs.earthdata.nasa.gov login someone secret something\n")
    with pytest.raises(ForcingError, match=r"\.netrc: cannot be read .*Mend that line"):
        fetch_product("oscar", tmp_path, **PLACE)


@pytest.mark.parametrize("variables", [("EARTHDATA_TOKEN",), ("EARTHDATA_USERNAME", "EARTHDATA_PASSWORD")])
def test_variables_are_a_login_for_earthdata(
    variables: tuple[str, ...], tmp_path: Path, installed, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = Earthaccess()
    installed(client)
    for name in variables:
        monkeypatch.setenv(name, "something")
    fetch_product("oscar", tmp_path, **PLACE)
    assert client.asked["strategy"] == "environment"
    monkeypatch.setenv(variables[-1], "")
    with pytest.raises(ForcingError, match="none was found"):
        fetch_product("oscar", tmp_path, **PLACE)


def copernicus_file(folder: Path, text: str) -> None:
    path = folder / ".copernicusmarine" / ".copernicusmarine-credentials"
    path.parent.mkdir(parents=True)
    path.write_text(base64.standard_b64encode(text.encode()).decode())


FULL = "[credentials]\nusername=someone\npassword=something\n"


@pytest.mark.parametrize("place", ["home", "variable", "netrc"])
def test_places_of_a_login_for_copernicus(
    place: str, home: Path, tmp_path: Path, installed, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(Copernicusmarine())
    if place == "netrc":
        (home / ".netrc").write_text("machine auth.marine.copernicus.eu login someone password something\n")
    else:
        folder = home if place == "home" else tmp_path / "elsewhere"
        copernicus_file(folder, FULL)
        if place == "variable":
            monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(folder))
    assert fetch_product("duacs", tmp_path, **PLACE)[0].exists()


@pytest.mark.parametrize("text", ["[credentials]\nusername=someone\n", "nothing", ""])
def test_a_copernicus_file_without_a_login_is_none(text: str, home: Path, tmp_path: Path, installed) -> None:
    installed(Copernicusmarine())
    copernicus_file(home, text)
    with pytest.raises(ForcingError, match="copernicusmarine login"):
        fetch_product("duacs", tmp_path, **PLACE)


def test_a_copernicus_folder_alone_is_no_login(home: Path, tmp_path: Path, installed) -> None:
    installed(Copernicusmarine())
    (home / ".copernicusmarine").mkdir()  # the client keeps other things there as well
    with pytest.raises(ForcingError, match="none was found"):
        fetch_product("duacs", tmp_path, **PLACE)


URL, KEY = "url: https://cds.climate.copernicus.eu/api\n", "key: something\n"


@pytest.mark.parametrize(
    ("text", "variables", "lacks"),
    [
        (URL + KEY, (), ""),
        (URL, (), "lacks key"),
        (URL, ("CDSAPI_KEY",), ""),
        (URL + "key:\n", (), "lacks key"),
        ("", ("CDSAPI_KEY",), "lacks url"),
        ("", ("CDSAPI_URL", "CDSAPI_KEY"), ""),
    ],
)
def test_places_of_a_key_for_the_climate_data_store(
    text: str, variables: tuple[str, ...], lacks: str, home: Path, tmp_path: Path, installed,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    installed(Cdsapi())
    (home / ".cdsapirc").write_text(text)
    for name in variables:
        monkeypatch.setenv(name, "something")
    if lacks:
        with pytest.raises(ForcingError, match=f"none was found; .*{lacks}"):
            fetch_product("era5", tmp_path, **PLACE)
    else:
        assert fetch_product("era5", tmp_path, **PLACE)[0].exists()


@pytest.mark.parametrize("way", ["environment", "netrc"])
def test_earthdata_that_refuses_the_login(
    way: str, home: Path, tmp_path: Path, installed, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(Earthaccess(granted=False))
    if way == "environment":
        monkeypatch.setenv("EARTHDATA_TOKEN", "expired")
    else:
        (home / ".netrc").write_text("machine urs.earthdata.nasa.gov login someone password something\n")
    with pytest.raises(ForcingError, match="refused the login"):
        fetch_product("oscar", tmp_path, **PLACE)


# ---- what comes ------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("known")
def test_oscar_comes_and_serves_the_doctor(tmp_path: Path, installed) -> None:
    client = Earthaccess()
    installed(client)
    paths = fetch_product("oscar", tmp_path, **PLACE)
    assert [path.name for path in paths] == ["oscar_currents_final_20201216.nc", "oscar_currents_final_20201217.nc"]
    assert client.asked["short_name"] == "OSCAR_L4_OC_FINAL_V2.0"
    assert client.asked["temporal"] == ("2020-12-09", "2020-12-25")
    assert {"uo", "vo"} <= given(paths)


@pytest.mark.usefixtures("known")
def test_oscar_of_days_that_are_not_there(tmp_path: Path, installed) -> None:
    installed(Earthaccess(found=False))
    with pytest.raises(ForcingError, match=r"no OSCAR file for 2020-12-09\.\.2020-12-25"):
        fetch_product("oscar", tmp_path, **PLACE)


def given(paths: list[Path]) -> set[str]:
    """Return the fields that the doctor finds in files."""
    report = doctor(paths)
    assert all(data.product for data in report.data)
    return {field.name for data in report.data for field in data.fields}


@pytest.mark.usefixtures("known")
@pytest.mark.parametrize(
    ("name", "fields", "gives"),
    [
        ("glorys", (), {"uo", "vo", "ssh"}),
        ("glorys", ("ice", "currents"), {"uo", "vo", "ice_fraction", "ice_thickness", "ui", "vi"}),
        ("duacs", (), {"ssh"}),
    ],
)
def test_copernicus_comes_and_serves_the_doctor(
    name: str, fields: tuple[str, ...], gives: set[str], tmp_path: Path, installed
) -> None:
    client = Copernicusmarine()
    installed(client)
    paths = fetch_product(name, tmp_path, **PLACE, fields=fields, depth=200.0)  # type: ignore[arg-type]
    assert given(paths) == gives
    (asked,) = client.asked
    assert (asked["minimum_longitude"], asked["maximum_latitude"]) == (-43.0, -53.0)
    assert asked["maximum_depth"] == (200.0 if name == "glorys" else None)
    assert (asked["start_datetime"], asked["end_datetime"]) == ("2020-12-09T00:00:00", "2020-12-25T23:59:59")
    assert asked["coordinates_selection_method"] == "outside"
    assert fetch_product(name, tmp_path, **PLACE, fields=fields, depth=200.0) == paths  # type: ignore[arg-type]
    # What is there is not asked for again. Files are named by days: other hours of them found a file without these hours.
    hours = {**PLACE, "time": ("2020-12-09T13:00", "2020-12-25T18:00")}
    assert fetch_product(name, tmp_path, **hours, fields=fields, depth=200.0) == paths  # type: ignore[arg-type]
    assert len(client.asked) == 1
    fetch_product(name, tmp_path, **{**PLACE, "lon": (-43.0, -34.0)}, fields=fields)  # type: ignore[arg-type]
    assert len(client.asked) == 2


@pytest.mark.usefixtures("known")
def test_duacs_currents_are_asked_for_by_name(tmp_path: Path, installed) -> None:
    client = Copernicusmarine()
    installed(client)
    (path,) = fetch_product("duacs", tmp_path, **PLACE, fields=("ssh", "currents"))
    assert client.asked[0]["dataset_id"] == "cmems_obs-sl_glo_phy-ssh_my_allsat-l4-duacs-0.125deg_P1D"
    assert client.asked[0]["variables"] == ["adt", "ugos", "vgos"]
    assert {"ssh", "uo", "vo"} <= set(open_product(path, product="duacs-geostrophic").data_vars)


@pytest.mark.usefixtures("known")
def test_a_broken_subset_is_written_over(tmp_path: Path, installed) -> None:
    installed(Copernicusmarine())
    (path,) = fetch_product("duacs", tmp_path, **PLACE)
    path.write_bytes(path.read_bytes()[:500])
    assert fetch_product("duacs", tmp_path, **PLACE) == [path]
    assert given([path]) == {"ssh"}


@pytest.mark.usefixtures("known")
def test_copernicus_that_gives_nothing(tmp_path: Path, installed) -> None:
    client = Copernicusmarine()
    client.gives_up = True
    installed(client)
    with pytest.raises(ForcingError, match="Copernicus Marine gave no file"):
        fetch_product("duacs", tmp_path, **PLACE)


@pytest.mark.usefixtures("known")
@pytest.mark.parametrize("zipped", [False, True])
def test_era5_comes_and_serves_the_doctor(zipped: bool, tmp_path: Path, installed) -> None:
    client = Cdsapi(zipped=zipped)
    installed(client)
    (wind,) = fetch_product("era5", tmp_path, **PLACE)
    assert given([wind]) == {"ua", "va"}
    (asked,) = client.asked
    assert asked["area"] == [-53.0, -43.0, -59.0, -33.0]  # north, west, south, east
    assert (asked["date"], len(asked["time"])) == ("2020-12-09/2020-12-25", 24)
    paths = fetch_product("era5", tmp_path, **PLACE, fields=("waves", "wind", "ice"))
    assert len(client.asked) == 3  # the wind was there
    assert given(paths) == {"ua", "va", "wave_height", "wave_period", "wave_direction", "ice_fraction"}
    assert sorted(tmp_path.glob("*.nc")) == sorted(paths)
    assert not list(tmp_path.glob("*.answer"))


@pytest.mark.usefixtures("known")
def test_a_refusal_of_the_climate_data_store_is_passed_on(tmp_path: Path, installed) -> None:
    installed(Cdsapi(fault="403 Client Error: required licences not accepted"))
    with pytest.raises(ForcingError, match=r"required licences not accepted.*accept the licence on the page"):
        fetch_product("era5", tmp_path, **PLACE)
    assert not list(tmp_path.glob("*.nc"))


def test_unknown_services_and_fields(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="Choose one of: oscar, glorys"):
        fetch_product("hycom", tmp_path, **PLACE)  # type: ignore[arg-type]
    with pytest.raises(ForcingError, match=r"era5 has no field 'rain' here\. Choose from: wind, waves, ice"):
        fetch_product("era5", tmp_path, **PLACE, fields=("rain",))
    with pytest.raises(ForcingError, match="days are needed"):
        fetch_product("era5", tmp_path, PLACE["lon"], PLACE["lat"])  # type: ignore[arg-type]
