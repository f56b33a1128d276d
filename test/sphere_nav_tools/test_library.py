"""`import sphere_nav`: what a script gets, that swapped arguments are refused, and that the examples run."""

import runpy
import sys

import numpy as np
import pytest
from geometry_msgs.msg import Twist
from sphere_nav_msgs.msg import LocalizationStatus, TrackingError

import sphere_nav
from architecture.tree import ROOT
from sphere_nav.geometry import Fisheye, Pinhole
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_odometry
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.localizer import WIDE_ROOM, drive, wide_map
from worlds.recordings import stamp, write_bag

CAMERA = Fisheye(320, 240, 120.0, 120.0, 159.5, 119.5, (0.02, -0.01, 0.0, 0.0))
TOPIC, INFO = "/cameras/top_front/image_raw", "/cameras/top_front/camera_info"
STEP_NS = 50_000_000
NUM_IMAGES = 22


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """What a demo leaves, of a room: a map, and a recorded drive with odometry and truth."""
    folder = tmp_path_factory.mktemp("demo")
    save_map(folder / "map", wide_map(-2.0, -1.0, 0.0).graph)

    def teach(k):
        T_map_camera = drive(NUM_IMAGES)[k]
        T_map_base = T_map_camera @ T_BODY_OPTICAL.inverse()
        yield INFO, camera_to_info(CAMERA, stamp(k), "optical")
        image = np.repeat(WIDE_ROOM.photograph(CAMERA, T_map_camera, k)[..., None], 3, axis=2)
        yield TOPIC, array_to_image(image, stamp(k), "optical", "rgb8")
        for topic in ("/odom", "/ground_truth/odometry"):
            yield topic, se3_to_odometry(T_map_base, np.zeros((6, 6)), stamp(k), ("odom", "base_link"))

    def driven(_):
        yield from (("/cmd_vel", Twist()), ("/tracking_error", TrackingError()), ("/status", LocalizationStatus()))

    for name, source in (("teach", teach), ("drive", driven)):
        write_bag(folder / name, source, numbers=range(NUM_IMAGES), with_mount=False)
    return folder


def test_every_public_name_is_there_and_no_other():
    assert all(getattr(sphere_nav, name) for name in sphere_nav.PUBLIC)
    assert set(sphere_nav.PUBLIC) < set(dir(sphere_nav))
    with pytest.raises(AttributeError, match="no attribute 'localise'"):
        sphere_nav.localise  # noqa: B018


def test_a_camera_has_its_centre_in_the_middle_and_takes_no_numbers_without_names():
    camera = sphere_nav.Camera.from_fx(width=640, height=480, fx=500)
    assert (camera.fy, camera.cx, camera.cy) == (500, 319.5, 239.5)
    other = sphere_nav.Camera.from_fx(width=640, height=480, fx=500, fy=501, cx=300, cy=200, distortion=[0.1, 0.2])
    assert other == Pinhole(640, 480, 500, 501, 300, 200, (0.1, 0.2))
    with pytest.raises(TypeError):
        sphere_nav.Camera.from_fx(640, 480, 500)


def test_images_are_placed_and_the_pose_is_where_the_view_looks_the_same(demo):
    truth = drive(NUM_IMAGES)
    with sphere_nav.open_map(demo / "map") as room, sphere_nav.Localizer(room) as localizer:
        for k, (stamp, image, camera) in enumerate(sphere_nav.read_images(demo / "teach", image=TOPIC)):
            estimate = localizer.localize(image, camera, stamp)
            assert estimate.T_map_camera.distance(truth[k])[0] < 0.02
            assert estimate.covariance.shape == (6, 6)
            assert estimate.is_trusted == (estimate.state == "TRACKING")
        assert estimate.is_trusted
        localizer.reset()
        assert localizer.localize(image, camera, stamp + STEP_NS).state == "PROBATION"
        nothing = localizer.localize(np.full_like(image, 90), camera)
        assert nothing.T_map_camera is None
        assert nothing.remedy
        view = sphere_nav.render(room, camera, truth[-1])
        both = view.is_known & (image[..., 0] > 0)
        assert np.median(np.abs(view.image[both].astype(float) - image[both])) < 6.0
        for call in (
            lambda: sphere_nav.render(room, truth[0], camera),
            lambda: localizer.localize(camera, image),
            lambda: sphere_nav.register(image, image),
            lambda: sphere_nav.Localizer("map"),
        ):
            with pytest.raises(TypeError, match=r"^\w+: [\w ]+: expected .*, found \w+$|^\w+: \w+: expected .*"):
                call()


EXAMPLES = {
    "timeline": ("drive",),
    "where_am_i": ("map", "teach"),
    "motion_between": ("map",),
    "fly_along": ("map",),
    "drive_errors": ("map", "teach"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_and_draws_its_picture(name, demo, tmp_path, monkeypatch, capsys):
    script = ROOT / "examples" / f"{name}.py"
    given = [str(demo / word) for word in EXAMPLES[name]]
    monkeypatch.setattr(sys, "argv", [str(script), *given, str(tmp_path / "picture.png")])
    runpy.run_path(str(script), run_name="__main__")
    assert (tmp_path / "picture.png").stat().st_size > 10_000
    assert capsys.readouterr().out


def test_two_rgbd_arrays_give_their_motion():
    camera = sphere_nav.Camera.from_fx(width=320, height=240, fx=200)
    places = drive(8)[0], drive(8)[7]
    views = [sphere_nav.RgbdView(*WIDE_ROOM.rgbd(camera, place), camera) for place in places]
    found = sphere_nav.register(*views)
    expected = T_BODY_OPTICAL @ (places[0].inverse() @ places[1]) @ T_BODY_OPTICAL.inverse()
    assert found.is_converged
    assert expected.distance(found.T_a_b)[0] < 0.01
