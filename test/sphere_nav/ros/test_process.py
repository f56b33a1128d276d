import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.dds

SCRIPT = """
import numpy as np
from sphere_nav.ros.run import return_large_blocks

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

return_large_blocks()
del_first = np.ones(20_000_000)  # 160 MB, freed: by itself glibc now keeps blocks of up to 32 MB
del del_first
before, kept = resident_mb(), []
for _ in range(20):
    large = np.ones(1_000_000)
    kept.append(np.ones(1_000))  # lies behind it
    del large
    kept.append(np.ones(1_500_000)[:1].copy())
print(resident_mb() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="what other C libraries do is theirs")
def test_what_is_freed_leaves_the_process():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 8.0
