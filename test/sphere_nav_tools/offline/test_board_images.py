"""Images of one instant are found by their names."""

from sphere_nav_tools.offline.board_images import find_images


def test_cameras_are_named_by_their_folder_or_by_what_their_files_begin_with(tmp_path):
    for name in ("front cam/1.png", "front cam/2.PNG", "left_1.png", "left_2.png", "7.png", "8.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    found = find_images([str(tmp_path / "front cam"), str(tmp_path / "left_*.png"), str(tmp_path / "[78].png")])
    folder = "".join(letter if letter.isalnum() else "_" for letter in tmp_path.name)
    assert list(found) == ["front_cam", "left", folder]
    assert [len(files) for files in found.values()] == [2, 2, 2]
    assert find_images([str(tmp_path / "7.png")])[folder] == {"7": tmp_path / "7.png"}
