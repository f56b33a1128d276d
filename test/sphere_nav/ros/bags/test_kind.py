import subprocess
import sys

import pytest

from sphere_nav.ros.bags.kind import is_foreign, lone_file


@pytest.mark.parametrize(
    ("name", "description", "expected"),
    [
        ("drive.mcap", None, False),
        ("drive.db3", None, True),
        ("drive.bag", None, True),
        ("drive", {"storage_identifier": "sqlite3"}, True),
        ("drive", {"storage_identifier": "mcap", "compression_mode": ""}, False),
        ("drive", {"storage_identifier": "mcap", "compression_mode": "FILE"}, False),
    ],
)
def test_mcap_is_read_by_ourselves(tmp_path, name, description, expected):
    assert is_foreign(tmp_path / name, description) == expected


def test_the_one_database_of_a_folder_is_meant(tmp_path):
    (tmp_path / "a.db3").touch()
    (tmp_path / "a.txt").touch()
    assert lone_file(tmp_path) == tmp_path / "a.db3"
    (tmp_path / "b.db3").touch()
    assert lone_file(tmp_path) == tmp_path


@pytest.mark.dds
def test_readers_of_other_bags_and_what_they_need_are_not_loaded_before_there_is_one():
    heavy = "sqlite3", "sphere_nav.ros.bags.foreign", "scipy.special"
    hide = "sys.modules['coverage'] = None"  # with it numba loads sqlite3, whatever we do
    code = (
        f"import sys; {hide}; import dense_localizer.ros.node; print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "[]"
