#!/usr/bin/env bash
# Install Riftberg for development and pass all checks: lint, types, tests. One command on a machine with plain Python 3.11.
#   bash check.sh            environment in .venv
#   RIFTBERG_VENV=DIR ...    environment elsewhere
#   RIFTBERG_WORKERS=N ...   processes that test side by side (2)
set -euo pipefail
cd "$(dirname "$0")"
venv="${RIFTBERG_VENV:-.venv}"
[ -x "$venv/bin/python" ] || "${PYTHON:-python3}" -m venv "$venv"
# Bytecode of the packages is written for what is imported, when it is imported: most of the files never are.
pip() { "$venv/bin/python" -m pip install --quiet --no-compile --constraint constraints.txt "$@"; }
pip --editable '.[dev]'
# Clouddrift still asks for zarr below 3, which today's xarray no longer takes; it uses none of it for what is tested here.
# Veros sets upper limits to packages that are here already in newer versions, with which it works.
pip --no-deps clouddrift veros loguru entrypoints h5netcdf h5py
"$venv/bin/ruff" format --check src tests benchmarks
"$venv/bin/ruff" check src tests benchmarks
# Some two hundred processes begin in the tests: none is to compile the sources anew.
unset PYTHONDONTWRITEBYTECODE
# Types are checked beside the tests, which they end where something is wrong with them.
trap 'kill $(jobs -p) 2>/dev/null || true' EXIT
"$venv/bin/mypy" &
# Kernels of both engines are compiled first: two processes of tests that begin with an empty cache would each compile all of them.
compile() { "$venv/bin/riftberg" run a68a --numerics "$1" --days 8 --quiet --no-map --output "$(mktemp -d)"; }
compile reference &
compile own
wait $!
# Two processes share the files of tests out between them.
# A process that dies ends the run: pytest-xdist would wait for ever for the files that it had.
"$venv/bin/python" -m pytest -n "${RIFTBERG_WORKERS:-2}" --dist loadfile --max-worker-restart 0 "$@" &
wait -n
wait -n
