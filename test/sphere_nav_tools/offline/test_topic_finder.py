"""Topics of any names are found by type, name, frame, size and encoding; why, or why not, is told."""

from __future__ import annotations

from types import SimpleNamespace

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
from worlds.streams import compressed, finder_of, image, info

RGBD, STEREO, MONO = TOPICS["rgbd"], TOPICS["stereo"], ("image_raw", "camera_info")
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


def find(streams, wanted, chosen=None):
    choice = finder_of(streams, chosen).find(wanted)
    assert choice.topics, choice.reason
    return choice.topics


def refused(streams, wanted, chosen=None):
    choice = finder_of(streams, chosen).find(wanted)
    assert not choice.topics
    return choice.reason


def test_depth_that_is_registered_to_the_image_is_preferred_else_it_comes_with_its_own_calibration():
    choice = finder_of([*DEPTH, *ALIGNED, *COLOR]).find(RGBD)
    assert choice.topics == {
        "image_raw": COLOR[0].topic,
        "camera_info": COLOR[1].topic,
        "depth/image_raw": ALIGNED[0].topic,
    }
    assert choice.reason == "depth of that camera"
    found = find([*COLOR, *DEPTH], RGBD)
    assert (found["depth/image_raw"], found["depth/camera_info"]) == (DEPTH[0].topic, DEPTH[1].topic)
    renamed = [image("/a/rgb"), info("/a/camera_info"), image("/a/depth", "16UC1"), image("/a/far", "16UC1", "far")]
    choice = finder_of(renamed).find(RGBD)
    assert choice.topics["depth/image_raw"] == "/a/depth"
    assert choice.reason == "depth of that camera"


def test_a_raw_topic_is_preferred_to_its_compressed_copy_which_serves_alone():
    copy = compressed("/camera/camera/color/image_raw/compressed")
    assert find([*COLOR, copy], ("image_raw",)) == {"image_raw": COLOR[0].topic}
    assert find([copy, COLOR[1]], MONO) == {"image_raw": copy.topic, "camera_info": COLOR[1].topic}
    depth = compressed("/camera/camera/aligned_depth_to_color/image_raw/compressedDepth", "16UC1; compressedDepth png")
    assert find([*COLOR, depth], RGBD)["depth/image_raw"] == depth.topic


def test_a_pair_is_found_by_the_names_of_its_sides_rectified_before_raw():
    found = find(INFRA, STEREO)
    assert (found["left/image_raw"], found["right/camera_info"]) == (INFRA[0].topic, INFRA[3].topic)
    pair = [
        s
        for side in ("left", "right")
        for kind in ("rect", "raw")
        for s in (image(f"/pair/{side}/{kind}", "bgra8", side), info(f"/pair/{side}/camera_info", side))
    ]
    choice = finder_of(pair).find(STEREO)
    assert (choice.topics["left/image_raw"], choice.reason) == ("/pair/left/rect", "rectified")
    assert find(pair, STEREO, {"left/image_raw": "/pair/left/raw"})["right/image_raw"] == "/pair/right/raw"


def test_our_own_names_need_no_search_and_what_the_user_names_holds():
    choice = finder_of([*COLOR, image("/image_raw"), info("/camera_info")]).find(MONO)
    assert choice.topics == {"image_raw": "/image_raw", "camera_info": "/camera_info"}
    assert choice.reason == "by their names"
    choice = finder_of([*COLOR, *ALIGNED, *INFRA], {"image_raw": INFRA[0].topic}).find(MONO)
    assert choice.topics == {"image_raw": INFRA[0].topic, "camera_info": INFRA[1].topic}
    assert choice.reason == "as named"
    assert find([*COLOR, *INFRA], ("image_raw",), {"left/image_raw": INFRA[0].topic}) == {"image_raw": COLOR[0].topic}


def broken(topic, problem, kind=IMAGE):
    return Stream(topic, kind, 100, 30.0, "color_optical", 640, 480, "rgb8", problem=problem)


K_0 = broken(COLOR[1].topic, "K[0]: found focal length 0", CAMERA_INFO)
REAR = image("/rear/image_raw", frame="rear")
BAD = broken("/front/image_raw", "encoding: expected better")
FRONT = {"image_raw": "/front/image_raw"}


