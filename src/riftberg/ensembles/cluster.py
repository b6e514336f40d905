"""Where the members of a sweep are computed: in this process, in several of this machine, or by the workers of a scheduler."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from itertools import islice
from multiprocessing import spawn
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, Final

from riftberg.ensembles.member import Job, Outcome, run_member
from riftberg.errors import InputError
from riftberg.system.process import SETTINGS, SIGNALS, Hold

WAIT_SECONDS = 0.1
"""Wall time between two looks for members that are done."""

MOST_SENT: Final = 1000
"""Members that a scheduler knows at once: more than it has workers, and no more memory however many there are."""

LOST_TIMES = 3
"""Workers that a member may be lost with before it counts as failed."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def connect_client(scheduler: Any) -> Iterator[Any]:
    """Give a client of dask.distributed for the address of a scheduler; a client itself passes through unchanged."""
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "a scheduler of dask needs dask.distributed", where="sweep",
            remedy="Install it: pip install 'riftberg[sweep]'; or leave --scheduler out, and give --workers",
        ) from error  # fmt: skip
    if isinstance(scheduler, distributed.Client):
        yield scheduler
        return
    # It never becomes the default of dask: one that reaches nothing would stay it for as long as its error is kept, as
    # notebooks do, and all that dask and xarray do afterwards would be sent to it.
    try:
        client = distributed.Client(str(scheduler), timeout="10s", set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            "no scheduler of dask answers there", where=f"--scheduler {scheduler}",
            remedy="Start one with 'dask scheduler', workers with 'dask worker ADDRESS', and give its address",
        ) from error  # fmt: skip
    with client:
        yield client


def compute_members(jobs: Iterable[Job], client: Any, workers: int, hold: Hold) -> Iterator[Outcome]:
    """Give the outcomes of members as they come, until all have come or a signal waits.

    ``client``: of dask, or None for ``workers`` processes of this machine; 0 runs one member after another in this one.
    """
    if client is not None:
        yield from _run_distributed(jobs, client, hold)
    elif workers:
        yield from (_outcome(future, job) for future, job in run_pool(run_member, jobs, workers, hold))
    else:
        for job in jobs:
            if hold.requested:
                return
            yield run_member(job)


ALONE: Final = {
    "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
    # What a member reads in blocks of dask is computed in its own process; dask would begin threads for it.
    "DASK_SCHEDULER": "synchronous",
}  # fmt: skip
"""Environment of a process that runs one member at a time."""


def run_pool(
    function: Callable[[Any], Any], jobs: Iterable[Any], workers: int, hold: Hold
) -> Iterator[tuple[Any, Any]]:
    """Run a function of each job in processes of the standard library; give the futures as they end, with their jobs.

    As many jobs are under way as there are processes, so the jobs that may have ended a lost process are known:
    other processes run them again, up to `LOST_TIMES` times. After a signal, jobs under way finish and no more begin.
    """
    # A process that reads the script anew would, where the guard is missing, start processes of its own.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise InputError(
            "a worker read the script that starts the sweep, and would start another", where="sweep",
            remedy='Put the call under if __name__ == "__main__":',
        )  # fmt: skip
    # Of jobs that are made when they are asked for, there are no more in memory than processes have.
    waiting, lost = Line(jobs), Counter[int]()
    earlier = set(multiprocessing.active_children())
    script = _script_needed(function, waiting)
    context = multiprocessing.get_context("spawn") if script else _Apart()
    started = context.Event()
    with _environment(ALONE):
        while waiting and not hold.requested:
            executor = ProcessPoolExecutor(workers, context, initializer=_begin_worker, initargs=(started,))
            try:
                for future, job in _submit_all(executor, function, waiting, workers, hold):
                    if script and future.exception() is not None and not started.is_set():
                        raise InputError(
                            f"no worker has begun: each reads {script} anew, and that failed", where="sweep",
                            remedy='Put the call under if __name__ == "__main__":, install cloudpickle, or give workers=0',
                        )  # fmt: skip
                    if isinstance(future.exception(), BrokenProcessPool) and lost[id(job)] < LOST_TIMES:
                        lost[id(job)] += 1
                        waiting.again.append(job)
                    else:
                        lost.pop(id(job), None)  # the next job may have its place in memory
                        yield future, job
            except BaseException:  # a second Ctrl-C, or the caller wants no more: nobody waits for the members
                for process in set(multiprocessing.active_children()) - earlier:
                    process.terminate()
                raise
            finally:
                executor.shutdown(cancel_futures=True)


class _Process(SpawnProcess):
    """Process that does not read the script that starts it: a script without a main guard would do all its work anew in it."""

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802
        with SETTINGS:
            original, thread = spawn.get_preparation_data, threading.get_ident()

            def without_script(name: str) -> dict[str, Any]:
                data = original(name)
                return {
                    k: v for k, v in data.items() if not k.startswith("init_main") or threading.get_ident() != thread
                }

            spawn.get_preparation_data = without_script
            try:
                return SpawnProcess._Popen(process_obj)
            finally:
                spawn.get_preparation_data = original


class _Apart(SpawnContext):
    Process = _Process


