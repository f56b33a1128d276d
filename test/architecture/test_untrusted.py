"""Files that a user names are read by the bounded readers: no FIFO that blocks, no gigabyte, no bomb in YAML."""

import ast
from collections.abc import Iterator

import pytest

from architecture.tree import MODULES, parse

pytestmark = pytest.mark.slow  # of the checks: `make check`

READERS = "sphere_nav/geometry/files/untrusted.py"
PARSERS = {"yaml.load", "yaml.load_all", "yaml.safe_load", "yaml.safe_load_all", "yaml.unsafe_load", "json.load"}
PARSERS |= {"json.loads", "pickle.load", "pickle.loads", "np.load", "np.loadtxt", "np.genfromtxt", "np.fromfile"}
PARSERS |= {"cv2.imread"}
METHODS = {"read_text", "read_bytes"}  # of a Path
MODES = set("rwaxbt+")
WRITING = set("wax")

# Who may, and why: file and call.
ALLOWED = {
    ("cycab_sim/rendering/embree.py", "MAPS.read_text"): "of the kernel",
    ("mcl_depth/likeness/learned.py", "np.load"): "weights: arrays alone, of a bounded size",
    ("mcl_depth/likeness/learned.py", "WEIGHTS.read_bytes"): "its own weights, to tell them from others",
    ("sphere_nav/geometry/files/encoded.py", "np.fromfile"): "in a process of its own, with limits",
    ("sphere_nav/geometry/files/isolated.py", "Path(folder, 'refusal').read_text"): "what its own process has written",
    ("sphere_nav/geometry/files/isolated.py", "np.load"): "what its own process has written",
    ("sphere_nav/kernel_cache/folder.py", "(ROOT / path).read_bytes"): "our own source",
    (
        "sphere_nav_tools/offline/importing/files.py",
        "np.loadtxt",
    ): "millions of numbers in a text that `read_text` has bounded",
    ("sphere_nav/ros/interfaces.py", "path.read_text"): "a file of an installed interface package",
    ("sphere_nav/ros/maps/writer.py", "(folder / FILE_NAME).open"): "a file that it writes",
    ("sphere_nav_tools/offline/mapping/stitcher_ahead.py", "pickle.loads"): "of the process that began this one",
    ("sphere_nav_tools/cli/processes.py", "(self.folder / f'{name}.log').open"): "the end of what a process printed",
}


def reads(tree: ast.AST) -> Iterator[str]:
    """Yield the calls that parse, read a whole file, or open one for reading."""
    for call in ast.walk(tree):
        if isinstance(call, ast.Call):
            name = ast.unparse(call.func)
            is_method = isinstance(call.func, ast.Attribute)
            if name in PARSERS or (is_method and name.rpartition(".")[2] in METHODS) or opens(call, name):
                yield name


def opens(call: ast.Call, name: str) -> bool:
    """Whether a call opens a file for reading: `open(path)`, or `path.open()` whose first argument is the mode."""
    words = [*call.args[name == "open" :][:1], *(word.value for word in call.keywords if word.arg == "mode")]
    modes = [str(word.value) if isinstance(word, ast.Constant) else "?" for word in words]
    if name != "open" and not name.endswith(".open"):
        return False
    if name != "open" and any(not set(mode) <= MODES for mode in modes):
        return False  # a method of ours, of os or of a library, that is given something else
    return not any(WRITING & set(mode) for mode in modes)


@pytest.mark.slow
def test_only_the_bounded_readers_read_what_a_user_names() -> None:
    found = {(str(module), name) for module in MODULES if str(module) != READERS for name in reads(parse(module))}
    assert sorted(found - ALLOWED.keys()) == []
    assert sorted(ALLOWED.keys() - found) == []  # what is gone leaves the list