@pytest.mark.parametrize(
    ("streams", "wanted", "chosen", "message"),
    [
        (COLOR, STEREO, {}, "expected images of a left camera with images of the right camera beside it (--left, --ri"),
        ([*COLOR, REAR], ("image_raw",), {}, "expected one choice of images, found 2: /camera/camera/color/image_raw;"),
        (COLOR, ("image_raw",), {"image_raw": "/camera/camera/colour/image_raw"}, f"is {COLOR[0].topic} meant?"),
        ([COLOR[0]], MONO, {}, f"camera_info of {COLOR[0].topic} (640 x 480), found none; choose it by --info"),
        ([BAD, COLOR[1]], ("image_raw",), FRONT, "image_raw: /front/image_raw (encoding: expected better)"),
        ([COLOR[0], K_0], MONO, {}, f"{COLOR[1].topic}: K[0]: found focal length 0"),
        ([COLOR[0], info(COLOR[1].topic, size=(320, 240))], MONO, {}, "image size: expected 320 x 240 (/camera"),
    ],
)
def test_what_is_not_one_choice_is_refused_with_the_option(streams, wanted, chosen, message):
    assert message in refused(streams, wanted, chosen)
    finder = finder_of(streams, chosen)
    with pytest.raises(BagError, match="drive: topics: "):
        finder.require(finder.find(wanted))


def test_two_devices_are_a_choice_for_the_user_unless_one_has_most_images():
    names = ("front", "rear")
    devices = [
        s
        for name in names
        for s in (
            image(f"/{name}/color/image_raw", frame=name, count=100 if name == "front" else 40),
            info(f"/{name}/color/camera_info", name),
            image(f"/{name}/aligned_depth_to_color/image_raw", "16UC1", name),
        )
    ]
    choice = finder_of(devices).find(RGBD)
    assert (choice.topics["image_raw"], choice.reason) == (
        "/front/color/image_raw",
        "depth of that camera, more frames",
    )
    even = [Stream(s.topic, s.type, 100, *list(vars(s).values())[3:]) for s in devices]
    assert "choose by --image, --depth" in refused(even, RGBD)
    found = find(even, RGBD, {"image_raw": "/rear/color/image_raw"})
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
    finder = TopicFinder(bag, {"tf": "car/tf"})
    assert finder.frames.is_connected("base_link", "box")


def test_the_cameras_of_a_rig_are_found_by_their_names_and_those_that_lack_are_left_out():
    streams = [image(f"/cam_{name}/image_raw", frame=name) for name in ("front", "front_left", "rear")]
    assert finder_of(streams).find_rig(["cam_front", "rear", "top"]).topics == {
        "cameras/cam_front/image_raw": "/cam_front/image_raw",
        "cameras/rear/image_raw": "/cam_rear/image_raw",
    }
    assert "choose by --camera front=TOPIC" in finder_of(streams).find_rig(["front"]).reason
    named = {"cameras/front/image_raw": "/cam_front/image_raw"}
    assert finder_of(streams, named).find_rig(["front"]).topics == named
    assert finder_of(streams).find_rig(["top"]).reason.startswith("expected images of top (rig file; or --camera NAME")


def test_a_camera_counts_once_with_color_the_left_of_a_pair_and_never_in_infrared():
    rgb = [image("/rgb/image_raw", "bgra8", "rgb"), info("/rgb/camera_info", "rgb")]
    depth = [image("/depth/image_raw", "16UC1", "ir"), info("/depth/camera_info", "ir")]
    infrared = [image("/ir/image_raw", "mono16", "ir"), info("/ir/camera_info", "ir")]
    found = find([*depth, *infrared, *rgb], RGBD)
    assert (found["image_raw"], found["depth/camera_info"]) == ("/rgb/image_raw", "/depth/camera_info")
    pair = [image(f"/zed/{side}/image_rect_color", "bgra8", f"{side[0]}_optical") for side in ("left", "right")]
    pair += [image(f"/zed/rgb/image_rect_{kind}", code, "l_optical") for kind, code in (("c", "rgb8"), ("g", "mono8"))]
    infos = [info(f"/zed/{side}/camera_info", f"{side[0]}_optical") for side in ("left", "right")]
    assert find([*pair, *infos], MONO) == {
        "image_raw": "/zed/left/image_rect_color",
        "camera_info": "/zed/left/camera_info",
    }


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


