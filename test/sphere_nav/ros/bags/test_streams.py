"""Topics of any names are told apart by type, name, frame, size and encoding."""

from __future__ import annotations

import pytest

from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    ODOMETRY,
    RGBD,
    STEREO,
    Stream,
    find_inputs,
    find_odometry,
    find_rig,
)


def image(topic, encoding="rgb8", frame="color_optical", size=(640, 480), count=100):
    return Stream(topic, IMAGE, count, 30.0, frame, *size, encoding)


def compressed(topic, format_="rgb8; jpeg compressed bgr8", frame="color_optical", count=100):
    return Stream(topic, COMPRESSED, count, 30.0, frame, encoding=f"compressed: {format_}")


def info(topic, frame="color_optical", size=(640, 480)):
    return Stream(topic, CAMERA_INFO, 100, 30.0, frame, *size, "plumb_bob")


COLOR = [image("/camera/camera/color/image_raw"), info("/camera/camera/color/camera_info")]
DEPTH = [
    image("/camera/camera/depth/image_rect_raw", "16UC1", "depth_optical", (848, 480)),
    info("/camera/camera/depth/camera_info", "depth_optical", (848, 480)),
]
ALIGNED = [
    image("/camera/camera/aligned_depth_to_color/image_raw", "16UC1"),
    info("/camera/camera/aligned_depth_to_color/camera_info"),
]
INFRA = [
    s
    for n in (1, 2)
    for s in (
        image(f"/camera/camera/infra{n}/image_rect_raw", "mono8", f"infra{n}_optical"),
        info(f"/camera/camera/infra{n}/camera_info", f"infra{n}_optical"),
    )
]


def test_depth_that_is_registered_to_the_image_is_preferred():
    assert find_inputs([*DEPTH, *ALIGNED, *COLOR], RGBD) == {
        "image_raw": "/camera/camera/color/image_raw",
        "camera_info": "/camera/camera/color/camera_info",
        "depth/image_raw": "/camera/camera/aligned_depth_to_color/image_raw",
    }


def test_depth_of_another_camera_comes_with_its_own_calibration():
    found = find_inputs([*COLOR, *DEPTH], RGBD)
    assert found["depth/image_raw"] == "/camera/camera/depth/image_rect_raw"
    assert found["depth/camera_info"] == "/camera/camera/depth/camera_info"


def test_a_raw_topic_is_preferred_to_its_compressed_copy_which_serves_alone():
    copy = compressed("/camera/camera/color/image_raw/compressed")
    assert find_inputs([*COLOR, copy], ("image_raw",)) == {"image_raw": "/camera/camera/color/image_raw"}
    assert find_inputs([copy, COLOR[1]], ("image_raw", "camera_info")) == {
        "image_raw": copy.topic,
        "camera_info": "/camera/camera/color/camera_info",
    }


def test_compressed_depth_is_depth():
    depth = compressed("/camera/camera/aligned_depth_to_color/image_raw/compressedDepth", "16UC1; compressedDepth png")
    assert depth.is_depth
    assert not depth.is_picture
    assert find_inputs([*COLOR, depth], RGBD)["depth/image_raw"] == depth.topic


def test_a_pair_is_found_by_the_names_of_its_sides():
    found = find_inputs(INFRA, STEREO)
    assert found["left/image_raw"] == "/camera/camera/infra1/image_rect_raw"
    assert found["right/camera_info"] == "/camera/camera/infra2/camera_info"
    zed = [
        s
        for side in ("left", "right")
        for kind in ("rect", "raw")
        for s in (
            image(f"/zed/zed_node/{side}/image_{kind}_color", "bgra8", f"{side}_optical"),
            info(f"/zed/zed_node/{side}/camera_info", f"{side}_optical"),
        )
    ]
    assert find_inputs(zed, STEREO)["left/image_raw"] == "/zed/zed_node/left/image_rect_color"


def test_our_own_names_need_no_search():
    streams = [*COLOR, image("/image_raw"), info("/camera_info")]
    assert find_inputs(streams, ("image_raw", "camera_info")) == {
        "image_raw": "/image_raw",
        "camera_info": "/camera_info",
    }


def test_what_the_user_names_holds():
    found = find_inputs([*COLOR, *ALIGNED, *INFRA], ("image_raw", "camera_info"), {"image_raw": INFRA[0].topic})
    assert found == {"image_raw": INFRA[0].topic, "camera_info": INFRA[1].topic}


@pytest.mark.parametrize(
    ("streams", "wanted", "chosen", "message"),
    [
        (ALIGNED, RGBD, {}, "expected images (--image)"),
        (COLOR, RGBD, {}, "expected depth images (--depth)"),
        (COLOR, STEREO, {}, "expected a left and a right camera (--left, --right)"),
        (
            [*COLOR, image("/rear/image_raw", frame="rear")],
            ("image_raw",),
            {},
            "one topic with images (image_raw), found /camera/camera/color",
        ),
        (COLOR, ("image_raw",), {"image_raw": "/none"}, "image_raw: expected topic /none, found /camera"),
        (COLOR, ("image_raw",), {"image_raw": COLOR[1].topic}, "expected images, found sensor_msgs/msg/CameraInfo"),
        ([COLOR[0]], ("image_raw", "camera_info"), {}, "camera_info of /camera/camera/color/image_raw, found none"),
    ],
)
def test_what_is_not_one_choice_is_refused_with_the_option(streams, wanted, chosen, message):
    with pytest.raises(BagError) as caught:
        find_inputs(streams, wanted, chosen)
    assert message in str(caught.value)


