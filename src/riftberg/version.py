"""The version, where every room can read it; a build from a git checkout writes that of its tag here (``hatch_build.py``)."""

__version__ = "0.2.0"
