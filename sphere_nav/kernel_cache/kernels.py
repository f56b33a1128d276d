"""`njit` for every kernel of the project, with one cache for all processes.

By itself numba keeps what it compiled by the place and time of each source file, and looks at that file alone: edits
of a function called in another file go unseen, and two copies of the project compile everything twice. Here one
folder belongs to the text of all kernels: they may call each other across files, and every process that has the same
text finds them compiled.

A kernel is compiled with copies of those it calls, which numba leaves open to the linker: of several copies in one
process the first one loaded serves all. They are optimized differently, and round differently, so that results would
depend on which kernels are compiled here and which are loaded, and in which order. Here a kernel keeps its own copies.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import FunctionType
from typing import Any

from numba import njit, prange
from numba.core import caching
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

from sphere_nav.kernel_cache.folder import cache_folder, name_of

FAST = {"contract", "reassoc", "nsz", "arcp"}  # never nnan: NaN marks what is not visible
OPTIONS = {"cache": True, "fastmath": FAST, "error_model": "numpy", "nogil": True}

__all__ = ["FAST", "OPTIONS", "njit", "prange"]


class TextLocator:
    """Tells numba where the compiled kernels of one file are; the methods are those that numba's locators have."""

    def __init__(self, function: FunctionType, path: Path) -> None:
        self._line = function.__code__.co_firstlineno
        name = name_of(path)
        self._folder = cache_folder() / name

    def ensure_cache_path(self) -> None:
        """Make the folder; OSError where it cannot be written."""
        self._folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=self._folder).close()

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return what tells one text from another; neither time nor place of a file counts."""
        return self._folder.parent.name

    def get_disambiguator(self) -> str:
        """Return what tells kernels of one name in one file apart."""
        return str(self._line)

    @classmethod
    def from_function(cls, function: FunctionType, path: str) -> Any:
        """Return the locator of a kernel of ours; None for others, and where the folder cannot be written."""
        if not name_of(Path(path)):
            return None
        locator = cls(function, Path(path))
        try:
            locator.ensure_cache_path()
        except OSError:
            return None  # a read-only home: numba looks for a place of its own
        return locator


class OwnCopies(JITCodeLibrary):
    """The machine code of one kernel, which calls its own copies of other kernels and no one else's."""

    def _finalize_final_module(self):
        """Hide the copies while machine code is written; kernels that call this one are linked with what numba has."""
        linked = [library._get_module_for_linking() for library in self._linking_libraries]
        copies = {function.name for module in linked for function in defined(module)}
        hidden = [function for function in defined(self._final_module) if function.name in copies]
        linkages = [function.linkage for function in hidden]
        for function in hidden:
            function.linkage = "internal"
        super()._finalize_final_module()
        for function, linkage in zip(hidden, linkages, strict=True):
            function.linkage = linkage


def defined(module):
    """Return the functions of a module in LLVM that it holds the code of."""
    return [function for function in module.functions if not function.is_declaration]


# These are names of numba inside (0.68.1): where one is missing, results may depend on what was compiled.
if hasattr(JITCodeLibrary, "_finalize_final_module") and hasattr(JITCPUCodegen, "_library_class"):
    JITCPUCodegen._library_class = OwnCopies
if TextLocator not in caching.CacheImpl._locator_classes:
    caching.CacheImpl._locator_classes.insert(0, TextLocator)
