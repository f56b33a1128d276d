"""The user's folders: `~` in what he types, and where to keep things where he has no home that can be written."""

from __future__ import annotations

import logging
import os
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

SPARE = "sphere_nav_of_{uid}"  # in the folder of temporary files


def at_home(found: Any) -> Any:
    """Return a text or path with the home folder for a leading `~/`, anything else as it is; ValueError: no home."""
    if not isinstance(found, str | Path) or not (str(found) == "~" or str(found).startswith("~/")):
        return found
    expanded = os.path.expanduser(found)
    if not os.path.isabs(expanded):
        raise ValueError(f"{found}: expected a home folder for ~, found none: set HOME, or give the whole path")
    return type(found)(expanded)


def user_folder(below: str, variable: str = "", home_variable: str = "") -> Path:
    """Return a folder that can be written: that of a variable, else `below` the user's home, else a temporary one.

    `home_variable` names another place for the first part of `below`. A warning tells of a temporary one, which
    `variable` then holds for the processes that are started from this one.
    """
    first, _, rest = below.partition("/")
    home = os.environ.get(home_variable) or os.path.join(os.path.expanduser("~"), first)
    wanted = Path(os.environ.get(variable) or os.path.join(home, rest))
    if wanted.is_absolute() and is_writable(wanted):
        return wanted
    spare = _spare_folder() / rest
    is_writable(spare)
    logging.getLogger("sphere_nav.home").warning(
        "%s: cannot be written: %s is used; %s names another folder", wanted, spare, variable or "HOME"
    )
    if variable:
        os.environ[variable] = str(spare)
    return spare


def is_writable(folder: Path) -> bool:
    """Make a folder; whether a file can be made in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


@cache
def _spare_folder() -> Path:
    """Return a folder of this user alone among the temporary files, the same for all of his processes."""
    try:
        folder = Path(tempfile.gettempdir()) / SPARE.format(uid=os.getuid())
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        is_ours = (
            found.st_uid == os.getuid() and not found.st_mode & 0o077 and folder.is_dir() and not folder.is_symlink()
        )
        return folder if is_ours else Path(tempfile.mkdtemp(prefix="sphere_nav_"))
    except OSError:  # nothing can be written anywhere
        return Path("/nonexistent")
