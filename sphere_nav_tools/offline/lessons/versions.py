"""The versions of a map: the present one, those before it, and the next one while it is made and judged.

`<map>.versions/0001` holds the files of the first version, and so on; the present one is the map itself. The next one
is made below the same folder. It takes the place of the present one by a rename of its file, after that one was kept:
whatever ends the program or fills the disk, the map is the old one or the new one, whole.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.writer import METADATA, PARTIAL
from sphere_nav.ros.maps.reader import FILE_NAME
from sphere_nav.ros.maps.writer import replace_map

VERSIONS, NEXT, LOCK = ".versions", "next", "lock"
NUM_KEPT = 3  # versions before the present one
DIGITS = 4


class Versions:
    """Those of one map."""

    def __init__(self, map_path: Path) -> None:
        """BagError where there is no map."""
        self.map = (map_path if map_path.is_dir() else map_path.parent).resolve()
        if not map_path.exists() or not (self.map / FILE_NAME).is_file():
            raise BagError(f"{map_path}: expected a map (a folder with {FILE_NAME}), found none")
        self.folder = self.map.with_name(self.map.name + VERSIONS)
        self.next = self.folder / NEXT

    @property
    def earlier(self) -> list[Path]:
        """The versions before the present one, the oldest first."""
        found = self.folder.glob("[0-9]" * DIGITS) if self.folder.is_dir() else iter(())
        return sorted(one for one in found if (one / FILE_NAME).is_file())

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes away, and clear what a killed one has left; BagError where one is at work."""
        self.folder.mkdir(exist_ok=True)
        with (self.folder / LOCK).open("ab") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise BagError(f"{self.folder}: another process makes a new version of the map: wait for it") from None
            except OSError:  # a file system without locks
                pass
            self._mend()
            yield

    def put_next(self) -> Path:
        """Keep the present version, put the next one in its place; return where the former is."""
        names = [int(one.name) for one in self.earlier]
        kept = self.folder / f"{max(names, default=0) + 1:0{DIGITS}d}"
        part = kept.with_name(kept.name + PARTIAL)
        part.mkdir()
        for name in (FILE_NAME, METADATA):
            _keep(self.map / name, part / name)
        _sync(part)
        part.rename(kept)
        _sync(self.folder)
        replace_map(self.next, self.map)
        _sync(self.map)
        for old in self.earlier[:-NUM_KEPT]:
            shutil.rmtree(old, ignore_errors=True)
        return kept

    def take_back(self) -> Path:
        """Put the version before the present one in its place; return where it was. BagError where there is none."""
        if not self.earlier:
            raise BagError(f"{self.folder}: expected a version before the present one, found none")
        last = self.earlier[-1]
        replace_map(last, self.map)
        _sync(self.map)
        return last

    def drop_next(self) -> None:
        """Delete what was made of the next version."""
        for left in (self.next, self.next.with_name(NEXT + PARTIAL)):
            shutil.rmtree(left, ignore_errors=True)

    def _mend(self) -> None:
        """End what a killed process had begun: a map that has its file gets what belongs to it, the rest goes."""
        for begun in (self.next, *sorted(self.folder.glob("[0-9]" * DIGITS))):
            if (begun / METADATA).is_file() and not (begun / FILE_NAME).is_file():
                (begun / METADATA).replace(self.map / METADATA)
                begun.rmdir()
        self.drop_next()
        if self.earlier and (self.earlier[-1] / FILE_NAME).samefile(self.map / FILE_NAME):
            shutil.rmtree(self.earlier[-1])  # kept, but not replaced
        for torn in self.folder.glob(f"*{PARTIAL}"):
            shutil.rmtree(torn, ignore_errors=True)


def _keep(file: Path, kept: Path) -> None:
    """Keep a file under another name; by a link it takes no room."""
    try:
        os.link(file, kept)
    except OSError:  # a file system without links
        shutil.copyfile(file, kept)


def _sync(folder: Path) -> None:
    """Let the names in a folder outlive a power failure."""
    with suppress(OSError):
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
