"""How long a classic NetCDF file must be, read from its header.

The NetCDF library reads zeros beyond the end of a classic file that was cut short; a run would start from them.
Source: the NetCDF classic format specification (CDF-1, CDF-2, CDF-5).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import BinaryIO, Final

_TYPE_SIZES: Final = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
_STREAMING: Final = (0xFFFFFFFF, 0xFFFFFFFFFFFFFFFF)


class _Header:
    """Cursor over the header; numbers are big-endian, and 8 bytes wide in CDF-5."""

    def __init__(self, file: BinaryIO, version: int) -> None:
        self.file = file
        self.count_size = 8 if version == 5 else 4
        self.offset_size = 4 if version == 1 else 8

    def number(self, size: int) -> int:
        data = self.file.read(size)
        if len(data) < size:
            raise EOFError
        return int.from_bytes(data, "big")

    def count(self) -> int:
        return self.number(self.count_size)

    def skip(self, size: int) -> None:
        self.file.seek(-(-size // 4) * 4, 1)

    def items(self) -> int:
        """Return the length of a list, after its tag."""
        self.number(4)
        return self.count()

    def skip_attributes(self) -> None:
        for _ in range(self.items()):
            self.skip(self.count())
            kind = self.number(4)
            self.skip(self.count() * _TYPE_SIZES[kind])


def missing_bytes(path: Path) -> int:
    """Return how many bytes a classic NetCDF file lacks at its end; 0 for complete files and other formats."""
    with path.open("rb") as file:
        magic = file.read(4)
        if magic[:3] != b"CDF" or magic[3] not in (1, 2, 5):
            return 0
        try:
            needed = _needed_size(_Header(file, magic[3]))
        except EOFError:
            needed = path.stat().st_size + 1
    return max(needed - path.stat().st_size, 0)


def _needed_size(header: _Header) -> int:
    records = header.count()
    lengths = []
    for _ in range(header.items()):
        header.skip(header.count())
        lengths.append(header.count())
    header.skip_attributes()
    fixed, recorded = [0], []
    for _ in range(header.items()):
        header.skip(header.count())
        sizes = [lengths[header.count()] for _ in range(header.count())]
        header.skip_attributes()
        width = _TYPE_SIZES[header.number(4)]
        header.count()  # the stored size overflows in large files
        begin = header.number(header.offset_size)
        if sizes and sizes[0] == 0:
            recorded.append((begin, math.prod(sizes[1:]) * width))
        else:
            fixed.append(begin + math.prod(sizes) * width)
    return max(max(fixed), _records_end(recorded, 0 if records in _STREAMING else records))


def _records_end(recorded: list[tuple[int, int]], records: int) -> int:
    if not recorded or records == 0:
        return 0
    # A single record variable is stored without padding.
    step = recorded[0][1] if len(recorded) == 1 else sum(-(-size // 4) * 4 for _, size in recorded)
    return max(begin + (records - 1) * step + size for begin, size in recorded)
