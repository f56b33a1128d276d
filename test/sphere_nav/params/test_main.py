from __future__ import annotations

import subprocess
import sys

import pytest

from sphere_nav.params.__main__ import main
from sphere_nav.params.render import to_yaml
from sphere_nav.photometric.params import RegistrationParams


def run(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["sphere_nav.params", *arguments])
    return main()


def test_the_command_prints_the_file(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sphere_nav.photometric.params:RegistrationParams", "--node", "some_node"], monkeypatch) == 0
    assert capsys.readouterr().out == to_yaml(RegistrationParams, node="some_node")


PHOTOMETRIC = "sphere_nav.photometric.params"


@pytest.mark.dds
@pytest.mark.parametrize("name", [f"{PHOTOMETRIC}:Nothing"])
def test_an_unknown_class_is_one_line_and_exit_code_2(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "sphere_nav.params", name], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert name in done.stderr.splitlines()[-1]
