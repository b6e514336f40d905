"""One kind of bad input, what the command line makes of it, and the verdict on that."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import resource
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dask

from riftberg.cli.main import app

EXIT_ERROR = 2
STUCK_AFTER = 60.0

REFUSED, HARMLESS, RIGHT, TOLD = "refused well", "accepted, harmless", "right value", "told before the run"
ACCEPTED, SILENT, TRACEBACK, HANG, VAGUE, REMAINS, REMOVED, LEAK, APART = (
    "accepted though impossible", "wrong in silence", "traceback", "hang or memory", "vague", "left something behind",
    "removed or changed what was there", "words of a library", "doctor and run disagree",
)  # fmt: skip
GOOD = (REFUSED, HARMLESS, RIGHT, TOLD)
BAD = (ACCEPTED, SILENT, TRACEBACK, HANG, VAGUE, REMAINS, REMOVED, LEAK, APART)
SECONDS = 240.0
"""Time after which a command counts as hanging; a scheme that is met for the first time compiles for a minute."""

SOON = 30.0
"""The same for kinds whose schemes have been compiled before (`fuzz.base_files.store`)."""

MEGABYTES = 1500.0
"""Memory by which the process may grow for one kind."""


@dataclass(frozen=True)
class Truth:
    """What is known of the result of a command that goes through.

    Attributes
    ----------
    wrong : callable
        Takes the folder and the output; returns what is wrong with the result, empty where it is right.
    told : tuple of str
        Regular expressions; a result that is not right is well if a notice has one of them.
    as_told : callable, optional
        Like ``wrong``, for the result that a notice announces; without it any will do.
    """

    wrong: Callable[[Path, str], str]
    told: tuple[str, ...] = ()
    as_told: Callable[[Path, str], str] | None = None


@dataclass(frozen=True)
class Kind:
    """One kind of bad input.

    Attributes
    ----------
    family : str
        Class of the fault.
    name : str
        What is wrong.
    make : callable
        Takes an empty folder, puts files there and returns the arguments of the command line.
    words : tuple of str
        One of these must stand in the message: file, key, variable or option.
    impossible : bool
        It must be refused; False where a mutation may happen to be harmless.
    truth : Truth, optional
        What the result must be where the command goes through.
    cause : tuple of str
        Regular expressions: the true reasons, one of which a refusal gives. Empty: any reason; ``NEVER``: there is none.
    always : callable, optional
        Takes the folder and returns what is wrong with it whatever the command said: what belongs to others has gone.
    seconds : float
        Time after which it counts as hanging.
    """

    family: str
    name: str
    make: Callable[[Path], list[str]]
    words: tuple[str, ...] = ()
    impossible: bool = True
    truth: Truth | None = None
    cause: tuple[str, ...] = ()
    always: Callable[[Path], str] | None = None
    seconds: float = SECONDS


NEVER = ("(?!)",)
"""No reason at all: what must be read."""


@dataclass
class Verdict:
    """What became of a kind."""

    kind: Kind
    what: str
    message: str = ""
    seconds: float = 0.0


@dataclass
class Result:
    """What the command line did."""

    code: int | None
    text: str
    error: BaseException | None = None
    told: list[str] = field(default_factory=list)


class TooLongError(BaseException):
    """A command took too long."""


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    def stop(number: int, frame: Any) -> None:
        raise TooLongError

    # Seconds of computing, so that a busy machine makes no kind hang; who only waits has eight times as many.
    clocks = ((signal.SIGPROF, signal.ITIMER_PROF, seconds), (signal.SIGALRM, signal.ITIMER_REAL, 8.0 * seconds))
    before = [signal.signal(number, stop) for number, _, _ in clocks]
    for _, clock, limit in clocks:
        signal.setitimer(clock, limit)
    try:
        yield
    finally:
        for (number, clock, _), old in zip(clocks, before, strict=True):
            signal.setitimer(clock, 0.0)
            signal.signal(number, old)


def call(arguments: list[str], seconds: float = SECONDS) -> Result:
    """Run the command line in this process."""
    out = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(out),
            _limited(seconds),
            warnings.catch_warnings(),
        ):
            # As in a process of its own: what a library warns of is seen by the person, what it deprecates is not.
            warnings.resetwarnings()
            for category in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
                warnings.simplefilter("ignore", category)
            app(arguments, standalone_mode=True)
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
        return Result(code, out.getvalue())
    except BaseException as error:
        return Result(None, out.getvalue(), error)
    return Result(0, out.getvalue())


_NOISE = re.compile(
    r"object at 0x|Traceback|\b(Key|Type|Value|Attribute|Index|Runtime|Assertion)Error\b|<class|pydantic|errno|"
    r"Input should be|validation errors? for|type=\w+(_|,)|errors\.pydantic|\bnumpy\.|dtype\(|NoneType|"
    r"unhashable|subscriptable|not iterable|broadcast together"
)
_GOES_ON = re.compile(r"last good state|to go on|--resume|holds .*records|good (up )?to", re.IGNORECASE)
"""A run that ended on its way keeps what it had, and says so."""

_WARNED = re.compile(r"^.*\b(?:Runtime|User|Future|Serialization|ComplexWarning|Dask)\w*Warning: .*$", re.MULTILINE)


def vague(text: str, words: tuple[str, ...]) -> str:
    """Return what is wrong with a message, empty where it is clear."""
    lines = [line for line in text.splitlines() if "Error" in line or "rror:" in line]
    if ("Usage:" in text and "Try" in text) or "╭─ Error" in text:
        return ""  # typer's own words for a call that it does not understand
    if not lines:
        return "no line says Error"
    message = text[text.rindex(lines[-1]) :].strip()  # with what else it tells below
    if _NOISE.search(message):
        return "speaks of the inside of the program"
    if len(message) > 1500:
        return "too long"
    if words and not any(word in message for word in words):
        return f"names none of {', '.join(words)}"
    if len(re.split(r"[.;:?] ", message.removeprefix("Error: "))) < 2:
        return "no remedy"
    return ""


def judge(kind: Kind, folder: Path) -> Verdict:
    """Put a kind to the command line and judge what comes."""
    folder.mkdir(parents=True)
    here = Path.cwd()
    os.chdir(folder)
    try:
        arguments = kind.make(folder)
        before = _listing(folder)
        memory, began = _megabytes(), time.process_time()
        result = call(arguments, kind.seconds)
        spent = time.process_time() - began
        after = _listing(folder)
        if isinstance(result.error, TooLongError) or spent > kind.seconds or _megabytes() - memory > MEGABYTES:
            return Verdict(kind, HANG, f"{spent:.0f} s, {_megabytes() - memory:.0f} MB: {' '.join(arguments)}", spent)
        if result.code is None or "Traceback" in result.text:
            told = "".join(traceback.format_exception(result.error)[-4:]) if result.error else result.text[-800:]
            return Verdict(kind, TRACEBACK, told, spent)
        if warned := _WARNED.search(result.text):
            return Verdict(kind, LEAK, warned[0][-300:], spent)
        if kind.always and (harm := kind.always(folder)):
            return Verdict(kind, REMOVED, f"{harm}: {result.text[-300:]}", spent)
        if result.code == 0 or (result.code == 1 and arguments[0] == "doctor"):
            return Verdict(kind, *_of_what_went_through(kind, folder, result), spent)
        fault = vague(result.text, kind.words)
        if not fault and kind.cause and not any(re.search(cause, result.text, re.IGNORECASE) for cause in kind.cause):
            fault = "not the true reason"
        if fault or result.code not in (2, 130):
            return Verdict(kind, VAGUE, f"{fault or f'exit code {result.code}'}: {result.text[-600:]}", spent)
        if gone := sorted(name for name, mark in before.items() if after.get(name) != mark):
            return Verdict(kind, REMOVED, f"{gone}: {result.text[-300:]}", spent)
        left = sorted(name for name in set(after) - set(before) if not (kind.always and after[name] is None))
        if left and not _GOES_ON.search(result.text):
            return Verdict(kind, REMAINS, f"{left}: {result.text[-300:]}", spent)
        return Verdict(kind, REFUSED, result.text.strip()[-300:], spent)
    finally:
        os.chdir(here)


def _of_what_went_through(kind: Kind, folder: Path, result: Result) -> tuple[str, str]:
    """Return verdict and message on a command that was carried out."""
    if kind.truth is None:
        return ACCEPTED if kind.impossible and result.code == 0 else HARMLESS, result.text[-300:]
    wrong = kind.truth.wrong(folder, result.text)
    if not wrong:
        return RIGHT, result.text[-300:]
    if wrong.startswith(APART):
        return APART, wrong
    notices = [line for line in result.text.splitlines() if line.lstrip().lower().startswith(("notice", "warning"))]
    said = [line for line in notices if any(re.search(told, line, re.IGNORECASE) for told in kind.truth.told)]
    if said and not (fault := kind.truth.as_told(folder, result.text) if kind.truth.as_told else ""):
        return TOLD, said[0]
    return SILENT, f"{wrong}{f'; and not as told: {fault}' if said else ''}; said: {' | '.join(notices)[:400]}"


def judge_apart(kind: Kind, folder: Path) -> Verdict:
    """As `judge`, in a process of its own: a library that dies of damaged bytes, or never comes back, is a verdict too."""
    folder.mkdir(parents=True)
    answer, said = folder.parent / f"{folder.name}.verdict", folder.parent / f"{folder.name}.txt"
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        with open(said, "wb") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        # A child has none of its parent's threads: dask's pool, once used before the fork, would wait for them for ever.
        dask.config.set(scheduler="synchronous")
        verdict = judge(kind, folder / "in")
        answer.write_text(json.dumps([verdict.what, verdict.message, verdict.seconds]))
        os._exit(0)
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() - began > 8.0 * kind.seconds + 60.0:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.005)
    spent = time.monotonic() - began
    text = said.read_text(errors="replace")
    told = json.loads(answer.read_text()) if answer.exists() else []
    said.unlink()
    answer.unlink(missing_ok=True)
    if told:
        return Verdict(kind, *told)
    if os.waitstatus_to_exitcode(ended[1]) == EXIT_ERROR and spent > STUCK_AFTER:
        return Verdict(kind, REFUSED, "has not opened", spent)  # what it said went where `call` caught it
    return Verdict(kind, HANG if spent > 8.0 * kind.seconds else TRACEBACK, f"the process died: {text[-600:]}", spent)


def _listing(folder: Path) -> dict[str, object]:
    """Return all names in a folder, with size and time of change of what is a file."""
    marks: dict[str, object] = {}
    for path in folder.rglob("*"):
        status = path.lstat()
        marks[str(path.relative_to(folder))] = (status.st_size, status.st_mtime_ns) if path.is_file() else None
    return marks


def _megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def flipped(data: bytes, seed: int, *, where: tuple[int, int] | None = None, count: int = 3) -> bytes:
    """Return bytes with some changed, cut out or doubled, as a seed says."""
    rng = random.Random(seed)
    low, high = where or (0, len(data))
    changed = bytearray(data)
    for _ in range(count):
        place = rng.randrange(low, min(high, len(changed)))
        way = rng.random()
        if way < 0.6:
            changed[place] ^= 1 << rng.randrange(8)
        elif way < 0.8:
            changed[place] = rng.randrange(256)
        elif way < 0.9:
            del changed[place : place + rng.randrange(1, 9)]
        else:
            changed[place:place] = bytes(rng.randrange(256) for _ in range(rng.randrange(1, 5)))
    return bytes(changed)
