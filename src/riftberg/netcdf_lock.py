"""The one lock under which netCDF files are read and written: the library below is not safe in threads.

It may be taken again by the thread that holds it. A process is forked only while nobody holds it, so that the child
never waits for a thread that it does not have.
"""

from __future__ import annotations

import os
import threading
from typing import Final

NETCDF_LOCK: Final = threading.RLock()
"""Hold it around every call that opens, reads, writes or closes a netCDF file, and around the filling of what keeps
records of files in memory."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=NETCDF_LOCK.acquire, after_in_parent=NETCDF_LOCK.release, after_in_child=NETCDF_LOCK.release
    )
