import threading
from dataclasses import replace

import numpy as np
import pytest

from dense_localizer.judge.residual import residual_image
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references import coarse_reference
from dense_localizer.references.likeness import score_poses
from dense_localizer.references.reference import References, measure_coverage
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid, prepare_reference
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.pixels.contrast import contrast_window, local_contrast
from worlds.localizer import PINHOLE, SMALL_IMAGES, MemoryMap, at, locate, make_map
from worlds.room import Room

PARAMS = build(LocalizerParams, SMALL_IMAGES)
WINDOW = Spherical(160, 96, 512.0, 176.0, 80.0)  # 112 degrees wide, looking forward


def test_whole_spheres_are_chosen_by_distance_alone(room_map):
    choice = References(room_map, PARAMS).choose(at(0.4, 0.0, 2.0), PINHOLE)
    assert choice.ids == (2, 3)
    assert choice.distance_m == pytest.approx(0.4)
    assert 0.05 < choice.distance_ratio < 0.2  # walls at 3 m and more


@pytest.mark.parametrize(("region_m", "ids"), [(0.7, (2, 3)), (0.5, (2,)), (0.0, (2, 3))])
def test_a_second_reference_serves_within_its_region(room_map, region_m, ids):
    """The second one is 0.6 m away; a region of 0 is not known, and the ranges stand in for it."""
    nodes = [replace(node, region_radius_m=region_m) for node in room_map.graph]
    choice = References(MemoryMap(nodes), PARAMS).choose(at(0.4, 0.0, 2.0), PINHOLE)
    assert choice.ids == ids
    if region_m:
        assert choice.distance_ratio == pytest.approx(0.4 / region_m)


def test_a_partial_sphere_that_looks_elsewhere_is_passed_over(room):
    places = [SE3.from_planar(0.0, 0.0, np.pi), SE3.from_planar(0.5, 0.0, 0.0), SE3.from_planar(1.0, 0.0, 0.1)]
    references = References(make_map(room, places, WINDOW), PARAMS)
    assert references.choose(at(0.1), PINHOLE).ids == (1, 2)
    assert references.choose(at(0.1, 0.0, np.pi), PINHOLE).ids == (0,)


def test_nothing_is_chosen_where_nothing_covers_the_view(room):
    references = References(make_map(room, [SE3.identity()], WINDOW), PARAMS)
    choice = references.choose(at(0.0, 0.0, np.pi), PINHOLE)
    assert (choice.ids, choice.views) == ((), ())
    image = RigImage(build_pyramid(np.zeros((120, 160), np.uint8), PINHOLE))
    candidate = locate([image], references, PARAMS, Prediction.guess(at(0.0, 0.0, np.pi)))
    assert candidate.finding.reason == "LOW_OVERLAP"
    assert not candidate.is_accepted


def test_only_what_is_chosen_is_read(room):
    sphere_map = make_map(room, [SE3.from_planar(0.3 * k, 0.0, 0.0) for k in range(4)], WINDOW)
    references = References(sphere_map, PARAMS)
    assert sphere_map.num_loaded == 0
    assert references.choose(at(0.05), PINHOLE).ids == (0, 1)
    assert sphere_map.num_loaded == 2


