"""What is handed to others: the sdist and the wheel made of it, Dockerfile, systemd unit, and both manifests."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package

from architecture.tree import ROOT

UNIT = ROOT / "config" / "sphere_nav.service"
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")


def call(*words: str | Path, cwd: Path, **variables: str) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
    done = subprocess.run([*map(str, words)], cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_wheel_of_the_sdist_runs_in_another_folder(tmp_path: Path) -> None:
    copy = tmp_path / "copy"  # the checkout stays as it is
    kept = shutil.ignore_patterns(".*", "build", "out", "install", "log", "*.egg-info", "test", "benchmarks", "docs")
    shutil.copytree(ROOT, copy, ignore=kept)
    build = f"from setuptools import build_meta as b; print(b.build_sdist({str(tmp_path)!r}))"
    name = call(sys.executable, "-c", build, cwd=copy).split()[-1]
    with tarfile.open(tmp_path / name) as archive:
        archive.extractall(tmp_path, filter="data")
    source = tmp_path / name.removesuffix(".tar.gz")
    for needed in ("Makefile", "requirements.txt", "msg_defs/package.xml", "scripts/system_tools.sh", "cmake/tf2_msgs"):
        assert (source / needed).exists(), f"{needed} is not in the sdist: `make env` cannot work there"
    pip = (sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index")
    pip += ("--config-settings=messages=no",)  # they are in the environment
    target = tmp_path / "target"
    call(*pip, "--target", target, source, cwd=tmp_path)
    words = "import sphere_nav_tools.cli.main as m, sys; print(m.__file__); sys.exit(m.main(['demo', '--help']))"
    printed = call(sys.executable, "-P", "-c", words, cwd=Path("/"), PYTHONPATH=str(target))
    assert printed.startswith(str(target))
    assert "sphere_nav demo --seed 7" in printed
    assert (target / "bin" / "sphere_nav").is_file()
    assert (target / "share" / "sphere_nav" / "config" / "sphere_nav.service").is_file()


def test_both_manifests_can_be_released_together() -> None:
    packages = [parse_package(str(ROOT / folder)) for folder in (".", "msg_defs")]
    for package in packages:
        lines: list[str] = []
        package.validate(warnings=lines)
        assert lines == []
        assert package.licenses == ["Apache-2.0"]
    assert len({package.version for package in packages}) == 1
    assert f'version="{packages[0].version}"' in (ROOT / "setup.py").read_text(encoding="utf-8")


def test_the_image_is_made_as_the_readme_says() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for line in ("ln -s sphere_nav/msg_defs msg_defs", "colcon build", "--from-paths sphere_nav sphere_nav/msg_defs"):
        assert line in DOCKERFILE
        assert line in readme
    assert "rosdep install" in DOCKERFILE


@pytest.mark.parametrize("text", [DOCKERFILE, UNIT.read_text(encoding="utf-8")])
def test_what_starts_with_the_computer_exists_and_has_its_arguments(text: str) -> None:
    [file] = re.findall(r"\w+\.launch\.py", text)
    launch = (ROOT / "launch" / file).read_text(encoding="utf-8")
    assert file.removesuffix(".launch.py") in launch
    assert "map:=" in text


@pytest.mark.slow
def test_systemd_takes_the_unit_and_ends_it_as_a_node_asks(tmp_path: Path) -> None:
    unit = UNIT.read_text(encoding="utf-8")
    assert "KillSignal=SIGINT" in unit
    assert int(re.findall(r"TimeoutStopSec=(\d+)", unit)[0]) > 30  # what a recorder gets for the end of its bag
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd-analyze is not installed")
    done = subprocess.run(["systemd-analyze", "verify", UNIT], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
