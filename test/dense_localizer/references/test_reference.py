"""Which key spheres an image is aligned to, by local contrast or grey levels, and when they are ready."""

from __future__ import annotations

import threading
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from dense_localizer.judge.residual import residual_image
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references import reference
from dense_localizer.references.coarse_reference import Sight
from dense_localizer.references.reference import PixelPrefetch, References, SpherePrefetch
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import Reference, build_pyramid, prepare_reference
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.pixels.contrast import contrast_window, local_contrast
from sphere_nav.photometric.pixels.pyramid import level_cameras
from sphere_nav.photometric.pixels.reference import choose_pixels, holds
from worlds.localizer import PINHOLE, SMALL_IMAGES, MemoryMap, at, locate, make_map

PARAMS = build(LocalizerParams, SMALL_IMAGES)
NARROW = Pinhole(160, 120, 330.0, 330.0, 79.5, 59.5)  # 27 degrees
AROUND = Spherical(512, 256)  # what is ahead is no nearer to it
WINDOW = Spherical(160, 96, 512.0, 176.0, 80.0)  # 112 degrees wide, looking forward


def test_whole_spheres_are_chosen_by_distance_alone(room_map):
    choice = References(room_map, PARAMS).choose(Sight(None, at(0.4, 0.0, 2.0)), PINHOLE)
    assert choice.ids == (2, 3)
    assert choice.distance_m == pytest.approx(0.4)
    assert 0.05 < choice.distance_ratio < 0.2  # walls at 3 m and more


@pytest.mark.parametrize(("region_m", "ids"), [(0.7, (2, 3)), (0.5, (2,)), (0.0, (2, 3))])
def test_a_second_reference_serves_within_its_region(room_map, region_m, ids):
    """The second one is 0.6 m away; a region of 0 is not known, and the ranges stand in for it."""
    nodes = [replace(node, region_radius_m=region_m) for node in room_map.graph]
    choice = References(MemoryMap(nodes), PARAMS).choose(Sight(None, at(0.4, 0.0, 2.0)), PINHOLE)
    assert choice.ids == ids
    if region_m:
        assert choice.distance_ratio == pytest.approx(0.4 / region_m)


@pytest.mark.parametrize(("lens", "ahead_m"), [(PINHOLE, 0.5), (NARROW, 1.2), (AROUND, 0.0)])
def test_whole_spheres_ahead_count_as_nearer_the_narrower_the_view(room_map, lens, ahead_m):
    """What one of the same place behind shows is smaller than in the image."""
    references = References(room_map, PARAMS)
    for yaw in (0.0, np.pi):
        T = at(0.0, 0.0, yaw) if lens.model == "pinhole" else SE3.from_planar(0.0, 0.0, yaw)
        moved = T.inverse() @ references._ahead(T, lens)
        np.testing.assert_allclose(moved.translation, [0.0, 0.0, ahead_m], atol=0.1)


def test_a_partial_sphere_that_looks_elsewhere_is_passed_over(room):
    places = [SE3.from_planar(0.0, 0.0, np.pi), SE3.from_planar(0.5, 0.0, 0.0), SE3.from_planar(1.0, 0.0, 0.1)]
    references = References(make_map(room, places, WINDOW), PARAMS)
    assert references.choose(Sight(None, at(0.1)), PINHOLE).ids == (1, 2)
    assert references.choose(Sight(None, at(0.1, 0.0, np.pi)), PINHOLE).ids == (0,)


def test_nothing_is_chosen_where_nothing_covers_the_view(room):
    references = References(make_map(room, [SE3.identity()], WINDOW), PARAMS)
    choice = references.choose(Sight(None, at(0.0, 0.0, np.pi)), PINHOLE)
    assert (choice.ids, choice.views) == ((), ())
    image = RigImage(build_pyramid(np.zeros((120, 160), np.uint8), PINHOLE))
    candidate = locate([image], references, PARAMS, Prediction.guess(at(0.0, 0.0, np.pi)))
    assert candidate.finding.reason == "LOW_OVERLAP"
    assert not candidate.is_accepted


@pytest.mark.slow
def test_a_live_camera_never_waits_for_a_sphere(room):
    class SlowMap(type(make_map(room, [SE3.identity()]))):
        is_open = threading.Event()

        def load_sphere(self, sphere_id):
            if sphere_id:
                assert self.is_open.wait(20.0)
            return super().load_sphere(sphere_id)

    sphere_map = SlowMap(list(make_map(room, [SE3.from_planar(0.5 * k, 0.0, 0.0) for k in range(4)]).graph))
    references = References(sphere_map, PARAMS, is_live=True)
    choice = references.choose(
        Sight(None, at(0.0), is_followed=True), AROUND
    )  # nothing is there: the small one of the nearest
    assert choice.ids == (0,)
    assert choice.views[0].reference.camera.width < 512
    references._spheres.get(0)
    references.prefetch(at(0.0), np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]))
    choice = references.choose(
        Sight(None, at(1.0), is_followed=True), AROUND
    )  # what is there, though others are nearer
    assert choice.ids == (0,)
    assert choice.views[0].reference.camera.width == 512
    assert choice.distance_m == pytest.approx(1.0)
    sphere_map.is_open.set()
    assert references.choose(Sight(None, at(0.95)), AROUND).ids == (2, 1)  # whoever is not followed waits
    assert references.choose(Sight(None, at(0.95), is_followed=True), AROUND).ids == (2, 1)


