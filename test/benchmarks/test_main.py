"""How a run of benchmarks ends."""

from types import SimpleNamespace

import pytest

from benchmarks.__main__ import _run_one


@pytest.mark.parametrize(("error", "code"), [(ValueError("expected two, found one"), 2), (KeyError("x"), 1)])
def test_what_is_refused_is_told_from_what_broke(error, code, capsys):
    def run(options):
        raise error

    assert _run_one("some", SimpleNamespace(run=run), SimpleNamespace()) == code
    said = capsys.readouterr().err
    assert ("Traceback" in said) == (code == 1)
    assert "some" in said
