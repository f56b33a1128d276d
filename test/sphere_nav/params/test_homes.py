"""`~` in what a user types, and folders where he has no home that can be written."""

import os
from pathlib import Path

import pytest

from sphere_nav.params import build, homes, param, parameters


@parameters
class Params:
    """Made up."""

    output: str = param("", "a folder")
    base_frame: str = param("base", "a frame")


def test_a_leading_tilde_is_the_home_folder(monkeypatch):
    monkeypatch.setenv("HOME", "/home/ann")
    assert build(Params, {"output": "~/rec/today"}).output == "/home/ann/rec/today"
    assert homes.at_home(Path("~/a")) == Path("/home/ann/a")
    for other in ("a~/b", "~bob", "/~/c", "", 3, None):
        assert homes.at_home(other) == other
    assert build(Params, {"base_frame": "/base_link"}).base_frame == "base_link"
    monkeypatch.setattr(homes.os.path, "expanduser", lambda text: text)
    with pytest.raises(ValueError, match="~/a: expected a home folder for ~, found none: set HOME"):
        homes.at_home("~/a")


@pytest.fixture
def spare(monkeypatch, tmp_path):
    monkeypatch.setattr(homes.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.delenv("MY_CACHE", raising=False)
    homes._spare_folder.cache_clear()
    yield tmp_path / f"sphere_nav_of_{os.getuid()}"
    homes._spare_folder.cache_clear()


def test_what_cannot_be_written_is_kept_among_the_temporary_files(monkeypatch, tmp_path, spare, caplog):
    (tmp_path / "home").write_text("no folder")
    for home in (str(tmp_path / "home"), "~"):  # as of a user without any
        monkeypatch.setattr(homes.os.path, "expanduser", lambda text, home=home: home)
        monkeypatch.delenv("MY_CACHE", raising=False)
        for _ in range(2):
            assert homes.user_folder(".cache/us/kernels", "MY_CACHE") == spare / "us/kernels"
        assert os.environ["MY_CACHE"] == str(spare / "us/kernels")  # for the processes of this one
    assert len(caplog.records) == 2  # one for each home
    assert "cannot be written" in caplog.text
    assert spare.stat().st_mode & 0o077 == 0


def test_a_temporary_folder_that_others_may_write_is_not_used(monkeypatch, tmp_path, spare):
    spare.mkdir(mode=0o777)
    spare.chmod(0o777)
    monkeypatch.setattr(homes.os.path, "expanduser", lambda text: "~")
    found = homes.user_folder(".cache/us/kernels", "MY_CACHE")
    assert spare not in found.parents
    assert found.is_dir()


def test_folders_that_are_named_or_can_be_written_are_used(monkeypatch, tmp_path, spare):
    monkeypatch.setattr(homes.os.path, "expanduser", lambda text: str(tmp_path))
    assert homes.user_folder(".cache/us", "MY_CACHE") == tmp_path / ".cache/us"
    monkeypatch.setenv("OTHER_HOME", str(tmp_path / "other"))
    assert homes.user_folder(".cache/us", "MY_CACHE", "OTHER_HOME") == tmp_path / "other/us"
    monkeypatch.setenv("MY_CACHE", str(tmp_path / "named"))
    assert homes.user_folder(".cache/us", "MY_CACHE", "OTHER_HOME") == tmp_path / "named"
    assert not spare.exists()