@pytest.mark.parametrize(
    ("speed", "moved_m", "is_begun"), [(0.0, 0.1, False), (0.0, 0.3, True), (10.0, 0.4, False), (10.0, 0.6, True)]
)
def test_what_is_ahead_is_asked_for_again_after_some_way_longer_at_speed(
    room_map, monkeypatch, speed, moved_m, is_begun
):
    references, begun = References(room_map, PARAMS), []
    monkeypatch.setattr(references._spheres, "begin", lambda ids: begun.append(ids))
    for x in (0.0, moved_m):
        references.prefetch(at(x), np.array([0.0, 0.0, speed, 0.0, 0.0, 0.0]))
    assert len(begun) == 1 + is_begun


@pytest.mark.parametrize("twist", [[0, 0, 8.0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0]])
def test_pixels_chosen_ahead_serve_the_next_image_however_fast_the_camera(room_map, twist):
    references, velocity = References(room_map, PARAMS), np.array(twist, float)
    for image in range(4):
        pose = at(0.0) @ SE3.exp(velocity * image / 30.0)
        for view in (choice := references.choose(Sight(None, pose, is_followed=True), PINHOLE)).views:
            T, number = pose.inverse() @ view.T_world_reference, PARAMS.registration.max_pixels // len(choice.views)
            assert holds(view.reference.level_like(PINHOLE), T, PINHOLE, number) == (image > 0)
        references.prefetch(pose, velocity)


def test_local_contrast_of_image_and_key_spheres_is_that_of_one_window(room, room_map):
    references, pose = References(room_map, PARAMS), at(0.4)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.registration.pyramid))
    window = contrast_window(room_map.load_sphere(0).camera)
    prediction = replace(Prediction.guess(pose), by_contrast=True)
    chosen = references.choose_rig([image], prediction)
    assert chosen.choice.by_contrast
    expected = local_contrast(image.pyramid.images[0], PINHOLE, window)
    np.testing.assert_array_equal(chosen.images[0].pyramid.images[0], expected)
    sphere = room_map.load_sphere(chosen.choice.ids[0])
    like = prepare_reference(
        local_contrast(sphere.levels, sphere.camera, window), sphere.range_m, sphere.camera, PARAMS.registration
    )
    levels = chosen.choice.views[0].reference.levels
    for found, known in zip(levels, like.levels, strict=True):
        np.testing.assert_array_equal(found.intensity, known.intensity)
    again = references.choose_rig([image], prediction)
    assert again.images[0].pyramid is chosen.images[0].pyramid  # once an image
    in_gray = references.choose_rig([image], Prediction.guess(pose))
    assert in_gray.images[0].pyramid is image.pyramid
    assert not in_gray.choice.by_contrast
    references.close()


def test_the_residual_is_gray_where_image_and_map_agree(room, room_map):
    pose = at(0.1, 0.0, 0.3)
    image = room.photograph(PINHOLE, pose, 2)
    image[20:50, 30:60] = 250
    pyramid = build_pyramid(image, PINHOLE, PARAMS.registration.pyramid)
    candidate = locate([RigImage(pyramid)], References(room_map, PARAMS), PARAMS, Prediction.guess(pose))
    reference = candidate.images[0].views[0].reference
    before = reference.num_bytes, sum(map(len, map(vars, reference.levels)))
    picture = residual_image(image, PINHOLE, candidate)
    assert (reference.num_bytes, sum(map(len, map(vars, reference.levels)))) == before  # nothing stays for the picture
    assert picture.shape == (120, 160)
    assert np.median(np.abs(picture.astype(int) - 128)) <= 3
    changed = picture[25:45, 35:55]
    assert np.median(changed[changed != 128]) > 150  # half of what the white patch adds, where a pixel was kept


REGISTRATION = build(LocalizerParams, SMALL_IMAGES).registration
NUMBER = REGISTRATION.max_pixels // 2


def reference_of(room_map):
    sphere = room_map.graph[0].sphere
    return prepare_reference(sphere.gray, sphere.range_m, sphere.camera, REGISTRATION)


