"""`sphere_nav operate`: misuse in one line."""

import sys

import pytest

from sphere_nav_tools.cli.main import main


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
