"""Imported once by the process that pages are forked from (`pages`): what it has loaded, each of them need not load."""

import matplotlib.pyplot  # noqa: F401
import scipy.sparse.linalg
import scipy.spatial  # noqa: F401
import xarray  # noqa: F401

import riftberg.cli.run
import riftberg.viz.style  # noqa: F401
from riftberg import build

build("a68a")[0].step()
