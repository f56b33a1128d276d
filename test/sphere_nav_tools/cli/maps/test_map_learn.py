"""What `sphere_nav map-learn` refuses; what it does: test/sphere_nav_tools/offline/lessons."""

import pytest

pytest.importorskip("rclpy")

from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.maps import map_learn


@pytest.mark.parametrize("words", [["--list"], ["--back"], []])
def test_a_map_that_is_not_there_is_named_in_one_line(tmp_path, capsys, words):
    assert main(["map-learn", str(tmp_path / "none"), *words]) == 2
    error = capsys.readouterr().err
    assert "none: expected a" in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_budget_that_is_none_is_misuse(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["map-learn", str(tmp_path), "--budget", "many"])
    assert ended.value.code == 2
    assert "expected experiences a place, as 3, or megabytes" in capsys.readouterr().err
    assert map_learn.HELP.startswith("Learn from the drives")