def test_a_localizer_hears_what_its_parameters_say():
    streams = [*COLOR, *ALIGNED, image("/theta/image_raw", frame="theta", size=(256, 128))]
    named = {"image_raw": COLOR[0].topic}
    assert set(finder_of(streams, named).find_localizer({}).topics) == set(MONO)
    assert set(finder_of(streams, named).find_localizer({"is_panorama": True}).topics) == {"image_raw"}
    assert "depth/image_raw" in finder_of(streams, named).find_localizer({"use_depth": True}).topics
    two = {f"cameras/{name}/image_raw": COLOR[0].topic for name in ("a", "b")}
    assert "cameras/b/camera_info" in finder_of(streams, two).find_localizer({}).topics
    assert finder_of(streams, two).find_localizer({"rig.calibration": "map"}).topics == two
    lens = Stream("/theta/sphere_info", SPHERE_INFO, 9, 30.0, "theta")
    other = Stream("/other/sphere_info", SPHERE_INFO, 9, 30.0, "other")
    found = finder_of([*streams, other, lens], {"image_raw": "/theta/image_raw"}).find_localizer({})
    assert found.topics == {"image_raw": "/theta/image_raw", "sphere_info": "/theta/sphere_info"}


def streams_of(driver, root=None):
    """Return what a driver publishes, depth of its own camera in a frame of its own."""
    found, has_own = [], "depth/camera_info" in driver.topics
    for ours, topic in driver.names(root).items():
        side = ours.split("/")[0]
        frame = (
            "depth_optical" if side == "depth" and has_own else "optical" if side == "depth" or side == ours else side
        )
        kind = CAMERA_INFO if ours.endswith("camera_info") else IMAGE if ours.endswith("image_raw") else "other"
        found.append(Stream("/" + topic, kind, 10, 30.0, frame, 640, 480, driver.encodings.get(ours, ("",))[0]))
    return found


@pytest.mark.parametrize("name", driver_names())
def test_what_a_driver_publishes_is_found_as_its_preset_says(name):
    driver = read_driver(name)
    wanted = {"rgbd": RGBD, "stereo": STEREO, "mono": MONO, "panorama": ("image_raw",)}[driver.input]
    finder = finder_of(streams_of(driver))
    found = finder.find(wanted).topics
    assert found == {ours: f"/{topic}" for ours, topic in driver.names().items() if ours in found}
    assert set(wanted) <= set(found)
    if driver.root:
        assert driver.name in [known.name for known in finder.drivers()]


def test_a_driver_that_is_named_is_found_below_one_namespace_alone():
    front, rear = (streams_of(read_driver("realsense"), name) for name in ("front", "rear"))
    finder = finder_of(front)
    assert finder.of_driver("realsense")["depth/image_raw"] == "/front/aligned_depth_to_color/image_raw"
    with pytest.raises(BagError, match=r"drive: driver realsense: expected one camera, found /front, /rear"):
        finder_of([*front, *rear]).of_driver("realsense")
    with pytest.raises(BagError, match=r"drive: driver zed: expected .*, found "):
        finder.of_driver("zed")


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (("/front/image_raw", "/rear/image_raw"), ["front", "rear"]),
        (("/car/cam_front/raw", "/car/cam_rear/raw"), ["cam_front", "cam_rear"]),
        (("/a/left/image", "/a/right/image", "/b/left/image"), ["a_left", "a_right", "b_left"]),
    ],
)
def test_cameras_are_called_by_what_their_topics_differ_in(topics, names):
    assert names_of_cameras([image(topic) for topic in topics]) == names


def test_several_cameras_in_one_frame_are_told_but_not_a_pair_a_driver_or_another_form_of_an_image():
    front, rear = ([image(f"/{side}/image_raw"), info(f"/{side}/camera_info")] for side in ("front", "rear"))
    said = ["frame color_optical: expected one camera, found /front/image_raw and /rear/image_raw:"
            " each needs a frame_id of its own"]  # fmt: skip
    assert finder_of([*front, *rear]).shared_frames() == said
    pair = [s for side in ("left", "right") for s in (image(f"/{side}/image_raw"), info(f"/{side}/camera_info"))]
    forms = [image("/front/image_rect"), compressed("/front/image_raw/compressed"), image("/throttled/image_raw")]
    for fine in (front, [*front, *forms], pair, [*COLOR, *ALIGNED, *INFRA], [front[0], image("/rear/image_raw")]):
        assert finder_of(fine).shared_frames() == []
