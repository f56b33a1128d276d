"""Bytes that wait on the disk, in a file without a name: they take no memory and are gone with the process."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path


class Spool:
    """What was added, in that order; OSError, naming the folder, where the disk does not take it."""

    def __init__(self, folder: Path) -> None:
        self._sizes, self._folder = list[int](), folder
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 (`close`)

    def __len__(self) -> int:
        return len(self._sizes)

    def __iter__(self) -> Iterator[bytes]:
        place = 0
        for size in tuple(self._sizes):
            self._file.seek(place)
            place += size
            yield self._file.read(size)

    def add(self, data: bytes) -> None:
        """Add some bytes."""
        try:
            self._file.seek(0, 2)
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            error.filename = error.filename or str(self._folder)
            raise
        self._sizes.append(len(data))

    def close(self) -> None:
        """Forget all."""
        self._file.close()
