"""What users install is what is tested: every package comes from the environment, and nothing of it is left out."""

import importlib
import sys
import sysconfig
from pathlib import Path

from architecture.tree import MODULES, PACKAGES, ROOT, differences, installed

NOT_INSTALLED = {"benchmarks", "docs", "launch", "scripts", "test"}  # of the root, with Python files, but no packages


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
