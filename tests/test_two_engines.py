"""What the explicit engine had of the default one is gone: refused with what to write now, left out of Riftberg's own files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from riftberg import Parameters
from riftberg.ensembles.vary import varied_of
from riftberg.errors import InputError
from riftberg.experiments.changes import changed, parse_settings
from riftberg.experiments.yaml_file import read_file
from riftberg.parameters import A68A_2022_KID
from riftberg.runs.layout import read_parameters

MTS = {"stepping": {"scheme": "mts"}}
GONE = [
    ("contact", "law", "crushing", "faces crush with stepping.scheme = 'quasi_static', springs act with the other"),
    ("contact", "law", "spring", "faces crush with stepping.scheme = 'quasi_static', springs act with the other"),
    ("bonds", "elasticity", "isotropic", "'isotropic' is not possible.*(Allowed|none): 'bonds', 'cells' or none"),
    ("damage", "enabled", True, "set stepping.scheme = 'quasi_static'.* or damage.enabled = false"),
]
each = pytest.mark.parametrize(("group", "key", "value", "now"), GONE)


@each
def test_what_is_gone_is_refused_with_what_to_write_now(
    tmp_path: Path, group: str, key: str, value: Any, now: str
) -> None:
    """In Python, by --set, in sweeps and in files alike."""
    word = str(value).lower()
    with pytest.raises(InputError, match=now):
        Parameters(**MTS, **{group: {key: value}})
    with pytest.raises(InputError, match=now):
        changed(Parameters(**MTS), parse_settings([f"{group}.{key}={word}"]))
    path = tmp_path / "slab.yaml"
    path.write_text(
        "start: 2020-12-09 13:00\ndays: 1\n"
        "berg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39.0, -55.5]}\n"
        "forcing: {kind: constant, current: [0.2, 0.0], depth: 1 km}\n"
        f"parameters:\n  stepping: {{scheme: mts}}\n  {group}: {{{key}: {word}}}\n"
    )
    with pytest.raises(InputError, match=now):
        read_file(path)
    if key == "law":
        with pytest.raises(InputError, match=f"any more.*{now}"):
            varied_of([f"{group}.{key}={word}"])


def written(p: Parameters, **groups: dict[str, Any]) -> str:
    """Return parameters as a file of the version before has them."""
    values = p.model_dump(mode="json")
    values["contact"]["law"] = None
    for group, inner in groups.items():
        values[group] |= inner
    return json.dumps(values)


@each
def test_files_that_had_it_open_and_no_run_goes_on_with_it(group: str, key: str, value: Any, now: str) -> None:
    explicit, file = Parameters(**MTS, bonds={"no_shear": True}), Path("a.restart.nc")
    old = written(explicit, **{group: {key: value}})
    assert read_parameters(old, file) == explicit
    if value == "spring":  # the law that acts
        assert read_parameters(old, file, goes_on=True) == explicit
    else:
        with pytest.raises(InputError, match=now):
            read_parameters(old, file, goes_on=True)


@pytest.mark.parametrize("law", ["dem", "spring"])
def test_a_run_whose_bonds_were_isotropic_by_default_does_not_go_on(law: str) -> None:
    """Its file names no elasticity, and would go on with other bonds without a word."""
    old = written(Parameters(**MTS, bonds={"law": law}, fracture={"enabled": law == "dem"}))
    file = Path("a.restart.nc")
    with pytest.raises(InputError, match=r"bonds\.elasticity: 'isotropic' is not possible"):
        read_parameters(old, file, goes_on=True)
    assert read_parameters(old, file).bonds.elasticity is None
    for kept in (A68A_2022_KID, Parameters(), Parameters(**MTS, bonds={"law": "spring", "spring": 1e-4})):
        assert read_parameters(written(kept), file, goes_on=True) == kept
