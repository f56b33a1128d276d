"""Files from outside: only regular ones are opened, and only up to a size. A FIFO or a device would block for ever."""

from __future__ import annotations

import os
import stat
from typing import BinaryIO

MAX_TABLE_BYTES = 64 << 20  # of numbers as text: half a million poses


def open_file(path: str | os.PathLike[str], what: str, max_bytes: int) -> BinaryIO:
    """Open a regular file for reading; ValueError in one line where it is none, or larger than `max_bytes`.

    `what` names the kind of file that was expected. What is checked is what is opened, also behind a link.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{path}: expected a {what}, found no such file") from None
    try:
        _check(os.fstat(descriptor), path, what, max_bytes)
    except ValueError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def read_bytes(path: str | os.PathLike[str], what: str, max_bytes: int) -> bytes:
    """Return the bytes of a regular file; errors as of `open_file`."""
    with open_file(path, what, max_bytes) as file:
        data = file.read(max_bytes + 1)
    if len(data) > max_bytes:  # it grew
        raise ValueError(f"{path}: expected a {what} of at most {max_bytes} bytes, found more")
    return data


def read_text(
    path: str | os.PathLike[str], what: str, max_bytes: int = MAX_TABLE_BYTES, *, errors: str = "strict"
) -> str:
    """Return the text (UTF-8) of a regular file with LF for every line end; errors as of `open_file`.

    `errors` = "replace" reads on where a remark is in another encoding.
    """
    try:
        text = read_bytes(path, what, max_bytes).decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected text of a {what}, found {' '.join(str(error).split())}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _check(found: os.stat_result, path: str | os.PathLike[str], what: str, max_bytes: int) -> None:
    mode = found.st_mode
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a FIFO" if stat.S_ISFIFO(mode) else "no regular file"
        raise ValueError(f"{path}: expected a {what}, found {kind}")
    if found.st_size > max_bytes:
        raise ValueError(f"{path}: expected a {what} of at most {max_bytes} bytes, found {found.st_size}")
