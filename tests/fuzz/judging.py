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

from riftberg.cli.failures import EXIT_ERROR
from riftberg.cli.main import app
from riftberg.stuck import STUCK_AFTER

REFUSED, ACCEPTED, HARMLESS, TRACEBACK, HANG, VAGUE, REMAINS = (
    "refused well", "accepted though impossible", "accepted, harmless", "traceback", "hang or memory", "vague",
    "left something behind",
)  # fmt: skip
BAD = (ACCEPTED, TRACEBACK, HANG, VAGUE, REMAINS)
SECONDS = 240.0
"""Time after which a command counts as hanging; a scheme that is met for the first time compiles for a minute."""

MEGABYTES = 1500.0
"""Memory by which the process may grow for one kind."""


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
    """

    family: str
    name: str
    make: Callable[[Path], list[str]]
    words: tuple[str, ...] = ()
    impossible: bool = True


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

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


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
            warnings.simplefilter("ignore")
            app(arguments, standalone_mode=True)
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 0 if stop.code is None else 1
        return Result(code, out.getvalue())
    except BaseException as error:
        return Result(None, out.getvalue(), error)
    return Result(0, out.getvalue())


_NOISE = re.compile(
    r"object at 0x|Traceback|\b(Key|Type|Value|Attribute|Index|Runtime|Assertion)Error\b|<class|pydantic|errno"
)


def vague(text: str, words: tuple[str, ...]) -> str:
    """Return what is wrong with a message, empty where it is clear."""
    lines = [line for line in text.splitlines() if "Error" in line or "rror:" in line]
    if "Usage:" in text and ("│" in text or "Try" in text):
        return ""
    if not lines:
        return "no line says Error"
    message = lines[-1]
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
    began = time.monotonic()
    here = Path.cwd()
    os.chdir(folder)
    try:
        arguments = kind.make(folder)
        before = _listing(folder)
        memory = _megabytes()
        result = call(arguments)
        spent = time.monotonic() - began
        if isinstance(result.error, TooLongError) or spent > SECONDS or _megabytes() - memory > MEGABYTES:
            return Verdict(kind, HANG, f"{spent:.0f} s, {_megabytes() - memory:.0f} MB: {' '.join(arguments)}", spent)
        if result.code is None or "Traceback" in result.text:
            told = "".join(traceback.format_exception(result.error)[-4:]) if result.error else result.text[-800:]
            return Verdict(kind, TRACEBACK, told, spent)
        if result.code == 0 or (result.code == 1 and arguments[0] == "doctor"):
            return Verdict(
                kind, ACCEPTED if kind.impossible and result.code == 0 else HARMLESS, result.text[-300:], spent
            )
        fault = vague(result.text, kind.words)
        if fault or result.code not in (2, 130):
            return Verdict(kind, VAGUE, f"{fault or f'exit code {result.code}'}: {result.text[-600:]}", spent)
        left = sorted(_listing(folder) - before)
        if left:
            return Verdict(kind, REMAINS, f"{left}: {result.text[-300:]}", spent)
        return Verdict(kind, REFUSED, result.text.strip()[-300:], spent)
    finally:
        os.chdir(here)


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
        verdict = judge(kind, folder / "in")
        answer.write_text(json.dumps([verdict.what, verdict.message]))
        os._exit(0)
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() - began > SECONDS + 30.0:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.005)
    spent = time.monotonic() - began
    text = said.read_text(errors="replace")
    told = json.loads(answer.read_text()) if answer.exists() else None
    said.unlink()
    answer.unlink(missing_ok=True)
    if told:
        return Verdict(kind, told[0], told[1], spent)
    if os.waitstatus_to_exitcode(ended[1]) == EXIT_ERROR and spent > STUCK_AFTER:
        return Verdict(kind, REFUSED, "has not opened", spent)  # what it said went where `call` caught it
    return Verdict(kind, HANG if spent > SECONDS else TRACEBACK, f"the process died: {text[-600:]}", spent)


def _listing(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


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
