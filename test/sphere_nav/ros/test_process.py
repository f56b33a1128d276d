import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.dds

SCRIPT = """
import numpy as np
from sphere_nav.ros.run import return_free_memory, return_large_blocks

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
blocks = [np.ones(20_000) for _ in range(1000)]  # 160 MB of small blocks
del blocks[::2], blocks
return_free_memory()
print(resident_mb() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="what other C libraries do is theirs")
def test_what_is_freed_leaves_the_process():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 8.0


COMPILER = """
import re
from pathlib import Path
from llvmlite import binding
from sphere_nav.ros.run import return_free_memory

def code_kb():
    found = re.findall(r" r-xp [^\\n]*libllvmlite[^\\n]*\\n(?:Size|KernelPageSize|MMUPageSize).*?Rss: +(\\d+) kB",
                       Path("/proc/self/smaps").read_text(), re.DOTALL)
    return sum(map(int, found))

def compiled():
    return str(binding.parse_assembly("define i32 @one() { ret i32 1 }"))

first, before = compiled(), code_kb()
return_free_memory()
print(before, code_kb(), compiled() == first)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux")
def test_the_compiler_s_code_leaves_the_process_and_works_again_when_it_is_used():
    done = subprocess.run([sys.executable, "-c", COMPILER], capture_output=True, text=True, check=True)
    before, after, is_same = done.stdout.split()
    assert int(before) > 1000
    assert int(after) == 0
    assert is_same == "True"
