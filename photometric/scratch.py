"""Working memory of the kernels, one piece a thread, so that no image allocates any."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from photometric import kernels

_local = threading.local()


def scratch() -> NDArray[np.float32]:
    """Return the block rows of this thread, (NUM_CHUNKS, NUM_SCRATCH, BLOCK) float32."""
    if not hasattr(_local, "rows"):
        _local.rows = np.empty((kernels.NUM_CHUNKS, kernels.NUM_SCRATCH, kernels.BLOCK), np.float32)
    rows: NDArray[np.float32] = _local.rows
    return rows
