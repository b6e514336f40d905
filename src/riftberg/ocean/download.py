"""Downloading that survives cut connections: parts are kept and continued, checksums decide, errors say what to do."""

from __future__ import annotations

import errno
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riftberg.errors import ForcingError

if TYPE_CHECKING:
    import pooch  # type: ignore[import-untyped, unused-ignore]
    import requests

BLOCK = 1 << 18
Progress = Callable[[str, int, int], None]
"""Called with name, bytes so far and bytes in all (0 = unknown)."""
_POINTER = b"version https://git-lfs.github.com/spec/v1"


def missing_package(package: str, extra: str, what: str) -> ForcingError:
    """Return the error that says which package is needed for what."""
    return ForcingError(
        f"{package} is not installed, which is needed {what}",
        remedy=f"pip install '{extra}' (or pip install {package})",
    )


class Resuming:
    """Downloader for pooch that continues a part left by an earlier attempt.

    Parameters
    ----------
    progress : callable, optional
        Called as ``progress(name, bytes_so_far, bytes_in_all)``; 0 in all = unknown.
    attempts : int
        How many attempts in a row may bring nothing.
    timeout : float
        Seconds without data after which a connection counts as cut.
    large_files : callable, optional
        Turns an address into that of its Git LFS object, for repositories that answer with a pointer.
    pause : float
        Seconds to wait after an attempt that brought nothing; grows with each.
    """

    def __init__(
        self,
        progress: Progress | None = None,
        attempts: int = 5,
        timeout: float = 60.0,
        large_files: Callable[[str], str] | None = None,
        pause: float = 1.0,
    ) -> None:
        self.progress, self.attempts, self.timeout = progress, attempts, timeout
        self.large_files, self.pause = large_files, pause

    def __call__(self, url: str, output_file: str, pooch: pooch.Pooch | None) -> None:
        """Fetch ``url`` into ``output_file`` (the signature that pooch asks for)."""
        part = part_of(Path(output_file).parent, url)
        self.fetch(url, part)
        if self.large_files is not None and is_pointer(part):
            part.unlink()
            self.fetch(self.large_files(url), part)
        shutil.move(part, output_file)

    def fetch(self, url: str, part: Path) -> None:
        """Fetch ``url`` into ``part``, continuing what is there."""
        import requests

        vain = 0
        reason: object = "the connection was cut"
        while vain < self.attempts:
            before = _size(part)
            try:
                if self._continue(url, part):
                    return
            except requests.RequestException as error:
                reason = error
            except OSError as error:
                raise _disk_error(error, part) from error
            # Attempts that brought something do not count: a slow line may be cut many times.
            vain = 0 if _size(part) > before else vain + 1
            time.sleep(self.pause * vain)
        raise ForcingError(
            f"could not be fetched, {self.attempts} attempts in a row brought nothing ({reason})",
            where=url,
            remedy=f"Check the network and run again: {_size(part) / 1e6:.1f} MB are kept and will be continued",
        )

    def _continue(self, url: str, part: Path) -> bool:
        """Fetch the rest of a file; tell whether it is complete."""
        import requests

        have = _size(part)
        headers = {"Accept-Encoding": "identity"}
        if have:
            headers["Range"] = f"bytes={have}-"
        with requests.get(url, headers=headers, stream=True, timeout=self.timeout) as answer:
            if answer.status_code == 416:  # nothing is left to fetch
                return True
            _check_status(answer, url)
            start = have if answer.status_code == 206 else 0
            length = int(answer.headers.get("Content-Length", 0))
            total = start + length if length else 0
            _check_space(part, length)
            written = self._write(answer, part, start, total)
        return total == 0 or written >= total

    def _write(self, answer: requests.Response, part: Path, start: int, total: int) -> int:
        """Write the answer behind the first ``start`` bytes of ``part``; return the size reached."""
        written = start
        with part.open("r+b" if start else "wb") as stream:
            stream.seek(start)
            for block in answer.iter_content(BLOCK):
                stream.write(block)
                written += len(block)
                if self.progress is not None:
                    self.progress(part.name.removesuffix(".part"), written, total)
        return written


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