@pytest.mark.slow
def test_what_lies_ahead_is_prepared_before_it_is_needed(room):
    sphere_map = make_map(room, [SE3.from_planar(0.5 * k, 0.0, 0.0) for k in range(8)])
    references = References(sphere_map, PARAMS)
    velocity = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])  # along the optical axis
    references.choose(at(0.0), PINHOLE)
    references.prefetch(at(0.0), velocity)
    references.prefetch(at(0.05), velocity)  # too near to look again
    references.close()  # when all is done
    assert sphere_map.num_loaded <= 6
    references = References(sphere_map, PARAMS)
    references.prefetch(at(0.0), velocity)
    for k in (2, 4):  # around x = 1 and x = 2
        references._spheres.get(k)
    number = sphere_map.num_loaded
    references.choose(at(2.0), PINHOLE)
    assert sphere_map.num_loaded <= number + 1


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
    choice = references.choose(at(0.0), PINHOLE, is_followed=True)  # nothing is there: the small one of the nearest
    assert choice.ids == (0,)
    assert choice.views[0].reference.camera.width < 512
    references._spheres.get(0)
    references.prefetch(at(0.0), np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]))
    choice = references.choose(at(1.0), PINHOLE, is_followed=True)  # what is there, though others are nearer
    assert choice.ids == (0,)
    assert choice.views[0].reference.camera.width == 512
    assert choice.distance_m == pytest.approx(1.0)
    sphere_map.is_open.set()
    assert references.choose(at(1.0), PINHOLE).ids == (2, 1)  # whoever is not followed waits
    assert references.choose(at(1.0), PINHOLE, is_followed=True).ids == (2, 1)


def seen_from(room, pose):
    return RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.registration.pyramid))


def test_local_contrast_of_image_and_key_spheres_is_that_of_one_window(room, room_map):
    references, image, pose = References(room_map, PARAMS), seen_from(room, at(0.4)), at(0.4)
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


def test_what_explained_an_image_serves_the_next_one_and_is_prepared(room, room_map):
    references, image, pose = References(room_map, PARAMS), seen_from(room, at(0.4)), at(0.4)
    followed = Prediction(pose, 1e-6 * np.eye(6), 0)
    assert not references.choose_rig([image], followed).choice.by_contrast
    references.adopt(references.choose_rig([image], replace(followed, by_contrast=True)).choice)
    assert references.choose_rig([image], followed).choice.by_contrast
    references.prefetch(at(1.9), None)
    assert references._spheres.find(~4) is not None
    assert references._spheres.find(4) is None  # no grey levels are read
    ahead = references.choose_rig([image], replace(followed, T_map_camera=at(1.9)))
    assert set(ahead.choice.ids) == {4, 3}
    references.adopt(references.choose_rig([image], replace(followed, by_contrast=False)).choice)
    assert not references.choose_rig([image], followed).choice.by_contrast
    references.close()


def test_a_live_camera_does_not_compare_contrast_with_grey_levels(room, room_map):
    references, image = References(room_map, PARAMS, is_live=True), seen_from(room, at(0.4))
    by_contrast = Prediction(at(0.4), 1e-6 * np.eye(6), 0, by_contrast=True)
    first = references.choose_rig([image], by_contrast)  # nothing is ready
    assert (first.choice.ids, first.covered) == ((), ())
    assert first.choice.by_contrast
    references._spheres.get(~2)  # it was asked for
    assert references.choose_rig([image], by_contrast).choice.ids == (2,)
    references.close()


def test_who_wants_no_contrast_gets_none(room, room_map):
    references = References(room_map, build(LocalizerParams, SMALL_IMAGES | {"alignment.contrast": False}))
    prediction = replace(Prediction.guess(at(0.4)), by_contrast=True)
    assert not references.choose_rig([seen_from(room, at(0.4))], prediction).choice.by_contrast
    assert not references.knows_contrast
    references.close()


