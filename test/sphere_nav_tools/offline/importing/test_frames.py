"""Names of image files, which images are of one instant, and where cameras of a recording sit."""

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.conversions import transform_to_se3
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing.files import read_stamped
from sphere_nav_tools.offline.importing.images import open_images
from sphere_nav_tools.offline.importing.recording import (
    FIRST_STAMP_NS,
    SIDES,
    Picture,
    even_stamps,
    instants_of,
    of_folder,
    open_frames,
    stamp_of,
)
from sphere_nav_tools.offline.importing.rgbd import open_tum

LENS = Pinhole(16, 12, 20.0, 21.0, 7.5, 5.5)
SECOND = 10**9


def write(path, level=50):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((12, 16), level, np.uint8))


def test_a_stamp_is_told_by_its_digits():
    for stem, expected in [
        ("1403636579763555584", 1403636579763555584),
        ("99999999999999999", 99999999999999999 * 1000),  # 17 digits: microseconds
        ("1403636579.5", 1403636579 * SECOND + 500_000_000),
        ("100000000.25", 100000000 * SECOND + 250_000_000),
        ("099999999.25", None),
        ("1403636579.1234567891", 1403636579 * SECOND + 123456789),
        ("0" * 18, None),
        ("140363657976355558400000", None),
        ("12345678.5", None),
        ("12345678901", None),
    ]:
        assert stamp_of(stem) == expected


