"""Files whose library may abort, hang or unpack without end: read by a process of their own, within limits.

What happens to that process is one ValueError here. Its array comes back in a temporary file. This file is also the
program of that process: it sets its limits before it imports anything large.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from signal import Signals
from tempfile import TemporaryDirectory
from typing import Any

START_BYTES = 1 << 30  # of addresses that Python, NumPy and a library reserve before they read
MAX_LINE = 2000  # characters of a refusal
REFUSED = 3  # exit status: one line says why
PATIENCE = 5  # times the seconds of computing that it may take, on a busy machine
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS", "MALLOC_ARENA_MAX"), "1")


def read_isolated(read: Callable[..., Any], path: Path, max_bytes: int, seconds: float, *more: str) -> Any:
    """Return the array that `read(path, *more)` returns in a process of its own; `read` is a function of a module.

    ValueError where it refuses the file, needs more than `max_bytes` of memory (or of result) or more than `seconds`
    of computing, or ends the process.
    """
    import numpy as np  # not before the limits are set, in the other process

    with TemporaryDirectory(prefix="sphere_nav_") as folder:
        words = [
            read.__module__,
            read.__qualname__,
            str(path.absolute()),
            folder,
            str(max_bytes),
            str(int(seconds) + 1),
            *more,
        ]
        environment = os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            status = subprocess.run(
                [sys.executable, "-P", __file__, *words],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=PATIENCE * seconds,
                start_new_session=True,  # Ctrl-C is for this process, which ends the other one
                check=False,
            ).returncode
        except subprocess.TimeoutExpired:
            limit = f"{PATIENCE * seconds:.0f} s"
            raise ValueError(f"{path}: expected a file that is read within {limit}, found no end") from None
        if status == REFUSED:
            raise ValueError(Path(folder, "refusal").read_text(encoding="utf-8")[:MAX_LINE])
        if status != 0:
            name = Signals(-status).name if status < 0 else f"status {status}"
            raise ValueError(f"{path}: expected a whole file, found damage that ends its reader ({name})")
        return np.load(Path(folder, "array.npy"), allow_pickle=False)


def _main(module: str, function: str, path: str, folder: str, max_bytes: str, seconds: str, *more: str) -> int:
    limits = {
        resource.RLIMIT_AS: START_BYTES + int(max_bytes),
        resource.RLIMIT_CPU: int(seconds),
        resource.RLIMIT_FSIZE: int(max_bytes),
        resource.RLIMIT_CORE: 0,
    }
    for kind, limit in limits.items():
        hard = resource.getrlimit(kind)[1]
        allowed = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (allowed, allowed))
    import numpy as np

    try:
        np.save(Path(folder, "array.npy"), getattr(import_module(module), function)(Path(path), *more))
    except MemoryError:
        line = f"{path}: expected a file that unpacks within {int(max_bytes) >> 20} MB, found one that does not"
    except (ValueError, OSError) as error:
        line = " ".join(str(error).split())
    else:
        return 0
    Path(folder, "refusal").write_text(line[:MAX_LINE], encoding="utf-8")
    return REFUSED


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