@pytest.mark.slow
def test_memory_holds_whatever_the_way(room):
    sphere_map = make_map(room, [SE3.from_planar(0.3 * k, 0.0, 0.0) for k in range(12)])
    params = build(LocalizerParams, SMALL_IMAGES | {"reference.memory": 16.0})
    references = References(sphere_map, params)
    for x in np.arange(0.0, 3.3, 0.1):
        references.choose(at(x), PINHOLE)
        references.prefetch(at(x), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
        assert references._spheres.num_bytes <= 16e6
    assert references._spheres.num_bytes > 4e6  # and is used


def test_few_small_spheres_are_kept_ready(room_map, monkeypatch):
    monkeypatch.setattr(coarse_reference, "NUM_PREPARED", 1)
    coarse = References(room_map, PARAMS).coarse
    first = coarse.reference(0)
    assert coarse.reference(0) is first
    coarse.reference(1)
    assert coarse.reference(0) is not first


def test_small_spheres_are_looked_at_when_they_are_asked_for(room_map):
    coarse = References(room_map, PARAMS).coarse
    assert not coarse
    assert coarse[1] is coarse[1]
    assert list(coarse) == [1]
    with pytest.raises(KeyError):
        coarse[99]


def test_coverage_counts_the_cells_that_points_reach():
    points = PINHOLE.unproject(np.stack(np.meshgrid(np.arange(0, 80, 5), np.arange(0, 120, 5)), -1).reshape(-1, 2))
    behind = -points
    found = measure_coverage([points, behind, points[:1]], [SE3.identity()] * 3, PINHOLE)
    np.testing.assert_allclose(found, [0.5, 0.0, 1 / 48])  # the left half, nothing, one of 8 x 6 cells
    assert measure_coverage([], [], PINHOLE).shape == (0,)


def test_an_image_resembles_its_own_sphere_most(room, room_map):
    level = References(room_map, PARAMS).coarse[2].reference.levels[-1]
    image = build_pyramid(room.photograph(PINHOLE, at(0.0, 0.0, 0.7), 1), PINHOLE, PARAMS.registration.pyramid)
    yaws = np.arange(0.0, 6.2, 0.1)
    poses = SE3(np.stack([at(0.0, 0.0, yaw).matrix for yaw in yaws]))
    score = score_poses(level.points.T, level.intensity, poses.inverse(), image.levels[-1])
    assert yaws[np.argmax(score)] == pytest.approx(0.7, abs=0.05)
    assert score.max() > 1.5 * np.sort(score)[-10]  # ten headings span the width of the peak
    nothing = score_poses(level.points.T[:5], level.intensity[:5], poses.inverse(), image.levels[-1])
    assert np.all(nothing == -1.0)


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


class PaleWall(Room):
    """A room whose wall ahead has 15 % of the contrast of the others."""

    def cast(self, origin, rays):
        gray, range_m = super().cast(origin, rays)
        is_ahead = (origin + rays * range_m[..., None])[..., 0] > self.half[0] - 1e-6
        return np.where(is_ahead, 128.0 + 0.15 * (gray - 128.0), gray), range_m


@pytest.mark.slow
def test_pixels_are_the_best_of_what_is_seen_not_of_the_sphere():
    """M15 eq. 16: a pale wall before the camera gets all pixels, though others of the sphere are more salient."""
    room = PaleWall((2.5, 4.0, 3.0))
    sphere_map = make_map(room, [SE3.identity(), SE3.from_planar(0.4, 0.1, 0.0)], Spherical(1024, 512))
    camera = Pinhole(320, 240, 260.0, 260.0, 159.5, 119.5)
    errors, counts = {}, {}
    for max_pixels in (8_000, 1_000_000):
        params = build(LocalizerParams, SMALL_IMAGES | {"alignment.max_pixels": max_pixels})
        references = References(sphere_map, params)
        found = []
        for seed in range(8):
            pose = at(0.2, 0.05 * seed - 0.2, 0.02 * seed)
            pyramid = build_pyramid(room.photograph(camera, pose, seed), camera, params.registration.pyramid)
            start = pose @ SE3.exp([0.02, -0.02, 0.02, 0.005, 0.005, -0.005])
            candidate = locate([RigImage(pyramid)], references, params, Prediction.guess(start))
            assert candidate.alignment.num_pixels > 0.8 * min(max_pixels, 30_000)
            found.append(candidate.T_map_camera.distance(pose)[0])
            counts[max_pixels] = candidate.alignment.num_pixels
        errors[max_pixels] = np.sqrt(np.mean(np.square(found)))
    by_number = np.sqrt(counts[1_000_000] / counts[8_000])  # what pixels of any kind would cost
    assert errors[8_000] < 1.2 * by_number * errors[1_000_000]
