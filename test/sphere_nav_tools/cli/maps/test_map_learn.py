"""What `sphere_nav map-learn` refuses; what it does: test/sphere_nav_tools/offline/test_lessons.py."""

from sphere_nav_tools.cli.main import main


def test_a_map_that_is_not_there_is_named_in_one_line(tmp_path, capsys):
    for words in [["--list"], ["--back"], []]:
        assert main(["map-learn", str(tmp_path / "none"), *words]) == 2
        error = capsys.readouterr().err
        assert "none: expected a" in error
        assert error.count("\n") == 1
        assert list(tmp_path.iterdir()) == []
