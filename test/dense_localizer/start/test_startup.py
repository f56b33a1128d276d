from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams, SearchParams
from dense_localizer.references.reference import References
from dense_localizer.start.guesses import Guess, is_same_pose, select_best, select_distinct
from dense_localizer.start.startup import Startup, candidate_poses, decide, find_attitude, ways_to_look
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.localization.status import Reason
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.localizer import PINHOLE, SMALL_IMAGES, MemoryMap, at, locate, make_map

PARAMS = build(LocalizerParams, SMALL_IMAGES)


def pyramid_at(room, pose):
    return build_pyramid(room.photograph(PINHOLE, pose, 3), PINHOLE, PARAMS.registration.pyramid)


def find_start(references, pyramid):
    """Search everywhere, as the localizer does."""
    seen = RigImage(pyramid)
    return choose(Startup(references, PARAMS).propose(seen), references, seen)


def choose(poses, references, seen):
    """Return what comes of proposed poses."""
    return decide([locate([seen], references, PARAMS, Prediction.guess(pose)) for pose in poses], PARAMS.start)


def test_the_camera_is_found_anywhere_at_any_heading(room, room_map):
    start = find_start(References(room_map, PARAMS), pyramid_at(room, at(-1.4, -0.3, 2.0)))
    assert start.candidate is not None
    off = start.candidate.T_map_camera.distance(at(-1.4, -0.3, 2.0))
    assert np.all(np.less(off, (0.015, 0.008)))  # as in tracking


def test_a_camera_turned_about_its_axis_is_found(room, room_map):
    references = References(room_map, PARAMS)
    pose = at(0.2, 0.1, 0.4) @ SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, np.radians(-70.0)])
    seen = RigImage(pyramid_at(room, pose))
    start = choose(Startup(references, PARAMS).propose_turned(seen), references, seen)
    assert start.candidate is not None
    assert np.all(np.less(start.candidate.T_map_camera.distance(pose), (0.015, 0.008)))


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, 35.0), (90.0, -20.0)])
def test_a_camera_is_found_at_once_where_its_mounting_is_known(room, room_map, roll_deg, pitch_deg):
    T_base_body = SE3.from_angles(*np.radians([roll_deg, pitch_deg, 0.0]), [0.1, 0.0, 0.2]) @ T_BODY_OPTICAL
    references, pose = References(room_map, PARAMS), SE3.from_planar(-0.7, 0.1, 1.9) @ T_base_body
    references.ground.T_base_body = T_base_body
    start = find_start(references, pyramid_at(room, pose))
    assert start.candidate is not None
    assert np.all(np.less(start.candidate.T_map_camera.distance(pose), (0.015, 0.008)))


def test_a_camera_far_below_the_mapping_one_is_looked_for_where_it_is(room):
    """Its vehicle has the spheres 1.1 m above ground, and it a hand's breadth."""
    sphere_map = make_map(room, [SE3.from_planar(0.0, 0.0, 1.0), SE3.from_planar(0.6, 0.0, 1.0)])
    sphere_map.T_base_sphere = SE3.from_parts(np.eye(3), [0.0, 0.0, 1.1])
    references, T_base_camera = (
        References(sphere_map, PARAMS),
        SE3.from_parts(np.eye(3), [0.2, 0.0, 0.1]) @ T_BODY_OPTICAL,
    )
    references.ground.T_base_body = T_base_camera
    pose = SE3.from_planar(0.1, 0.2, 1.3) @ SE3.from_parts(np.eye(3), [0.0, 0.0, -1.1]) @ T_base_camera
    seen = RigImage(pyramid_at(room, pose))
    assert find_attitude(seen, references.ground).translation[2] == pytest.approx(-1.0)
    for poses in (Startup(references, PARAMS).propose(seen), Startup(references, PARAMS).propose_near(seen, pose)):
        assert np.all(np.less(poses[0].distance(pose), (0.1, 0.05)))
        assert all(abs(one.translation[2] + 1.0) < 0.1 for one in poses)


def test_a_partial_sphere_is_found_beside_its_heading(room):
    window = Spherical(160, 96, 512.0, 176.0, 80.0)  # 112 degrees wide, looking forward
    sphere_map = make_map(room, [SE3.from_planar(0.0, 0.0, 1.0)], window)
    pose = at(0.15, 0.1, 1.25, 0.05)
    start = find_start(References(sphere_map, PARAMS), pyramid_at(room, pose))
    assert start.candidate is not None
    assert np.all(np.less(start.candidate.T_map_camera.distance(pose), (0.03, 0.015)))


def test_another_room_resembles_nothing(room, room_map):
    noise = np.random.default_rng(4).integers(0, 255, (120, 160), dtype=np.uint8)
    pyramid = build_pyramid(noise, PINHOLE, PARAMS.registration.pyramid)
    start = find_start(References(room_map, PARAMS), pyramid)
    assert start.candidate is None
    assert start.finding.reason is Reason.LOW_OVERLAP
    assert "resembles" in start.finding.detail