def test_two_devices_are_a_choice_for_the_user():
    two = [
        s
        for name in ("front", "rear")
        for s in (
            image(f"/{name}/color/image_raw", frame=name),
            info(f"/{name}/color/camera_info", name),
            image(f"/{name}/aligned_depth_to_color/image_raw", "16UC1", name),
        )
    ]
    with pytest.raises(BagError, match="choose by --image, --depth"):
        find_inputs(two, RGBD)
    chosen = {"image_raw": "/rear/color/image_raw"}
    assert find_inputs(two, RGBD, chosen)["depth/image_raw"] == "/rear/aligned_depth_to_color/image_raw"


def test_odometry_is_not_the_truth():
    truth, wheels = (Stream(t, ODOMETRY, n, 50.0) for t, n in (("/ground_truth/odometry", 900), ("/wheel/odom", 500)))
    assert find_odometry([truth, wheels]) == "/wheel/odom"
    assert find_odometry([truth]) == ""


def test_cameras_of_a_rig_are_found_by_their_names():
    streams = [image(f"/cam_{name}/image_raw", frame=name) for name in ("front", "front_left", "rear")]
    assert find_rig(streams, ["cam_front", "rear"]) == {
        "cam_front": "/cam_front/image_raw",
        "rear": "/cam_rear/image_raw",
    }


def test_an_infrared_image_is_not_taken_for_a_picture_though_depth_is_registered_to_it():
    rgb = [image("/rgb/image_raw", "bgra8", "rgb"), info("/rgb/camera_info", "rgb")]
    depth = [image("/depth/image_raw", "16UC1", "ir"), info("/depth/camera_info", "ir")]
    infrared = [image("/ir/image_raw", "mono16", "ir"), info("/ir/camera_info", "ir")]
    found = find_inputs([*depth, *infrared, *rgb], RGBD)
    assert (found["image_raw"], found["depth/camera_info"]) == ("/rgb/image_raw", "/depth/camera_info")


def test_one_camera_under_several_names_counts_once_with_color_and_the_left_of_a_pair():
    zed = [image(f"/zed/{side}/image_rect_color", "bgra8", f"{side[0]}_optical") for side in ("left", "right")]
    zed += [
        image("/zed/rgb/image_rect_color", "bgra8", "l_optical"),
        image("/zed/rgb/image_rect_gray", "mono8", "l_optical"),
    ]
    infos = [info(f"/zed/{side}/camera_info", f"{side[0]}_optical") for side in ("left", "right")]
    found = find_inputs([*zed, *infos], ("image_raw", "camera_info"))
    assert found == {"image_raw": "/zed/left/image_rect_color", "camera_info": "/zed/left/camera_info"}


def test_a_misspelt_topic_is_told_the_one_that_is_meant():
    with pytest.raises(BagError, match=r"is /camera/camera/color/image_raw meant"):
        find_inputs(COLOR, ("image_raw",), {"image_raw": "/camera/camera/colour/image_raw"})


def broken(topic, problem):
    return Stream(topic, IMAGE, 100, 30.0, "color_optical", 640, 480, "rgb8", problem=problem)


def test_what_cannot_be_used_is_not_found_and_its_reason_is_told():
    streams = [broken("/front/image_raw", "encoding: expected better"), COLOR[1]]
    with pytest.raises(BagError, match=r"found /front/image_raw \(encoding: expected better\)"):
        find_inputs(streams, ("image_raw",))
    with pytest.raises(BagError, match="image_raw: /front/image_raw \\(encoding: expected better"):
        find_inputs(streams, ("image_raw",), {"image_raw": "/front/image_raw"})
    copy = compressed("/front/image_raw/compressed")
    assert find_inputs([*streams, copy], ("image_raw",)) == {"image_raw": copy.topic}


def test_a_calibration_of_another_size_or_of_no_camera_is_refused():
    small = [COLOR[0], info("/camera/camera/color/camera_info", size=(320, 240))]
    with pytest.raises(BagError, match=r"color/image_raw: image size: expected 320 x 240 \(.*camera_info\), found 640"):
        find_inputs(small, ("image_raw", "camera_info"))
    none = Stream("/camera/camera/color/camera_info", CAMERA_INFO, 9, 30.0, problem="K[0]: found focal length 0")
    with pytest.raises(BagError, match=r"/camera/camera/color/camera_info: K\[0\]: found focal length 0"):
        find_inputs([COLOR[0], none], ("image_raw", "camera_info"))
