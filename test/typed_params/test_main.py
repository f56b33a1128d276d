from __future__ import annotations

import subprocess
import sys

import pytest

from photometric.params import RegistrationParams
from typed_params.__main__ import main
from typed_params.render import to_markdown, to_yaml


def run(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["typed_params", *arguments])
    return main()


def test_the_command_prints_the_file(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["photometric.params:RegistrationParams", "--node", "some_node"], monkeypatch) == 0
    assert capsys.readouterr().out == to_yaml(RegistrationParams, node="some_node")


def test_the_command_prints_the_table(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["photometric.params:RegistrationParams", "--markdown"], monkeypatch) == 0
    assert capsys.readouterr().out == to_markdown(RegistrationParams)


@pytest.mark.parametrize("name", ["photometric.params", "photometric.params:Nothing", "no_such_module:Class"])
def test_an_unknown_class_is_one_line_and_exit_code_2(name: str) -> None:
    done = subprocess.run([sys.executable, "-m", "typed_params", name], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert name in done.stderr.splitlines()[-1]
