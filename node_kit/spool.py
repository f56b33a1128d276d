"""Bytes that wait on the disk, in a file without a name: they take no memory and are gone with the process."""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path


class Spool:
    """What was added, in that order; OSError, naming the folder, where the disk does not take it."""

    def __init__(self, folder: Path | None = None) -> None:
        """Without a folder, that of the system's temporary files."""
        self._ends, self._folder = [0], folder or Path(tempfile.gettempdir())
        self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 (`close`)
        self._close = weakref.finalize(self, self._file.close)

    def __len__(self) -> int:
        return len(self._ends) - 1

    def __getitem__(self, index: int) -> bytes:
        if not 0 <= index < len(self):
            raise IndexError(f"spool: expected an index below {len(self)}, found {index}")
        first, end = self._ends[index : index + 2]
        return os.pread(self._file.fileno(), end - first, first)

    def __iter__(self) -> Iterator[bytes]:
        for index in range(len(self)):
            yield self[index]

    def add(self, data: bytes) -> int:
        """Add some bytes; return the index under which they are."""
        try:
            self._file.seek(self._ends[-1])
            self._file.write(data)
            self._file.flush()
        except OSError as error:
            error.filename = error.filename or str(self._folder)
            raise
        self._ends.append(self._ends[-1] + len(data))
        return len(self) - 1

    def close(self) -> None:
        """Forget all."""
        self._close()
