#!/usr/bin/env bash
# What the hosted workflows do, in one place, so that each job can be run on any machine first:
#   bash .github/jobs.sh install     this repository with all that its checks need, into the Python at hand
#   bash .github/jobs.sh tests       the quick tests
#   bash .github/jobs.sh coverage    lines and branches reached without compilation: coverage.xml
#   bash .github/jobs.sh docs        the site, in build/site
#   bash .github/jobs.sh package     sdist and wheel, in dist
#   bash .github/jobs.sh paper       the article, in build/paper.pdf
#   bash .github/jobs.sh placeholders   fails while something that only people can say is not filled in
set -euo pipefail
cd "$(dirname "$0")/.."

install() {
  # The pinned versions are those of Python 3.11; other Pythons take what is newest for them.
  local pins=()
  if python -c 'import sys; raise SystemExit(sys.version_info[:2] != (3, 11))'; then pins=(--constraint constraints.txt); fi
  python -m pip install --quiet "${pins[@]+"${pins[@]}"}" --editable '.[dev]'
  # As in check.sh: neither agrees with the newest versions of what it asks for, and both work with them.
  python -m pip install --quiet --no-deps clouddrift veros loguru entrypoints h5netcdf h5py
}

tests() {
  python -m pytest -n 2 --dist loadfile --max-worker-restart 0 "$@"
}

coverage() {
  # Compiled code is not seen by coverage, so kernels run as plain Python.
  NUMBA_DISABLE_JIT=1 python -m pytest -n 2 --dist loadfile --cov --cov-report xml --cov-report term:skip-covered "$@"
}

docs() {
  python docs/build.py --site "$@"
  python -m pytest -m slow tests/test_docs.py -k howto  # pages of ensembles, which the quick tests leave out
}

package() {
  rm -rf dist build/machine_code
  # With the machine code of the kernels, so that who installs the wheel compiles nothing.
  python benchmarks/machine_code.py build/machine_code
  RIFTBERG_MACHINE_CODE="$PWD/build/machine_code" python -m build "$@"
  python -m twine check --strict dist/*
}

paper() {
  python paper/build.py build/paper.pdf
}

placeholders() {
  python docs/release.py left
}

"$@"
