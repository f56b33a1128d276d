"""What users install is what is tested: packages, executables that explain themselves, wheels from where pip says."""

import importlib
import os
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from zipfile import ZipFile

import pytest

from architecture.tree import EXECUTABLES, MODULES, PACKAGES, ROOT, differences, installed

# of the root, with Python files, but no packages
NOT_INSTALLED = {"benchmarks", "docs", "examples", "launch", "scripts", "test"}


def visible_python_files() -> set[Path]:
    """Return the Python files of the checkout, without the folders that are made in it."""
    made = {"build", "install", "log", "out"}
    found = {path.relative_to(ROOT) for path in ROOT.glob("*/**/*.py")}
    return {path for path in found if path.parts[0] not in made and not path.parts[0].startswith(".")}


def test_every_package_is_imported_from_the_environment() -> None:
    origins = {name: Path(str(importlib.import_module(name).__file__)) for name in PACKAGES}
    assert {name: origin for name, origin in origins.items() if origin.parents[1] == ROOT} == {}


def test_a_test_does_not_import_the_checkout() -> None:
    assert [entry for entry in sys.path if Path(entry).resolve() == ROOT] == []


def test_every_folder_with_modules_is_a_package() -> None:
    folders = {path.parent for path in MODULES}
    assert {str(folder) for folder in folders if not (ROOT / folder / "__init__.py").is_file()} == set()


def test_a_package_that_is_not_in_the_list_is_not_installed() -> None:
    assert {path.parts[0] for path in visible_python_files()} - NOT_INSTALLED == set(PACKAGES)


def test_an_installation_holds_every_module_and_no_other() -> None:
    assert differences() == []
    folders = [folder for name in PACKAGES if (folder := installed(name))]
    found = {path.relative_to(folder.parent) for folder in folders for path in folder.rglob("*.py")}
    assert found == set(MODULES)


def test_data_files_are_installed() -> None:
    share = Path(sysconfig.get_path("data")) / "share" / "sphere_nav"
    for pattern in ("launch/*.launch.py", "config/*.*", "config/cameras/*.yaml", "package.xml"):
        for path in ROOT.glob(pattern):
            assert (share / path.relative_to(ROOT)).read_bytes() == path.read_bytes()


SCRIPTS = Path(sysconfig.get_path("scripts"))
LINES = [[name] for name in EXECUTABLES] + [["sphere_nav", "map"]]


def explain(words: list[str]) -> str:
    line = [str(shutil.which("env")), "-i", str(SCRIPTS / words[0]), *words[1:], "--help"]
    done = subprocess.run(line, cwd="/", capture_output=True, text=True, timeout=300, check=False)
    is_good = (done.returncode, done.stderr, words[-1] in done.stdout) == (0, "", True)
    return "" if is_good else f"{words}: {done.returncode} {done.stderr}"


@pytest.mark.dds
def test_an_executable_explains_itself_in_an_empty_environment() -> None:
    if not (SCRIPTS / "sphere_nav").is_file():  # colcon installs them into lib/sphere_nav, of a prefix
        pytest.skip(f"no executables in {SCRIPTS}")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        assert [text for text in pool.map(explain, LINES) if text] == []


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


def install(settings: str, tmp_path: Path) -> subprocess.CompletedProcess[str]:
    file = tmp_path / "pip.conf"
    file.write_text(settings, encoding="utf-8")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PIP_", "UV_"))}
    env = kept | {"PIP_CONFIG_FILE": str(file), "UV_CACHE_DIR": str(tmp_path / "cache")}
    line = [sys.executable, str(SCRIPT), "--target", str(tmp_path / "target"), "nothing-at-all"]
    return subprocess.run(line, cwd=ROOT, env=env, capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.dds
def test_wheels_come_from_the_folder_of_pips_settings(tmp_path: Path) -> None:
    write_wheel(tmp_path / "wheels")
    done = install(f"[global]\nno-index = true\nfind-links = {tmp_path / 'wheels'}\n", tmp_path)
    assert (tmp_path / "target" / "nothing_at_all.py").is_file(), done.stderr
