"""ROS domains that no other demonstration and no test has at the same time: a locked file stands for each."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

FOR_TESTS, FOR_DRIVES = range(1, 50), range(50, 100)  # 0 is everybody's; above 101 the ports are not reserved
_claims: list[int] = []  # descriptors of locked files: the kernel gives the domains free when the process ends


def claim_domain(domains: Iterable[int] = FOR_DRIVES) -> int:
    """Return a domain that is this process's until it ends; RuntimeError where all of them are in use."""
    for domain in domains:
        path = Path(tempfile.gettempdir(), f"sphere_nav_domain_{domain}.lock")
        with suppress(OSError):  # locked by a process, or the file of another user who may still use it
            claim = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(claim)
                continue
            _claims.append(claim)
            return domain
    raise RuntimeError(f"ROS domains: expected one of {domains} that is free, found all in use")
