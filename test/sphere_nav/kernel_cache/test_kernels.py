"""Where numba finds what it compiled, and that it is the same as when it was compiled."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sphere_nav.kernel_cache import kernels
from sphere_nav.kernel_cache.folder import cache_folder
from sphere_nav.photometric.align.descent import kernels as descent


def test_kernels_of_the_project_are_kept_in_the_folder_of_their_text():
    path = Path(descent.exponential._cache.cache_path)
    assert path == cache_folder() / "sphere_nav.photometric.align.descent"


def test_a_folder_that_cannot_be_written_is_left_to_numba(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path / "file" / "folder")
    assert kernels.TextLocator.from_function(descent.exponential.py_func, descent.__file__) is None


PICTURE = """
import hashlib, sys
import numpy as np
from mcl_depth.likeness import kernels

x, y, m = np.random.default_rng(0).uniform(0.0, 1.0, (3, 64, 360)).astype(np.float32)
codes = np.random.default_rng(1).integers(0, 256, (2, 3, 64, 360)).astype(np.uint8)
if sys.argv[1:]:
    kernels._add_row(x[0], y[0], m[0], m[0], *np.tile(x[:3], 2), np.zeros((36, 3)))  # one that the other calls
found = kernels.compare_headings_many(x, y, m, m, *codes, np.ones(3, np.float32), np.arange(3), 36)
print(hashlib.sha256(found.tobytes()).hexdigest())
"""


@pytest.mark.dds
def test_a_kernel_gives_the_same_bits_where_it_is_compiled_and_where_it_is_loaded(tmp_path):
    def run(*words):
        variables = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
        command = [sys.executable, "-P", "-c", PICTURE, *words]
        return subprocess.run(command, env=variables, check=True, capture_output=True, text=True, timeout=300).stdout

    compiled = run()
    assert list(tmp_path.rglob("*compare_headings_many*.nbc"))
    assert run() == compiled
    assert run("after another") == compiled
