"""How large a netCDF file says it is, so that a file cut short can be found out.

Without this a classic file that was cut reads as zeros beyond its end.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

_WIDTHS = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
_STREAMING = 0xFFFFFFFF


def whole_size(path: str) -> int | None:
    """Return the size (bytes) that the header of a file states; None if it states none that can be read."""
    with Path(path).open("rb") as file:
        head = file.read(48)
        try:
            if head.startswith(b"\x89HDF\r\n\x1a\n"):
                version = head[8]
                width, place = (head[13], {0: 40, 1: 44}[version]) if version < 2 else (head[9], 28)
                if width != 8 or place + 8 > len(head):
                    return None
                end = int(struct.unpack_from("<Q", head, place)[0])
                return end if end < 2**62 else None
            if head[:3] == b"CDF" and head[3] in (1, 2, 5):
                file.seek(0)
                return _Classic(file).size()
        except (struct.error, ValueError, KeyError, MemoryError, OverflowError, IndexError):
            return None
    return None


class _Classic:
    """Header of a classic netCDF file (CDF-1, 2, 5), as far as sizes need it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        version = file.read(4)[3]
        self._count = ">Q" if version == 5 else ">I"
        self._offset = ">I" if version == 1 else ">Q"

    def _number(self, kind: str) -> int:
        return int(struct.unpack(kind, self._file.read(struct.calcsize(kind)))[0])

    def _skip(self, size: int) -> None:
        if size > 1 << 40:
            raise ValueError("not a header")
        self._file.seek(-(-size // 4) * 4, 1)

    def _entries(self) -> int:
        self._number(">I")
        return self._number(self._count)

    def _attributes(self) -> None:
        for _ in range(self._entries()):
            self._skip(self._number(self._count))
            kind = self._number(">I")
            self._skip(_WIDTHS[kind] * self._number(self._count))

    def size(self) -> int | None:
        """Return where the last value ends."""
        records = self._number(self._count)
        lengths = []
        for _ in range(self._entries()):
            self._skip(self._number(self._count))
            lengths.append(self._number(self._count))
        self._attributes()
        ends, rows = [0], []
        for _ in range(self._entries()):
            self._skip(self._number(self._count))
            shape = [lengths[self._number(self._count)] for _ in range(self._number(self._count))]
            self._attributes()
            width = _WIDTHS[self._number(">I")]
            self._number(self._count)
            begin = self._number(self._offset)
            moving = bool(shape) and shape[0] == 0
            size = width
            for length in shape[1:] if moving else shape:
                size *= length
            if moving:
                rows.append((begin, size))
            else:
                ends.append(begin + size)
        if rows and 0 < records < _STREAMING:
            padded = sum(-(-size // 4) * 4 for _, size in rows) if len(rows) > 1 else rows[0][1]
            ends += [begin + (records - 1) * padded + size for begin, size in rows]
        return max(ends)
