from dataclasses import replace
from functools import reduce
from operator import or_
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.constants import GOOD_OVERLAP
from dense_localizer.inputs import LocalizerInput
from dense_localizer.judge.candidate import Acceptance, PoseCandidate
from dense_localizer.judge.integrity import CHECKS_DUE, Integrity, align_rig
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, References, RigChoice
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, TRUSTED, Reason, State
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import EVERYTHING, NO_SUPPORT, Aspect, PoseBias, Structure
from worlds.localizer import PINHOLE, SMALL_IMAGES, STEP_NS, Run, at, drive, error, make_localizer, make_map
from worlds.parked import ParkingRoom, boxes_along
from worlds.room import Room

INTEGRITY_PERIOD, MAP_PHASE = 10, 5


def test_every_image_gets_the_full_check_until_the_pose_is_trusted(room_map):
    integrity = Integrity(References(room_map, LocalizerParams()), LocalizerParams())
    asked = {state: integrity.find_due(state) for state in State if state is not State.TRACKING}
    assert asked == {state: EVERYTHING if state is State.DEGRADED else EVERYTHING | Aspect.PLACE for state in asked}


def test_in_ten_images_in_tracking_all_checks_are_due_and_no_two_at_once():
    phases = [*CHECKS_DUE, MAP_PHASE - 1]  # that one is counted after the image
    assert len(set(phases)) == len(phases)
    assert max(phases) < INTEGRITY_PERIOD
    assert reduce(or_, CHECKS_DUE.values()) is EVERYTHING


@pytest.mark.parametrize(("sigmas", "num_trusted"), [(3.5, 30), (3.7, 8)])
def test_images_of_which_each_may_be_far_from_its_prediction_may_not_all_be(room_map, sigmas, num_trusted):
    """By 10 images of 6 numbers, one drive in a million: 3.58 deviations each."""
    params, small, frame = LocalizerParams(), 1e-6 * np.eye(6), LocalizerInput(STEP_NS)
    integrity, prediction = Integrity(References(room_map, params), params), Prediction(SE3.identity(), small, 0)
    nothing = Choice((), (), 0.0, np.inf, np.inf, np.inf)
    good = Acceptance(is_accepted=True, is_good=True, finding=FINE, quality=1.0)
    off = SE3.exp([0.0, sigmas * np.sqrt(2e-6), 0.0, 0.0, 0.0, 0.0])
    candidate = PoseCandidate(off, small, prediction, nothing, good)
    found = [integrity.confirm(frame, candidate, candidate, State.TRACKING) for _ in range(30)]
    reasons = [one.reason for one in found]
    assert reasons == [Reason.NONE] * num_trusted + [Reason.JUMP_REJECTED] * (30 - num_trusted)
    integrity.start(frame, candidate)
    assert integrity.confirm(frame, candidate, candidate, State.TRACKING) is FINE


def test_a_place_is_as_unlikely_to_be_wrong_as_the_parts_that_agree_on_it(room, monkeypatch):
    params, pose = build(LocalizerParams, SMALL_IMAGES), at(-1.0)
    references = References(make_map(room, [SE3.from_planar(-1.2, 0.0, 0.0)]), params)
    images = [RigImage(build_pyramid(room.photograph(PINHOLE, pose, 1), PINHOLE, params.registration.pyramid))]
    guess = Prediction.guess(pose)
    chosen = references.choose_rig(images, guess)
    aligned = align_rig(chosen, guess, params)
    for chance in (1e-9, 0.5):
        support = replace(NO_SUPPORT, chance=chance, num_cells=9, covariance=1e-6 * np.eye(6))
        structure = Structure(support=support)
        monkeypatch.setattr("dense_localizer.judge.integrity.find_rig_structure", lambda *given, it=structure: it)
        candidate = Integrity(references, params).assess(chosen, aligned, guess)
        assert (candidate.is_accepted, candidate.is_by_parts) == (True, chance < 1e-7)
        assert candidate.num_images == (2 if chance < 1e-7 else 1)  # that it counts for on probation
        assert candidate.is_biased  # what has changed may pull
    found = []
    for share in (0.0, 1.0):
        structure = Structure(occlusion=PoseBias(share, 0.04 * np.eye(6)[0]))
        monkeypatch.setattr("dense_localizer.judge.integrity.find_rig_structure", lambda *given, it=structure: it)
        found.append(np.diag(Integrity(references, params).assess(chosen, aligned, guess).covariance))
    np.testing.assert_allclose(found[1] - found[0], [0.008**2] * 3 + [0.0] * 3, atol=1e-6)  # a fifth may remain
    references.close()


