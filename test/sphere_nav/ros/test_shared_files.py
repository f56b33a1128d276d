"""Files that the package brings along are found, and its nodes, which say at once that they start."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from runpy import run_path
from shutil import copy
from types import SimpleNamespace

import pytest

from sphere_nav.ros import shared_files
from sphere_nav.ros.shared_files import share_file


def test_the_profile_for_large_messages():
    root = ET.parse(share_file("config/fastdds_large.xml")).getroot()
    sizes = [int(item.text) for item in root.iter() if item.tag.endswith("segment_size")]
    assert sizes
    assert min(sizes) > 2048 * 1024 * (3 + 4)  # a sphere of 2048 x 1024, colour and range


@pytest.mark.parametrize(
    ("package", "shared"),
    [
        ("target/sphere_nav", "target/share/sphere_nav"),
        ("user/lib/python3.12/site-packages/sphere_nav", "user/share/sphere_nav"),
        ("checkout/sphere_nav", "checkout"),
    ],
)
def test_wherever_it_was_installed_its_files_are_found_from_the_code(tmp_path, monkeypatch, package, shared):
    """Under pip --target or --user, and in a checkout, the prefix of the interpreter holds none of them."""
    code = tmp_path / package / "ros" / "shared_files.py"
    code.parent.mkdir(parents=True)
    copy(shared_files.__file__, code)
    (tmp_path / shared / "config").mkdir(parents=True)
    (tmp_path / shared / "config" / "site.yaml").touch()
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "interpreter"))
    found = run_path(str(code))["share_file"]("config/site.yaml")
    assert found == tmp_path / shared / "config" / "site.yaml"


# --- the first line of a node
@pytest.fixture
def started(monkeypatch):
    """Make one node known, and return what was run."""
    done = []

    def entry_points(group, name):
        return [SimpleNamespace(load=lambda: lambda: len(done.append((group, name)) or done) - 1)]

    monkeypatch.setattr(shared_files.metadata, "version", lambda name: "1.2.3")
    monkeypatch.setattr(shared_files.metadata, "entry_points", entry_points)
    return done


def test_a_node_says_at_once_that_it_starts_but_not_to_who_asks_for_help(started, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["/opt/bin/blinker", "--ros-args"])
    assert shared_files.main() == 0
    assert started == [("sphere_nav.nodes", "blinker")]
    assert capsys.readouterr().err == "blinker: sphere_nav 1.2.3 starts\n"
    monkeypatch.setattr(sys, "argv", ["blinker", "--help"])
    shared_files.main()
    assert (len(started), capsys.readouterr().err) == (2, "")


def test_nothing_heavy_is_loaded_before_the_first_line_and_numpy_after_its_threads_are_chosen():
    code = "import sys, sphere_nav.ros.shared_files; print({'numpy', 'rclpy', 'cv2'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
    seen = "import sphere_nav_tools.cli, os, sys; print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    told = subprocess.run([sys.executable, "-c", seen], env=environment, capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["1", "False"]


@pytest.mark.parametrize(("said", "used"), [(None, "1"), ("3", "3")])
def test_a_node_has_one_thread_of_openblas_where_the_user_says_nothing(monkeypatch, said, used):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", said or "")
    if said is None:
        del os.environ["OPENBLAS_NUM_THREADS"]
    monkeypatch.setattr(sys, "argv", ["dense_localizer", "--help"])
    monkeypatch.setattr(shared_files, "node_entry", lambda name: SimpleNamespace(load=lambda: lambda: 0))
    assert shared_files.main() == 0
    assert os.environ["OPENBLAS_NUM_THREADS"] == used