def test_a_stamp_in_a_table_is_read_to_the_nanosecond_and_the_line_that_is_wrong_is_named(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text("#stamp [ns], x\n1403636579763555583,1.5,7\n\n1403636579763555585,2.5\n")
    assert [found.tolist() for found in read_stamped(path, 1)] == [
        [1403636579763555583, 1403636579763555585],
        [[1.5], [2.5]],
    ]
    path.write_text("\n14036e3,1\n")
    with pytest.raises(ValueError, match=r"data\.csv:2: expected a whole number"):
        read_stamped(path, 1)


def test_files_come_by_their_last_number_and_not_by_their_letters(tmp_path):
    for name in ("b2_10.png", "a3_9.PNG", "c1_100.jpg", "x.png"):
        write(tmp_path / name)
    (tmp_path / "notes.txt").write_text("no image")
    found = of_folder(tmp_path)
    assert [one.where.name for one in found] == ["x.png", "a3_9.PNG", "b2_10.png", "c1_100.jpg"]
    assert [one.stamp_ns for one in found] == even_stamps(4, 10.0)


def test_names_are_stamps_only_where_all_are_and_none_twice(tmp_path):
    for name in ("1403636579000000000", "1403636579500000000"):
        write(tmp_path / f"{name}.png")
    assert [one.stamp_ns for one in of_folder(tmp_path)] == [1403636579000000000, 1403636579500000000]
    write(tmp_path / "1403636579500000000.jpg")
    with pytest.raises(ValueError, match="expected names that are rising times, found some that are equal"):
        of_folder(tmp_path)
    write(tmp_path / "7.png")
    assert [one.stamp_ns for one in of_folder(tmp_path)] == even_stamps(4, 10.0)
    with pytest.raises(ValueError, match="expected images named by their stamps, found others"):
        of_folder(tmp_path, is_stamped=True)


def test_a_folder_of_that_name_is_found(tmp_path):
    write(tmp_path / "front" / "1.png")
    assert len(open_frames(tmp_path, "front")) == 1
    with pytest.raises(ValueError, match=r"expected a folder rear of images or a video rear\.mp4, found front"):
        open_frames(tmp_path, "rear")


def pictures(stamps):
    return [Picture(stamp, f"image {index}", None) for index, stamp in enumerate(stamps)]


def test_without_stamps_images_of_one_number_are_one_instant():
    cameras = {name: pictures(even_stamps(3, 25.0)) for name in "ab"}
    assert [one.stamp_ns for one in cameras["a"]] == [FIRST_STAMP_NS + k * 40_000_000 for k in range(3)]
    assert instants_of(cameras) == [{"a": one, "b": one} for one in cameras["a"]]
    with pytest.raises(ValueError, match="image 0: expected 3 images as of a, found 4 of b"):
        instants_of({"a": cameras["a"], "b": pictures(even_stamps(4, 25.0))})


def test_with_stamps_an_image_belongs_to_the_nearest_within_half_a_period():
    first = [0, 100, 200, 300]
    second = [49, 51, 149, 152, 230, 349, 351]
    found = instants_of({"a": pictures(first), "b": pictures(second)})
    assert [part["a"].stamp_ns for part in found] == first
    assert [part["b"].stamp_ns for part in found] == [49, 51, 230, 349]
    a, b = pictures([5 * SECOND]), pictures([5 * SECOND + 49_000_000, 9 * SECOND])
    assert instants_of({"a": a, "b": b}) == [{"a": a[0], "b": b[0]}]


def transforms(recording):
    return {
        (item.header.frame_id, item.child_frame_id): transform_to_se3(item.transform)
        for item in recording.static_transforms(5)
    }


def test_cameras_sit_where_their_rig_says(tmp_path):
    poses = {
        side: SE3.from_parts(T_BODY_OPTICAL.rotation, [0.1, y, 0.2]) for side, y in zip(SIDES, (0.1, -0.2), strict=True)
    }
    parts = tuple(RigCamera(name, LENS, T) for name, T in poses.items())
    for name in (*SIDES, "front", "rear"):
        write(tmp_path / name / "0.png")

    def found(folder, *parts):
        write_rig(tmp_path / "rig.yaml", Rig(parts))
        return transforms(open_images(tmp_path / folder, tmp_path / "rig.yaml", None, None, None))

    pair = found("", *parts)
    assert set(pair) == {
        ("base_link", "camera_link"), ("camera_link", "left_optical"), ("camera_link", "right_optical"),
    }  # fmt: skip
    np.testing.assert_allclose(pair["camera_link", "right_optical"].matrix, poses["right"].matrix, atol=1e-12)
    assert set(found("left", parts[0])) == {("base_link", "camera_link"), ("camera_link", "camera_optical")}
    ring = found("", *(RigCamera(name, LENS, T_BODY_OPTICAL) for name in ("front", "rear")))
    assert set(ring) == {("base_link", "rig_link"), ("rig_link", "front_optical"), ("rig_link", "rear_optical")}
    np.testing.assert_array_equal(ring["base_link", "rig_link"].matrix, np.eye(4))


def test_topics_tell_what_a_recording_is(tmp_path):
    for side in ("left", "right"):
        write(tmp_path / side / "0.png", 40 if side == "left" else 60)
    found = open_images(tmp_path, None, (20.0, 21.0, 7.5, 5.5, 0.1), 0.25, None)
    messages = dict(found.frame(0))
    assert list(messages) == [f"{side}/{kind}" for kind in ("camera_info", "image_raw") for side in SIDES]
    assert (messages["left/camera_info"].p[3], messages["right/camera_info"].p[3]) == (0.0, -20.0 * 0.25)
    right = found.views["right"]
    np.testing.assert_allclose(right.T_link_camera.translation, [0.0, -0.25, 0.0])
    assert right.camera == Pinhole(16, 12, 20.0, 21.0, 7.5, 5.5, (0.1,))
    alone = open_images(tmp_path / "left", None, (20.0, 21.0, 7.5, 5.5), None, 4.0)
    assert [topic for topic, _ in alone.frame(0)] == ["camera_info", "image_raw"]
    assert alone.instants[0].stamp_ns == FIRST_STAMP_NS


@pytest.mark.parametrize(("late_ms", "num_frames"), [(20, 2), (21, 1)])
def test_depth_of_tum_is_of_an_image_within_twenty_milliseconds(tmp_path, late_ms, num_frames):
    for name in ("a", "b"):
        write(tmp_path / f"{name}.png")
    (tmp_path / "rgb.txt").write_text("# images\n100.0 a.png\n101.0 b.png\n")
    (tmp_path / "depth.txt").write_text(f"100.0 a.png\n{101.0 - 1e-3 * late_ms:.3f} b.png\n")
    (tmp_path / "groundtruth.txt").write_text(
        "99.99 0 0 0 0 0 0 1\n100.01 2 0 0 0 0 0 1\n100.98 5 0 0 0 0 0 1\n101.03 5 0 0 0 0 0 1\n"
    )
    found = open_tum(tmp_path, LENS, 5000.0)
    assert len(found.instants) == num_frames
    assert found.instants[0].T_map_link.translation[0] == pytest.approx(1.0)
    if num_frames == 2:
        assert found.instants[1].T_map_link is None  # rows 50 ms apart are too far
