"""Topics of any names are found by type, name, frame, size and encoding; why, or why not, is told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from sphere_mapping.ros.intake import TOPICS
from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import CAMERA_INFO, IMAGE, IMU, ODOMETRY, SPHERE, SPHERE_INFO, Stream
from sphere_nav.ros.camera.drivers import driver_names, read_driver
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.offline.topic_finder import CAMERAS, TopicFinder, names_of_cameras
from worlds.streams import camera, compressed, finder_of, image, info

RGBD, STEREO, MONO = TOPICS["rgbd"], TOPICS["stereo"], ("image_raw", "camera_info")
COLOR = camera("/camera/camera/color/image_raw")
DEPTH = camera("/camera/camera/depth/image_rect_raw", "16UC1", "depth_optical", (848, 480))
ALIGNED = camera("/camera/camera/aligned_depth_to_color/image_raw", "16UC1")
INFRA = [s for n in "12" for s in camera(f"/camera/camera/infra{n}/image_rect_raw", "mono8", f"infra{n}_optical")]
REAR = image("/rear/image_raw", frame="rear")
THETA = image("/theta/image_raw", frame="theta", size=(256, 128))


def found_topics(streams, wanted, chosen=None):
    return finder_of(streams, chosen).find(wanted).topics


def test_depth_that_is_registered_to_the_image_is_preferred_else_it_comes_with_its_own_calibration():
    choice = finder_of([*DEPTH, *ALIGNED, *COLOR]).find(RGBD)
    assert choice.topics == dict(zip(RGBD, (COLOR[0].topic, COLOR[1].topic, ALIGNED[0].topic), strict=True))
    assert choice.reason == "depth of that camera"
    found = found_topics([*COLOR, *DEPTH], RGBD)
    assert (found["depth/image_raw"], found["depth/camera_info"]) == (DEPTH[0].topic, DEPTH[1].topic)
    choice = finder_of([*camera("/a/rgb"), image("/a/depth", "16UC1"), image("/a/far", "16UC1", "far")]).find(RGBD)
    assert (choice.topics["depth/image_raw"], choice.reason) == ("/a/depth", "depth of that camera")


def test_a_raw_topic_is_preferred_to_its_compressed_copy_which_serves_alone():
    copy = compressed(f"{COLOR[0].topic}/compressed")
    assert found_topics([*COLOR, copy], ("image_raw",)) == {"image_raw": COLOR[0].topic}
    assert found_topics([copy, COLOR[1]], MONO) == {"image_raw": copy.topic, "camera_info": COLOR[1].topic}
    depth = compressed(f"{ALIGNED[0].topic}/compressedDepth", "16UC1; compressedDepth png")
    assert found_topics([*COLOR, depth], RGBD)["depth/image_raw"] == depth.topic


def test_a_pair_is_found_by_the_names_of_its_sides_rectified_before_raw():
    found = found_topics(INFRA, STEREO)
    assert (found["left/image_raw"], found["right/camera_info"]) == (INFRA[0].topic, INFRA[3].topic)
    names = [(side, f"/pair/{side}/{kind}") for side in ("left", "right") for kind in ("rect", "raw")]
    pair = [stream for side, topic in names for stream in camera(topic, "bgra8", side)]
    choice = finder_of(pair).find(STEREO)
    assert (choice.topics["left/image_raw"], choice.reason) == ("/pair/left/rect", "rectified")
    assert found_topics(pair, STEREO, {"left/image_raw": "/pair/left/raw"})["right/image_raw"] == "/pair/right/raw"


def test_our_own_names_need_no_search_and_what_the_user_names_holds():
    choice = finder_of([*COLOR, *camera("/image_raw")]).find(MONO)
    assert choice.topics == {"image_raw": "/image_raw", "camera_info": "/camera_info"}
    assert choice.reason == "by their names"
    choice = finder_of([*COLOR, *ALIGNED, *INFRA], {"image_raw": INFRA[0].topic}).find(MONO)
    assert choice.topics == {"image_raw": INFRA[0].topic, "camera_info": INFRA[1].topic}
    assert choice.reason == "as named"
    of_a_pair = {"left/image_raw": INFRA[0].topic}
    assert found_topics([*COLOR, *INFRA], ("image_raw",), of_a_pair) == {"image_raw": COLOR[0].topic}


K_0 = replace(COLOR[1], problem="K[0]: found focal length 0")

BAD = replace(image("/front/image_raw"), problem="encoding: expected better")


@pytest.mark.parametrize(
    ("streams", "wanted", "named", "message"),
    [
        (COLOR, STEREO, "", "expected images of a left camera with images of the right camera beside it (--left, --ri"),
        ([*COLOR, REAR], ("image_raw",), "", "expected one choice of images, found 2: /camera/camera/color/image_raw;"),
        (COLOR, ("image_raw",), "/camera/camera/colour/image_raw", f"is {COLOR[0].topic} meant?"),
        ([COLOR[0]], MONO, "", f"camera_info of {COLOR[0].topic} (640 x 480), found none; choose it by --info"),
        ([BAD, COLOR[1]], ("image_raw",), BAD.topic, "image_raw: /front/image_raw (encoding: expected better)"),
        ([COLOR[0], K_0], MONO, "", f"{COLOR[1].topic}: K[0]: found focal length 0"),
        (
            [COLOR[0], info(COLOR[1].topic, size=(320, 240))],
            MONO,
            "",
            f"480), found {COLOR[1].topic} (320 x 240)",
        ),
    ],
)
def test_what_is_not_one_choice_is_refused_with_the_option(streams, wanted, named, message):
    with pytest.raises(BagError, match="drive: topics: ") as refused:
        finder_of(streams, {"image_raw": named} if named else {}).find(wanted)
    assert message in str(refused.value)


def test_two_devices_are_a_choice_for_the_user_unless_one_has_most_images():
    def devices(**counts):
        for name, count in counts.items():
            yield from camera(f"/{name}/color/image_raw", frame=name, count=count)
            yield image(f"/{name}/aligned_depth_to_color/image_raw", "16UC1", name, count=100)

    choice = finder_of(devices(front=100, rear=40)).find(RGBD)
    assert choice.topics["image_raw"] == "/front/color/image_raw"
    assert choice.reason == "depth of that camera, more frames"
    even = [*devices(front=100, rear=100)]
    with pytest.raises(BagError, match="choose by --image, --depth"):
        found_topics(even, RGBD)
    found = found_topics(even, RGBD, {"image_raw": "/rear/color/image_raw"})
    assert found["depth/image_raw"] == "/rear/aligned_depth_to_color/image_raw"


def test_odometry_is_not_the_truth_and_the_imu_is_the_vehicles():
    truth, wheels = (Stream(t, ODOMETRY, n, 50.0) for t, n in (("/ground_truth/odometry", 900), ("/wheel/odom", 500)))
    assert finder_of([truth, wheels]).odometry == {"odom": "/wheel/odom"}
    assert finder_of([truth]).odometry == {}
    tree = TransformTree()
    tree.add(se3_to_transform(SE3.from_parts(np.eye(3), [0, 0, 1.0]), 5, "base_link", "box"), is_static=True)
    units = [Stream(f"/{name}/data", IMU, 50, 100.0, name) for name in ("arm", "box")]
    assert finder_of(units, tree=tree).imu == {"imu": "/box/data"}
    assert finder_of(units, {"imu": "arm/data"}, tree).imu == {"imu": "/arm/data"}


def test_frames_are_read_where_the_user_says_and_what_contradicts_itself_is_told():
    moves = [se3_to_transform(SE3.identity(), 5, parent, "box") for parent in ("base_link", "mast")]
    kept = {"/car/tf": moves[:1], "/tf_static": moves}
    bag = SimpleNamespace(
        topics=kept, messages=lambda topics: [(topics[0], 5, SimpleNamespace(transforms=kept[topics[0]]))]
    )
    assert TopicFinder(bag).frames_told[1] == ["/tf_static: transform: box: parent base_link is replaced by mast"]
    del kept["/tf_static"]
    assert TopicFinder(bag, {"tf": "car/tf"}).frames.is_connected("base_link", "box")


def test_the_cameras_of_a_rig_are_found_by_their_names_and_those_that_lack_are_left_out():
    streams = [image(f"/cam_{name}/image_raw", frame=name) for name in ("front", "front_left", "rear")]
    assert finder_of(streams).find_rig(["cam_front", "rear", "top"]).topics == {
        "cameras/cam_front/image_raw": "/cam_front/image_raw",
        "cameras/rear/image_raw": "/cam_rear/image_raw",
    }
    named = {"cameras/front/image_raw": "/cam_front/image_raw"}
    assert finder_of(streams, named).find_rig(["front"]).topics == named
    for name, message in (
        ("front", "choose by --camera front=TOPIC"),
        ("top", r"images of camera top \(--camera top=TOPIC\)"),
    ):
        with pytest.raises(BagError, match=f"drive: topics: expected .*{message}"):
            finder_of(streams).find_rig([name])


def test_a_camera_counts_once_with_color_the_left_of_a_pair_and_never_in_infrared():
    rgb, depth = camera("/rgb/image_raw", "bgra8", "rgb"), camera("/depth/image_raw", "16UC1", "ir")
    found = found_topics([*depth, *camera("/ir/image_raw", "mono16", "ir"), *rgb], RGBD)
    assert (found["image_raw"], found["depth/camera_info"]) == ("/rgb/image_raw", "/depth/camera_info")
    zed = [s for side in ("left", "right") for s in camera(f"/zed/{side}/image_rect_color", "bgra8", f"{side[0]}_opt")]
    zed += [image(f"/zed/rgb/image_rect_{kind}", code, "l_opt") for kind, code in (("c", "rgb8"), ("g", "mono8"))]
    assert found_topics(zed, MONO) == {"image_raw": zed[0].topic, "camera_info": zed[1].topic}


@pytest.mark.parametrize(
    ("streams", "chosen", "has_rig", "kind"),
    [
        ([*COLOR, *ALIGNED], {}, False, "rgbd"),
        ([*COLOR, *ALIGNED], {}, True, CAMERAS),
        ([*COLOR, *ALIGNED], {"cameras/a/image_raw": COLOR[0].topic}, False, CAMERAS),
        ([*COLOR, *ALIGNED, *INFRA], {"left/image_raw": INFRA[0].topic}, False, "stereo"),
        (INFRA, {}, False, "stereo"),
        ([image("/cameras/a/image_raw")], {}, False, CAMERAS),
        ([Stream("/car/sphere", SPHERE, 9, 2.0), *COLOR, *ALIGNED], {}, False, "sphere"),
    ],
)
def test_what_spheres_are_made_of_is_told_by_what_there_is(streams, chosen, has_rig, kind):
    assert finder_of(streams, chosen).find_source(has_rig=has_rig)[0] == kind


def test_what_is_found_but_does_not_belong_together_is_the_only_reason(monkeypatch):
    finder = finder_of([*COLOR, *ALIGNED])
    monkeypatch.setattr(finder, "check_source", Mock(side_effect=ValueError("expected one instant")))
    with pytest.raises(BagError, match=r"^drive: topics: expected one instant$"):
        finder.find_source()


def test_depth_of_its_own_camera_needs_a_way_to_the_image_or_a_measured_pose(monkeypatch):
    finder, check = finder_of([*COLOR, *DEPTH]), TopicFinder.check_source
    found = finder.find(RGBD).topics
    monkeypatch.setattr(finder, "check_stamps", Mock())
    with pytest.raises(BagError, match="expected depth_optical and color_optical on /tf_static, found no way"):
        check(finder, "rgbd", found, {})
    check(finder, "rgbd", found, {"depth_pose": "0.1,0,0,0,0,0", "slack_s": 0.3})
    finder.check_stamps.assert_called_once_with(COLOR[0].topic, DEPTH[0].topic, 0.3)


TWO = {f"cameras/{name}/image_raw": COLOR[0].topic for name in "ab"}
LENSES = [Stream(f"/{name}/sphere_info", SPHERE_INFO, 9, 30.0, name) for name in ("other", "theta")]


@pytest.mark.parametrize(
    ("chosen", "settings", "more", "topics"),
    [
        ({"image_raw": COLOR[0].topic}, {}, [], {*MONO}),
        ({"image_raw": COLOR[0].topic}, {"is_panorama": True}, [], {"image_raw"}),
        ({"image_raw": COLOR[0].topic}, {"use_depth": True}, [], {*RGBD}),
        (TWO, {}, [], {*TWO, "cameras/a/camera_info", "cameras/b/camera_info"}),
        (TWO, {"rig.calibration": "map"}, [], {*TWO}),
        ({"image_raw": THETA.topic}, {}, LENSES, {"image_raw", "sphere_info"}),
    ],
)
def test_a_localizer_hears_what_its_parameters_say(chosen, settings, more, topics):
    found = finder_of([*COLOR, *ALIGNED, THETA, *more], chosen).find_localizer(settings).topics
    assert found.keys() == topics
    assert found.get("sphere_info", LENSES[1].topic) == LENSES[1].topic


def streams_of(driver, root=None):
    """Yield what a driver publishes, depth of its own camera in a frame of its own."""
    for ours, topic in driver.names(root).items():
        side = ours.split("/")[0]
        has_own = side in ("left", "right") or (side == "depth" and "depth/camera_info" in driver.topics)
        kind = CAMERA_INFO if ours.endswith("camera_info") else IMAGE if ours.endswith("image_raw") else "other"
        encoding = "" if kind != IMAGE else "16UC1" if side == "depth" else "mono8" if "infra" in topic else "rgb8"
        yield Stream(f"/{topic}", kind, 10, 30.0, side if has_own else "optical", 640, 480, encoding)


@pytest.mark.parametrize("name", driver_names())
def test_what_a_driver_publishes_is_found_as_its_preset_says(name):
    driver = read_driver(name)
    wanted = {"rgbd": RGBD, "stereo": STEREO, "mono": MONO, "panorama": ("image_raw",)}[driver.input]
    finder = finder_of(streams_of(driver))
    found = finder.find(wanted).topics
    assert found == {ours: f"/{topic}" for ours, topic in driver.names().items() if ours in found}
    assert set(wanted) <= set(found)
    assert not driver.root or driver.name in [known.name for known in finder.drivers()]


def test_a_driver_that_is_named_is_found_below_one_namespace_alone():
    front, rear = ([*streams_of(read_driver("realsense"), name)] for name in ("front", "rear"))
    found = finder_of(front).of_driver("realsense")
    assert found["depth/image_raw"] == "/front/aligned_depth_to_color/image_raw"
    with pytest.raises(BagError, match=r"drive: driver realsense: expected one camera, found /front, /rear"):
        finder_of([*front, *rear]).of_driver("realsense")
    with pytest.raises(BagError, match=r"drive: driver zed: expected .*, found "):
        finder_of(front).of_driver("zed")


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (("/front/image_raw", "/rear/image_raw"), ["front", "rear"]),
        (("/car/cam_front/raw", "/car/cam_rear/raw"), ["cam_front", "cam_rear"]),
        (("/a/left/image", "/a/right/image", "/b/left/image"), ["a_left", "a_right", "b_left"]),
        (("/front/image_raw",), ["camera0"]),
    ],
)
def test_cameras_are_called_by_what_their_topics_differ_in(topics, names):
    assert names_of_cameras([image(topic) for topic in topics]) == names


def test_several_cameras_in_one_frame_are_told_but_not_a_pair_a_driver_or_another_form_of_an_image():
    front, rear, left, right = (camera(f"/{side}/image_raw") for side in ("front", "rear", "left", "right"))
    assert finder_of([*front, *rear]).shared_frames() == [
        "frame color_optical: expected one camera, found /front/image_raw and /rear/image_raw:"
        " each needs a frame_id of its own"
    ]
    forms = [image("/front/image_rect"), compressed("/front/image_raw/compressed"), image("/throttled/image_raw")]
    for fine in (front, [*front, *forms], [*left, *right], [*COLOR, *ALIGNED, *INFRA], [front[0], rear[0]]):
        assert finder_of(fine).shared_frames() == []