def test_two_rooms_that_look_alike_are_ambiguous(room):
    sphere = room.sphere(SE3.identity(), Spherical(512, 256))
    twins = [KeySphere(k, k, SE3.from_planar(40.0 * k, 0.0, 0.0), sphere) for k in range(2)]
    start = find_start(References(MemoryMap(twins), PARAMS), pyramid_at(room, at(0.1, 0.0, 0.4)))
    assert start.candidate is None
    assert start.finding.reason is Reason.AMBIGUOUS
    assert start.finding.value < start.finding.limit


def candidate(ncc, x=0.0, yaw=0.0, is_good=True, is_by_range=False, is_by_parts=False):
    by = {"is_by_range": is_by_range, "is_by_parts": is_by_parts}
    return SimpleNamespace(acceptance=SimpleNamespace(is_good=is_good), ncc=ncc, T_map_camera=at(x, 0.0, yaw), **by)


def test_another_place_that_is_nearly_as_much_alike_makes_it_ambiguous():
    for other, is_ambiguous in [
        (candidate(0.71, 3.0), True),
        (candidate(0.69, 3.0), False),
        (candidate(0.79, 0.0, np.radians(11.0)), True),
        (candidate(0.79, 0.29, np.radians(9.0)), False),
    ]:
        found = decide([other, candidate(0.8)], SearchParams())
        assert (found.candidate is None) == is_ambiguous
        if is_ambiguous:
            lead = 0.8 - other.ncc
            assert (found.finding.reason, found.finding.value) == (Reason.AMBIGUOUS, pytest.approx(lead))


def test_what_resembles_nothing_may_be_the_one_place_of_a_range():
    found = decide([candidate(0.49), candidate(0.3)], SearchParams())
    assert (found.candidate, found.finding.reason, found.finding.value) == (None, Reason.LOW_OVERLAP, 0.49)
    one, same, other = (candidate(n, x, is_by_range=True) for n, x in ((0.2, 0.0), (0.1, 0.2), (0.15, 3.0)))
    assert decide([candidate(0.4, 5.0), same, one], SearchParams()).candidate is one
    assert decide([one, other], SearchParams()).finding.reason is Reason.LOW_OVERLAP
    assert decide([candidate(0.51), one, other], SearchParams()).candidate.ncc == 0.51


def test_guesses_that_are_clearly_behind_are_not_aligned_at_full_resolution(monkeypatch):
    scores = [0.5, 0.9, 0.64, 0.66, 0.2]
    guesses = [Guess(None, at(float(place), 0.0, 0.0), score) for place, score in enumerate(scores)]
    startup = Startup(None, PARAMS)
    monkeypatch.setattr(startup, "_align", lambda seen, guess: guess)
    poses = startup._refine(RigImage(None), guesses)
    assert [round(float(pose.translation[0])) for pose in poses] == [1, 3]


def test_candidate_poses_go_all_around_a_whole_sphere_and_about_the_middle_of_a_part(room, room_map):
    params, upright = SearchParams(heading_step_deg=30.0), SE3.identity()
    window, step_m = References(room_map, PARAMS).coarse[0].camera, 0.5
    whole, ahead = ways_to_look(params, PINHOLE, window, upright)
    np.testing.assert_allclose(whole.rotation[:, :, 2], ahead, atol=1e-9)  # where the camera looks, it goes on
    assert len(np.unique(np.round(ahead, 6), axis=0)) == 12
    poses = candidate_poses(whole, ahead, step_m)
    assert poses.matrix.shape == (36, 4, 4)  # 12 headings, 3 places
    np.testing.assert_allclose(poses.translation.reshape(12, 3, 3)[:, 2], step_m * ahead, atol=1e-9)
    part = Spherical(100, 60, 512.0, 0.0, 98.0)
    _, ahead = ways_to_look(params, PINHOLE, part, upright)
    assert ahead.shape == (15, 3)  # 5 x 3 directions
    middle = part.unproject([49.5, 29.5])
    assert np.any(np.all(np.isclose(ahead, middle, atol=1e-9), axis=1))


NODE = KeySphere(0, 1, SE3.identity())


def test_the_best_come_first_and_of_one_place_only_the_first_is_kept():
    guesses = [Guess(NODE, at(float(k)), score) for k, score in enumerate((0.2, 0.5, 0.5, 0.9))]
    assert [guess.T_map_camera.translation[0] for guess in select_best(guesses, 3)] == [3.0, 1.0, 2.0]
    guesses = [Guess(NODE, at(x)) for x in (0.0, 0.2, 1.0, 1.1, 5.0)]
    assert [guess.T_map_camera.translation[0] for guess in select_distinct(guesses, 2)] == [0.0, 1.0]
    for x, yaw, is_same in [(0.29, 0.17, True), (0.31, 0.0, False), (0.0, 0.18, False)]:
        assert is_same_pose(at(0.0), at(x, 0.0, yaw)) == is_same
