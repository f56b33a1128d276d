"""The command line of the benchmarks: groups and names are told without an import; how a run ends."""

import json
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import pytest

import benchmarks.__main__ as main
from benchmarks.report import Bound, Report


def run(monkeypatch, measure, tmp_path, *words):
    monkeypatch.setattr(main, "_module", lambda group, name: SimpleNamespace(run=measure))
    monkeypatch.setattr(main, "set_threads", lambda number: None)
    return main.main(["drive", "missions", "--json", str(tmp_path / "found.json"), *words])


def test_every_name_is_of_one_group_and_told():
    found = [name for group in main.GROUPS for name in main.names(group)]
    assert len(found) == len(set(found)) > 20
    assert all(told for group in main.GROUPS for told in main.names(group).values())
    told = {path.stem for path in main.FOLDER.glob("*/*.py") if "\ndef run(" in path.read_text(encoding="utf-8")}
    assert told == set(found)


@pytest.mark.parametrize(("error", "code"), [(ValueError("expected two, found one"), 2), (KeyError("x"), 1)])
def test_what_is_refused_is_told_from_what_broke(error, code, capsys, monkeypatch, tmp_path):
    def measure(options):
        raise error

    assert run(monkeypatch, measure, tmp_path) == code
    said = capsys.readouterr().err
    assert ("Traceback" in said) == (code == 1)
    assert "missions" in said


def test_a_fresh_seed_is_drawn_and_kept_with_what_was_measured(capsys, monkeypatch, tmp_path):
    given: list[Namespace] = []

    def measure(options):
        given.append(options)
        return Report("missions", bounds=[Bound("way", 1.0, 2.0, "m")])

    assert run(monkeypatch, measure, tmp_path, "--size", "quick") == 0
    assert run(monkeypatch, measure, tmp_path, "--seed", "7") == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert (found["seed"], found["size"], given[0].size) == (7, "full", "quick")
    assert found["command"] == "python -m benchmarks drive missions --seed N"
    assert f"seed {given[0].seed}, quick" in capsys.readouterr().out
    assert given[0].data == Path("../shared/data")