def _script_needed(function: Callable[[Any], Any], waiting: Line) -> str:
    """Return the script that processes must read for the jobs; empty where jobs name nothing of it, or bring it along."""
    if not waiting:
        return ""
    first = waiting.next()
    waiting.again.append(first)
    if b"__main__" not in _pack_call(function, first) or sys.modules.get("cloudpickle") is not None:
        return ""
    main = sys.modules["__main__"]
    script = getattr(main, "__file__", None)
    if script is None or not os.path.exists(script):  # a notebook, a prompt, a script from a pipe
        raise InputError(
            "the function that makes the models stands in no file that other processes could read", where="sweep",
            remedy="Define it in a module, install cloudpickle, or give workers=0",
        )  # fmt: skip
    return str(script)


class Line:
    """Jobs that wait; those that are done again come first."""

    def __init__(self, jobs: Iterable[Any]) -> None:
        self._jobs, self.again = iter(jobs), list[Any]()

    def __bool__(self) -> bool:
        self.again += [] if self.again else islice(self._jobs, 1)
        return bool(self.again)

    def next(self) -> Any:
        """Return the job that comes next."""
        return self.again.pop() if self else None


def _submit_all(
    executor: ProcessPoolExecutor, function: Callable[[Any], Any], waiting: Line, workers: int, hold: Hold
) -> Iterator[tuple[Any, Any]]:
    """Send jobs through an executor and give the futures that have ended, until none is left or the executor is broken."""
    flying: dict[Any, Any] = {}
    ended: list[tuple[Any, Any]] = []
    broken = False
    while flying or ended or (waiting and not (broken or hold.requested)):
        while len(flying) < workers and not (broken or hold.requested) and waiting:
            job = waiting.next()
            try:
                flying[executor.submit(_run_packed, _pack_call(function, job))] = job
            except BrokenProcessPool:
                waiting.again.append(job)
                broken = True
        yield from ended  # while the next ones are on their way: no process waits for what is done with these
        # Looked at now and then, so that a signal is not missed.
        completed = wait(flying, timeout=WAIT_SECONDS, return_when=FIRST_COMPLETED).done
        ended = [(future, flying.pop(future)) for future in completed]
        broken = broken or any(isinstance(future.exception(), BrokenProcessPool) for future, _ in ended)


def _pack_call(function: Callable[[Any], Any], job: Any) -> bytes:
    """Return a call as bytes; functions of a notebook travel too where cloudpickle is installed (dask needs it)."""
    try:
        import cloudpickle as pickler
    except ImportError:
        pickler = pickle
    try:
        return bytes(pickler.dumps((function, job)))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            "the function that makes the models cannot be sent to other processes", where="sweep",
            remedy="Define it at the top of a module, install cloudpickle, or give workers=0",
        ) from error  # fmt: skip


def _run_packed(packed: bytes) -> Any:
    function, job = pickle.loads(packed)
    return function(job)


def _begin_worker(started: Any) -> None:
    """Ignore Ctrl-C and hang-ups (the parent asks the members to stop), and exit when the parent does."""
    started.set()
    # To look for cycles among all that numba and xarray have loaded takes a tenth of a second each time.
    gc.set_threshold(20_000)
    for number in SIGNALS:
        if number != signal.SIGTERM:  # by which the members are ended
            signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_exit_after_parent, args=(parent,), daemon=True).start()


def _exit_after_parent(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables of the environment, which processes that are started meanwhile inherit."""
    previous = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in previous.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _run_distributed(jobs: Iterable[Job], client: Any, hold: Hold) -> Iterator[Outcome]:
    import time

    from distributed import as_completed

    futures: dict[Any, Job] = {}
    coming = as_completed(loop=client.loop)
    jobs = iter(jobs)

    def send(count: int) -> None:
        for job in islice(jobs, count):
            future = client.submit(run_member, job, pure=False, key=f"member-{job.number:05d}-{id(futures)}")
            futures[future] = job
            coming.add(future)

    send(MOST_SENT)
    # Looked at now and then instead of waited for, so that a signal is not missed.
    while coming.count() or coming.has_ready():
        for future in coming.next_batch(block=False) if coming.has_ready() else ():
            job = futures.pop(future)
            send(1)
            yield _outcome(future, job)
            future.release()
        if hold.requested:
            yield from _drain_members(futures, client)
            return
        time.sleep(WAIT_SECONDS)


def _drain_members(futures: dict[Any, Job], client: Any) -> Iterator[Outcome]:
    """Drop the members that have not begun, and wait for the others, which save their states."""
    import distributed

    running = {key for keys in client.processing().values() for key in keys}
    unfinished = [future for future in futures if future.key in running]
    client.cancel([future for future in futures if future.key not in running])
    with suppress(TimeoutError), client.as_current():
        distributed.wait(unfinished, timeout=60)
    for future in unfinished:
        if future.done() and not future.cancelled():
            yield _outcome(future, futures[future])


def _outcome(future: Any, job: Job) -> Outcome:
    """Return the outcome of a member, also where its workers were lost repeatedly."""
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    if isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker":
        message = f"its worker was lost {LOST_TIMES + 1} times: killed, or out of memory"
        return Outcome(job.number, "failed", message)
    return Outcome(job.number, "failed", f"{type(error).__name__}: {' '.join(str(error).split())}")
