"""Wheels come from where pip is told to take them, by uv or by pip."""

import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from architecture.tree import ROOT

pytest.importorskip("pip", reason="an environment without pip installs nothing")

pytestmark = pytest.mark.dds

SCRIPT = ROOT / "scripts" / "install_wheels.py"
METADATA = "Metadata-Version: 2.1\nName: nothing-at-all\nVersion: 1.0\n"
TAGS = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def write_wheel(folder: Path) -> None:
    folder.mkdir(parents=True)
    info = "nothing_at_all-1.0.dist-info"
    with ZipFile(folder / "nothing_at_all-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr("nothing_at_all.py", "")
        wheel.writestr(f"{info}/METADATA", METADATA)
        wheel.writestr(f"{info}/WHEEL", TAGS)
        wheel.writestr(f"{info}/RECORD", f"nothing_at_all.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n{info}/RECORD,,\n")


def install(settings: str, tmp_path: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    file = tmp_path / "pip.conf"
    file.write_text(settings, encoding="utf-8")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "UV_"))}
    env = kept | {"PIP_CONFIG_FILE": str(file), "UV_CACHE_DIR": str(tmp_path / "cache")} | variables
    line = [sys.executable, str(SCRIPT), "--target", str(tmp_path / "target"), "nothing-at-all"]
    return subprocess.run(line, cwd=ROOT, env=env, capture_output=True, text=True, timeout=600, check=False)


def write_index(folder: Path) -> str:
    write_wheel(folder / "nothing-at-all")
    link = '<a href="nothing_at_all-1.0-py3-none-any.whl">nothing_at_all-1.0-py3-none-any.whl</a>'
    (folder / "nothing-at-all" / "index.html").write_text(f"<!DOCTYPE html><html><body>{link}</body></html>")
    return folder.as_uri()


def test_wheels_come_from_the_folder_of_pips_settings(tmp_path: Path) -> None:
    write_wheel(tmp_path / "wheels")
    done = install(f"[global]\nno-index = true\nfind-links = {tmp_path / 'wheels'}\n", tmp_path)
    assert (tmp_path / "target" / "nothing_at_all.py").is_file(), done.stderr


def test_a_variable_of_pip_holds_before_its_file(tmp_path: Path) -> None:
    settings = f"[global]\nindex-url = {(tmp_path / 'absent').as_uri()}\n"
    done = install(settings, tmp_path, PIP_INDEX_URL=write_index(tmp_path / "simple"))
    assert (tmp_path / "target" / "nothing_at_all.py").is_file(), done.stderr


def test_a_wheel_that_no_one_has_is_not_installed(tmp_path: Path) -> None:
    done = install("[global]\nno-index = true\n", tmp_path)
    assert done.returncode != 0
    assert "nothing-at-all" in done.stderr
