import subprocess
import sys

import numpy as np
import pytest

from sphere_nav.geometry.arrays import HUGE_PAGES, OWN_PAGES, empty_to_keep

EXCHANGE = """
import gc
from pathlib import Path
import numpy as np
from sphere_nav.geometry.arrays import empty_to_keep

def anonymous_kb():
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("Anonymous:")).split()[1])

rng = np.random.default_rng(0)
before, stay, passing = anonymous_kb(), [], []
for _ in range(200):
    passing.append(empty_to_keep(int(rng.integers(20_000, 120_000)), np.uint8))
    passing[-1][:] = 1
    stay.append(bytearray(2_000))  # lies behind it
del passing
gc.collect()
print(anonymous_kb() - before)
"""


@pytest.mark.dds
@pytest.mark.skipif(sys.platform != "linux", reason="of Linux")
def test_what_is_kept_leaves_the_process_when_it_goes_whatever_lies_behind_it():
    done = subprocess.run([sys.executable, "-c", EXCHANGE], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 2_000  # 400 kB stay; all 14,000 kB by np.empty


def test_it_is_an_array_like_any_other():
    for num_bytes in [8, OWN_PAGES, HUGE_PAGES]:
        array = empty_to_keep((2, num_bytes // 8), np.float32)
        array[:] = 3.0
        part = array[1:]
        del array  # its pages stay with what is left of it
        assert part.flags.writeable
        assert part.flags.aligned
        assert part.flags.c_contiguous
        assert float(part.sum()) == 3.0 * num_bytes / 8
