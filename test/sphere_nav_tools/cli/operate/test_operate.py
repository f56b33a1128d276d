"""`sphere_nav operate`: when a token is asked for, and misuse in one line."""

import sys

import pytest

pytest.importorskip("rclpy")

from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.operate.operate import token_for


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1"])
def test_this_machine_needs_no_token_unless_one_is_given(host):
    assert token_for(host, "") == ""
    assert token_for(host, "a long one") == "a long one"


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "vehicle"])
def test_others_need_one_that_nobody_guesses(host):
    first, second = token_for(host, ""), token_for(host, "")
    assert min(len(first), len(second)) >= 20
    assert first != second
    assert token_for(host, "a long one") == "a long one"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--token", "short"], "--token: expected 8 characters or more, found 5"),
        (["--folder", "none"], "expected a folder"),
    ],
)
def test_misuse_is_one_line(tmp_path, monkeypatch, capsys, words, message):
    pytest.importorskip("viser")
    monkeypatch.chdir(tmp_path)
    assert main(["operate", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_without_viser_it_says_what_to_type(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["operate"]) == 2
    assert "operate: expected the package viser, found none: pip install" in capsys.readouterr().err