def test_who_walks_by_makes_the_map_no_less_certain():
    seen = []
    references = SimpleNamespace(
        pixels_per_radian=326.0, error=SimpleNamespace(observe=lambda images, *_: seen.append(images))
    )
    integrity, accepted = Integrity(references, LocalizerParams()), Acceptance(True, True, FINE, 1.0)
    given = SE3.identity(), np.eye(6), Prediction.guess(SE3.identity()), None, accepted, object()
    for is_biased in [True] * INTEGRITY_PERIOD + [False] * INTEGRITY_PERIOD:
        one = PoseCandidate(*given, images=(is_biased,), is_biased=is_biased, is_by_range=True)
        integrity.confirm(LocalizerInput(1), one, one, State.TRACKING)
    assert seen == [(False,)]


def test_a_view_that_no_key_sphere_covers_is_refused_by_how_little_they_cover(room_map):
    references = References(room_map, LocalizerParams())
    nothing = RigChoice((), replace(Choice.merge(()), overlap=0.05))
    found = Integrity(references, LocalizerParams()).assess(nothing, None, Prediction.guess(at(0.0))).finding
    assert (found.reason, found.value, found.limit) == (Reason.LOW_OVERLAP, 0.05, GOOD_OVERLAP)
    references.close()


@pytest.mark.slow
def test_a_wrong_lens_never_tracks(room, room_map):
    run = Run(room, make_localizer(room_map))
    run.camera = replace(PINHOLE, fx=0.8 * PINHOLE.fx, fy=0.8 * PINHOLE.fy)
    for k, pose in enumerate(drive(15)):
        image = room.photograph(run.camera, pose, k)
        status = run.localizer.update(image, PINHOLE, (k + 1) * STEP_NS).status
        assert status.state not in (State.TRACKING, State.DEGRADED)


@pytest.mark.slow
def test_a_bumper_in_the_view_does_not_drag_the_pose():
    room = Room((5.0, 3.0, 1.5), (1.0, 14.0, 30), gain=30.0, seed=42)
    localizer = make_localizer(make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0, 0.0, 1.0, 2.0)]))
    run, patch = Run(room, localizer), np.random.default_rng(42).integers(0, 255, (8, 11))
    load = np.kron(patch, np.ones((15, 15)))[:, :64]  # 40 % of the view
    poses = [at(-1.9 + 0.05 * k, 0.1 * np.sin(0.2 * k), 0.3 * np.sin(0.1 * k)) for k in range(50)]
    localizer.relocalize(poses[0])

    def cover(image):
        return np.hstack([load, image[:, 64:]]).astype(np.uint8)

    for k, pose in enumerate(poses):
        estimate = run.see(pose, cover if k >= 10 else lambda image: image)
        if k > 3:
            assert estimate.status.state in TRUSTED
            assert error(estimate, pose)[0] < 0.1  # 0.46 m off in TRACKING, then lost, without that evidence


@pytest.mark.slow
def test_an_alignment_that_failed_in_another_light_is_done_by_parts():
    day, other = (
        ParkingRoom((8.0, 3.0, 1.5), (1.0, 20.0, 30), gain=30.0, boxes=boxes_along(*boxes))
        for boxes in ((1, (0.0, 1.6, 3.2)), (7, (-0.7, 1.0, 2.6)))
    )
    params = build(LocalizerParams, SMALL_IMAGES)
    references = References(make_map(day, [SE3.from_planar(x, 0.0, 0.0) for x in (-2.0, -1.0)]), params)
    pose = at(-1.7, 0.1, 0.1)
    images = [RigImage(build_pyramid(other.photograph(PINHOLE, pose, 1), PINHOLE, params.registration.pyramid))]
    near, far = SE3.exp([0.03, 0.0, 0.04, 0.0, 0.01, 0.0]), SE3.from_planar(1.5, 0.4, 0.5)
    for off, reason, is_found in [(near, "NO_CONVERGENCE", True), (near, "OUTLIERS", True), (far, "OUTLIERS", False)]:
        guess = Prediction.guess(pose @ off, is_near=True)
        chosen = references.choose_rig(images, guess)
        failed = replace(
            align_rig(chosen, guess, params), T_world_camera=pose @ SE3.exp([0.5, 0, 0, 0, 0, 0]), reason=reason
        )
        candidate = Integrity(references, params).assess(chosen, failed, guess)
        assert candidate.is_accepted == candidate.is_by_parts == is_found
        if is_found:
            assert candidate.T_map_camera.distance(pose)[0] < 0.02
    references.close()