def part_of(folder: Path, url: str) -> Path:
    """Return where the unfinished part of ``url`` is kept."""
    return folder / f"{url.rsplit('/', 1)[-1].split('?')[0]}.part"


def is_pointer(path: Path) -> bool:
    """Tell whether a file is a Git LFS pointer instead of the data."""
    with path.open("rb") as stream:
        return stream.read(len(_POINTER)) == _POINTER


def _check_status(answer: requests.Response, url: str) -> None:
    code = answer.status_code
    if code in (401, 403):
        raise ForcingError(
            f"the server wants a login (HTTP {code})", where=url, remedy="Give credentials for this service"
        )
    if code in (404, 410):
        raise ForcingError(
            f"the file is not there (HTTP {code})",
            where=url,
            remedy="Check the base address, or whether the source has moved",
        )
    answer.raise_for_status()


def _check_space(part: Path, length: int) -> None:
    """Refuse a download that cannot fit before it fills the disk."""
    free = shutil.disk_usage(part.parent).free
    if length > free:
        raise OSError(errno.ENOSPC, f"{length / 1e6:.0f} MB are to come, {free / 1e6:.0f} MB are free")


def _disk_error(error: OSError, part: Path) -> ForcingError:
    """Return the error that tells what the disk said."""
    if error.errno == errno.ENOSPC:
        what, remedy = (
            "the disk is full",
            "Free some space, or choose another folder; what was fetched is kept and continued",
        )
    elif error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
        what, remedy = "the folder cannot be written", "Choose another folder"
    else:
        what, remedy = f"writing failed ({error})", "Check the disk"
    return ForcingError(what, where=str(part.parent), remedy=remedy)


class Bar:
    """Progress of downloads on one line of a terminal; silent when the output is no terminal."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._name = ""

    def __call__(self, name: str, done: int, total: int) -> None:
        """Show that ``done`` of ``total`` bytes of ``name`` are there."""
        from tqdm import tqdm  # type: ignore[import-untyped, unused-ignore]

        if name != self._name:
            self.close()
            self._name = name
            self._bar = tqdm(desc=name[-50:], total=total or None, unit="B", unit_scale=True, disable=None)
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """End the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def made(folder: Path) -> Path:
    """Return the folder, made if absent."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ForcingError(
            f"the folder cannot be made ({error.strerror})", where=str(folder), remedy="Choose another"
        ) from error
    return folder


def fetch_one(name: str, digest: str | None, folder: Path, base_url: str, downloader: Resuming) -> Path:
    """Fetch one file unless it is there and right.

    Parameters
    ----------
    name : str
        Address below ``base_url``.
    digest : str or None
        sha256; without it a file that is there is taken as right.
    folder : Path
        Where it goes, under the last part of its name.
    base_url : str
        Address of the folder that holds it.
    downloader : Resuming
        What fetches it.

    Raises
    ------
    ForcingError
        Also for a wrong checksum; then nothing is kept.
    """
    try:
        import pooch  # type: ignore[import-untyped, unused-ignore]
    except ImportError as error:
        raise missing_package("pooch", "riftberg[fetch]", "to fetch files") from error
    short = name.rsplit("/", 1)[-1]
    if digest is None and (folder / short).exists():
        return folder / short
    store = pooch.create(folder, base_url, registry={short: digest}, urls={short: base_url + name})
    pooch.get_logger().setLevel("WARNING")
    try:
        return Path(store.fetch(short, downloader=downloader))
    except ValueError as error:
        part_of(folder, name).unlink(missing_ok=True)
        raise ForcingError(
            f"its checksum is wrong: {error}",
            where=base_url + name,
            remedy="The file has changed at its source or on the way: run again; if it stays wrong, do not use it",
        ) from error