def test_pixels_of_all_levels_are_chosen_ahead_once_the_image_moves_by_a_twentieth_of_its_width(room_map):
    reference, T = reference_of(room_map), at(0.0).inverse()
    pixels, level = PixelPrefetch(REGISTRATION, is_live=False), reference.level_like(PINHOLE)
    chosen = []
    for turn in (0.0, 0.01, 0.1):
        pixels.begin([(reference, SE3.exp([0, 0, 0, 0, turn, 0]) @ T, NUMBER)], PINHOLE)
        pixels.wait()
        chosen.append(level.selections[PINHOLE, NUMBER])
    pixels.close()
    assert np.array_equal(chosen[0].T_camera_reference.matrix, T.matrix)
    assert chosen[1] is chosen[0]
    assert chosen[2] is choose_pixels(level, SE3.exp([0, 0, 0, 0, 0.1, 0]) @ T, PINHOLE, NUMBER) is not chosen[0]
    assert (PINHOLE.halve(), NUMBER) in reference.level_like(PINHOLE.halve()).selections


def test_a_live_camera_waits_for_no_choice_and_one_is_made_after_the_other(room_map, monkeypatch):
    may_choose, asked = threading.Event(), []
    monkeypatch.setattr(reference, "renew_selection", lambda *_: (asked.append(1), may_choose.wait(2.0)))
    wanted = [(reference_of(room_map), at(0.0).inverse(), NUMBER)]
    pixels = PixelPrefetch(REGISTRATION, is_live=True)
    for _ in range(3):
        pixels.begin(wanted, PINHOLE)
        pixels.wait()
    may_choose.set()
    pixels._last.result(20.0)
    pixels.close()
    assert len(asked) == len(level_cameras(PINHOLE, REGISTRATION.pyramid.min_side, REGISTRATION.pyramid.num_levels))


def test_what_fails_while_pixels_are_chosen_is_told_to_who_asks_next(room_map, monkeypatch):
    monkeypatch.setattr(reference, "renew_selection", Mock(side_effect=MemoryError))
    pixels = PixelPrefetch(REGISTRATION, is_live=True)
    pixels.begin([(reference_of(room_map), at(0.0).inverse(), NUMBER)], PINHOLE)
    assert pixels._last.exception(20.0)
    pixels.close()
    with pytest.raises(MemoryError):
        pixels.begin([], PINHOLE)


class Sized(Reference):
    num_bytes = 10

    def __setattr__(self, name, value):
        self.__dict__[name] = value


class Reader:
    def __init__(self):
        self.read, self.fails, self.threads = [], set(), set()

    def __call__(self, sphere_id):
        self.read.append(sphere_id)
        self.threads.add(threading.current_thread().name)
        if sphere_id in self.fails:
            raise ValueError(f"sphere {sphere_id}: damaged")
        return Sized(())


def test_spheres_are_read_once_while_there_is_room():
    reader = Reader()
    preparation = SpherePrefetch(reader, 30)
    for sphere_id in (0, 1, 0, 1, 2):
        preparation.get(sphere_id)
    assert reader.read == [0, 1, 2]
    preparation.get(0)
    preparation.begin([3])  # the longest unused, 1, makes room
    preparation.get(3)
    assert sum(one.num_bytes for one in preparation._ready) == 30
    preparation.get(0)
    assert reader.read == [0, 1, 2, 3]
    preparation.get(1)
    assert reader.read == [0, 1, 2, 3, 1]
    preparation.close()


def test_two_in_use_and_the_next_are_kept_whatever_they_take():
    reader = Reader()
    preparation = SpherePrefetch(reader, 5)
    for sphere_id in (0, 1, 0, 1):
        preparation.get(sphere_id)
    preparation.begin([0, 1, 2, 3])
    for sphere_id in (0, 1, 2):
        preparation.get(sphere_id)
    preparation.close()
    assert reader.read == [0, 1, 2]


def test_what_was_begun_is_got_without_another_reading_and_by_another_thread():
    reader = Reader()
    preparation = SpherePrefetch(reader, 100)
    assert preparation.find(4) is None
    preparation.begin([3, 4])
    assert preparation.get(4) is preparation.get(4)
    assert preparation.find(4) is preparation.get(4)
    assert reader.read == [3, 4]
    assert threading.current_thread().name not in reader.threads
    preparation.close()


def test_a_sphere_that_cannot_be_read_says_so_each_time():
    reader = Reader()
    reader.fails = {1}
    preparation = SpherePrefetch(reader, 100)
    preparation.begin([1])
    assert preparation.find(1) is None
    for _ in range(2):
        with pytest.raises(ValueError, match="sphere 1: damaged"):
            preparation.get(1)
    reader.fails = set()
    preparation.get(1)
    assert reader.read == [1, 1, 1]
    preparation.close()
