"""The table of experiments and what is refused; a whole drive is an experiment itself."""

import pytest

from sphere_nav_tools.cli.experiment import street
from sphere_nav_tools.cli.experiment.experiment import ALL_DRIVES, HELP, OFFLINE, PURPOSES
from sphere_nav_tools.cli.main import main


def test_every_experiment_of_the_table_can_be_run():
    assert set(ALL_DRIVES) | set(OFFLINE) == set(PURPOSES)
    assert {"tour", "kidnapped", "homing", "hybrid", "mad", "around", "convergence", "reverse"} <= set(PURPOSES)
    assert all(f"  {name}" in HELP for name in PURPOSES)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["reverse", "--seed", "-1"], "--seed: expected 0 or more, found -1"),
        (["reverse", "--taught", "no"], "no: expected the output of an experiment with a taught map, found none"),
        (["around", "--taught", "no"], "--taught: expected a drive, found around, which is taught nothing"),
        (["reverse", "--starts", "3"], "--starts: expected 1 or more of kidnapped, found 3 of reverse"),
        (["kidnapped", "--starts", "0"], "--starts: expected 1 or more of kidnapped, found 0 of kidnapped"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line(tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    assert main(["experiment", *words]) == 2
    assert capsys.readouterr().err == f"sphere_nav experiment: {told}\n"
    assert not list(tmp_path.iterdir())


def test_an_unknown_name_is_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["experiment", "moonwalk"])
    assert "invalid choice: 'moonwalk'" in capsys.readouterr().err


def test_a_street_that_cannot_be_mapped_is_told_in_one_line_each(tmp_path, monkeypatch, capsys):
    """Nothing was recorded: the command `map` says so, and the experiment that ran it ends."""
    monkeypatch.setattr(street, "StereoDrive", lambda *_: None)
    monkeypatch.setattr(street.Street, "record", lambda *_: None)
    folder = tmp_path / "street"
    assert main(["experiment", "street", "-o", str(folder)]) == 1
    told = capsys.readouterr()
    assert told.out == f"street: map: failed; what was made is in {folder}\n"
    assert told.err.startswith(f"sphere_nav map: {folder / 'teach'}: expected a bag")
    assert told.err.count("\n") == 1
