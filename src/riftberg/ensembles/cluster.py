"""Where the members of a sweep are computed: in this process, on a cluster of this machine, or on a scheduler's workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from riftberg.ensembles.member import Job, Outcome, run_member
from riftberg.errors import InputError
from riftberg.system.process import SIGNALS, Hold

WAIT_SECONDS = 0.1
"""Wall time between two looks for members that are done."""

LOST_TIMES = 3
"""Workers that a member may be lost with before it counts as failed."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def connected(scheduler: Any = None, workers: int | None = None) -> Iterator[Any]:
    """Give a client of dask.distributed; a cluster of this machine is started and closed here."""
    try:
        import dask
        import distributed
    except ImportError as error:
        raise InputError(
            "a sweep on several workers needs dask.distributed", where="sweep",
            remedy="Install it: pip install 'riftberg[sweep]'; or give --workers 0",
        ) from error  # fmt: skip
    if isinstance(scheduler, distributed.Client):
        yield scheduler
        return
    if scheduler is not None:
        with _reached(distributed, str(scheduler)) as client:
            yield client
        return
    # A process that is being spawned reads the script anew; without the guard each would start a cluster.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError(
            "a worker read the script that starts the sweep, and would start another", where="sweep",
            remedy='Put the call under if __name__ == "__main__":',
        )  # fmt: skip
    alone = {
        "NUMBA_NUM_THREADS": 1, "OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1,
        # What a member reads in blocks of dask is computed in its own process; dask would send it round the cluster.
        "DASK_SCHEDULER": "synchronous",
    }  # fmt: skip
    settings = {
        "distributed.nanny.pre-spawn-environ": alone,
        "distributed.scheduler.allowed-failures": LOST_TIMES,
        "distributed.worker.daemon": True,
        # Its look at every worker a hundred times a second costs a member a tenth of its time, and nobody sees the result.
        "distributed.worker.profile.enabled": False,
        "logging.distributed": "critical",
    }
    with (
        dask.config.set(settings),
        distributed.LocalCluster(
            n_workers=workers or cores(), threads_per_worker=1, processes=True, silence_logs=50, memory_limit=0,
            # Without a dashboard dask still asks for the port of one, and warns where another cluster has it.
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):  # fmt: skip
        client.register_plugin(_deaf_worker(distributed))
        yield client


@contextmanager
def _reached(distributed: Any, address: str) -> Iterator[Any]:
    """Give a client of the scheduler at an address.

    It never becomes the default of dask: one that reaches nothing would stay it for as long as its error is kept, as
    notebooks do, and all that dask and xarray do afterwards would be sent to it.
    """
    try:
        client = distributed.Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            "no scheduler of dask answers there", where=f"--scheduler {address}",
            remedy="Start one with 'dask scheduler', workers with 'dask worker ADDRESS', and give its address",
        ) from error  # fmt: skip
    with client:
        yield client


def _deaf_worker(distributed: Any) -> Any:
    """Return what makes workers leave Ctrl-C and hang-ups to the process that started the sweep, which asks the members to stop.

    A plugin and no call, because a worker that takes the place of a lost one must be deaf too.
    """

    class Deaf(distributed.WorkerPlugin):  # type: ignore[misc]
        """Ignores interrupts."""

        def setup(self, worker: Any) -> None:
            with suppress(ValueError):  # not the main thread
                for number in SIGNALS:
                    if number != signal.SIGTERM:  # by which the cluster ends its workers
                        signal.signal(number, signal.SIG_IGN)

    return Deaf()


def computed(jobs: Sequence[Job], client: Any, hold: Hold) -> Iterator[Outcome]:
    """Give the outcomes of members as they come, until all have come or a signal waits."""
    if client is None:
        for job in jobs:
            if hold.requested:
                return
            yield run_member(job)
        return
    yield from _distributed(jobs, client, hold)


def _distributed(jobs: Sequence[Job], client: Any, hold: Hold) -> Iterator[Outcome]:
    import time

    from distributed import as_completed

    futures = {
        client.submit(run_member, job, pure=False, key=f"member-{job.number:05d}-{id(jobs)}"): job for job in jobs
    }
    coming = as_completed(list(futures), loop=client.loop)
    # Looked at now and then instead of waited for, so that a signal is not missed.
    while coming.count() or coming.has_ready():
        for future in coming.next_batch(block=False) if coming.has_ready() else ():
            job = futures.pop(future)
            yield _outcome(future, job)
            future.release()
        if hold.requested:
            yield from _ended(futures, client)
            return
        time.sleep(WAIT_SECONDS)


def _ended(futures: dict[Any, Job], client: Any) -> Iterator[Outcome]:
    """Drop the members that have not begun, and wait for the others, which save their states."""
    from distributed import wait

    running = {key for keys in client.processing().values() for key in keys}
    begun = [future for future in futures if future.key in running]
    client.cancel([future for future in futures if future.key not in running])
    with suppress(TimeoutError), client.as_current():
        wait(begun, timeout=60)
    for future in begun:
        if future.done() and not future.cancelled():
            yield _outcome(future, futures[future])


def _outcome(future: Any, job: Job) -> Outcome:
    """Return what a member came to, also where its workers were lost again and again."""
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    if type(error).__name__ == "KilledWorker":
        message = f"its worker was lost {LOST_TIMES + 1} times: killed, or out of memory"
        return Outcome(job.number, "failed", message)
    return Outcome(job.number, "failed", f"{type(error).__name__}: {' '.join(str(error).split())}")
