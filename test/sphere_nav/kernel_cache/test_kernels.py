"""Where numba finds what it compiled."""

from pathlib import Path

from sphere_nav.kernel_cache import kernels
from sphere_nav.kernel_cache.folder import cache_folder
from sphere_nav.photometric.align.descent import kernels as descent


def test_kernels_of_the_project_are_kept_in_the_folder_of_their_text():
    path = Path(descent.exponential._cache.cache_path)
    assert path == cache_folder("sphere_nav") / "sphere_nav.photometric.align.descent"


def test_functions_of_others_are_left_to_numba(tmp_path):
    assert kernels.TextLocator.from_function(lambda: None, str(tmp_path / "other.py")) is None


def test_a_folder_that_cannot_be_written_is_left_to_numba(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(kernels, "cache_folder", lambda package: tmp_path / "file" / "folder")
    assert kernels.TextLocator.from_function(descent.exponential.py_func, descent.__file__) is None
