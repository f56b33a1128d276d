"""The filter in a room: found from nowhere, claimed from a start, lost without odometry gracefully, never a NaN."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.image_motion import Reconciled
from mcl_depth.geometry.mesh import mesh_from_faces
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.localization.status import FINE, Reason, State, Verdict
from sphere_nav.params import build
from worlds.boxes import box
from worlds.lit_room import POSES, picture, room

PANORAMA = Spherical(512, 256)
SETTINGS = {"likeness.kind": "gradients", "camera_height": 1.2, "area.step": 0.25}
SETTINGS |= {"resampling.num_particles": 400, "input.min_way": 0.05}


@pytest.fixture(scope="module")
def site():
    return Site(room(), PANORAMA, 1.2, build(FilterParams, SETTINGS))


def test_a_camera_on_the_ground_is_a_height_that_nobody_told():
    mesh = mesh_from_faces(box((0, 0, 0), (4, 3, 2)), np.arange(36).reshape(-1, 3), "room")
    with pytest.raises(ValueError, match=r"^camera_height: expected .* 0.05 m or more, found 0 m$"):
        Site(mesh, PANORAMA, 0.0, FilterParams())


def observe(site, pose, number, odometry=True):
    image, wheels = picture(site, pose), np.array(pose) if odometry else None
    return Observation(image, site.depth_map.camera, (number + 1) * 10**9, np.eye(3), wheels)


def started(site):
    """A filter that was told where it begins: in a room, a place takes long to prove."""
    filter_ = site.filter()
    filter_.start(SE3.from_planar(*(POSES[0] + [0.1, -0.1, 0.05])), np.diag([0.2, 0.2, 0.1, 0.1, 0.1, 0.1]) ** 2)
    return filter_


def test_a_pose_is_told_with_how_sure_it_is_and_lost_once_blind_for_longer_than_allowed(site):
    filter_ = started(site)
    for number, pose in enumerate(POSES):
        estimate = filter_.update(observe(site, pose, number))
    assert estimate.status.state is State.TRACKING
    error = estimate.T_map_level.translation[:2] - POSES[-1][:2]
    assert np.hypot(*error) < 0.3  # the cache's cells are 0.35 m wide
    assert abs(float(estimate.T_map_level.yaw) - 0.1) < np.radians(6)  # half a step of 10 degrees, and a little
    assert np.all(np.linalg.eigvalsh(estimate.covariance) > 0)
    assert filter_._max_sigma_m == pytest.approx(0.33, abs=0.005)  # of what is told: next door begins a cell away
    blind_ns = len(POSES) * 10**9 + round(site.params.state.max_blind_s * 10**9)
    for late, state in [(0, State.TRACKING), (1, State.LOST)]:
        assert filter_.refuse(blind_ns + late, FINE).status.state is state


def test_from_nowhere_the_place_is_withheld_until_it_is_proven(site):
    filter_, estimates, new = site.filter(), [], []
    for number, pose in enumerate(POSES):
        estimates.append(filter_.update(observe(site, pose, number)))
        new.append(np.mean(filter_.particles.ages == 2))  # particles where the survey has found places
    assert new[0] == 0.3
    assert [share >= 0.3 for share in new] == [one.status.state is State.SEARCHING for one in estimates]
    early = [estimate.status for estimate in estimates if estimate.status.p_chance >= 1e-3]
    assert all(status.state is State.SEARCHING for status in early)
    assert "give an initial pose" in early[-1].remedy
    assert estimates[-1].status.state is State.TRACKING
    for estimate, pose in zip(estimates, POSES, strict=True):
        if estimate.T_map_level is not None:
            assert np.hypot(*(estimate.T_map_level.translation - pose)[:2]) < 0.3


def test_a_start_that_was_wrong_is_never_claimed(site):
    filter_ = site.filter()
    filter_.start(SE3.from_planar(0.5, 0.5, 2.5), np.diag([0.2, 0.2, 0.1, 0.1, 0.1, 0.1]) ** 2)
    for number, pose in enumerate(POSES):
        estimate = filter_.update(observe(site, pose, number))
        if estimate.T_map_level is not None:  # found after the start was refused
            assert np.hypot(*(estimate.T_map_level.translation - pose)[:2]) < 0.3
    assert not filter_.evidence.is_on_trial


def test_odometry_that_ends_is_named_and_the_pose_stays_for_a_while(site):
    filter_ = started(site)
    for number, pose in enumerate(POSES):
        filter_.update(observe(site, pose, number))
    blind = [filter_.update(observe(site, POSES[-1], len(POSES) + k, odometry=False)) for k in range(3)]
    assert blind[0].T_map_level is not None
    for estimate in blind:
        assert (estimate.status.state is State.TRACKING, bool(estimate.status.reason)) == (False, True)
        if estimate.T_map_level is not None:
            assert np.hypot(*(estimate.T_map_level.translation[:2] - POSES[-1][:2])) < 1.0


def tracked(site):
    """A filter that tracks the right place at the last of the poses."""
    filter_ = started(site)
    for number, pose in enumerate(POSES[:9]):
        estimate = filter_.update(observe(site, pose, number))
    assert estimate.status.state is State.TRACKING
    return filter_


def test_wheels_that_stand_while_the_camera_goes_on_end_tracking_and_the_images_carry_the_pose(site):
    filter_ = tracked(site)
    for number, pose in enumerate(POSES[9:], 9):
        camera = site.depth_map.camera
        image = picture(site, pose)
        estimate = filter_.update(Observation(image, camera, (number + 1) * 10**9, np.eye(3), POSES[8]))
        assert estimate.status.state is State.DEGRADED
        assert estimate.status.reason == "JUMP_REJECTED"
        assert "odometry says 0.00 m, the images" in estimate.status.remedy
        assert np.hypot(*(estimate.T_map_level.translation[:2] - pose[:2])) < 0.3


def test_after_a_jump_of_the_stamps_the_place_is_searched_anew(site):
    filter_ = started(site)
    for number, pose in enumerate([*POSES[:6], *3 * [POSES[8]]]):
        estimate = filter_.update(observe(site, pose, number + 1000 * (number < 6)))
    assert estimate.status.reason not in ("BAD_STAMP", "JUMP_REJECTED")
    assert (estimate.status.state, estimate.T_map_level) == (State.SEARCHING, None)  # 0.7 m off, told as TRACKING


def test_a_mounting_turned_by_a_right_angle_is_named_and_never_tracked(site):
    filter_ = site.filter()
    turned = SE3.from_planar(0.0, 0.0, np.pi / 2).rotation
    start = SE3.from_planar(*(POSES[0] - [0.0, 0.0, np.pi / 2]))  # the heading that the images confirm
    filter_.start(start, np.diag([0.1, 0.1, 0.1, 0.1, 0.1, 0.1]) ** 2)
    remedies = []
    for number, pose in enumerate(POSES):
        seen = Observation(picture(site, pose), site.depth_map.camera, (number + 1) * 10**9, turned, np.array(pose))
        estimate = filter_.update(seen)
        assert estimate.status.state is not State.TRACKING
        remedies.append(estimate.status.remedy)
    assert ["mounting" in remedy for remedy in remedies[:4]] == [False, True, True, True], remedies


def test_a_camera_put_down_elsewhere_is_not_tracked_at_the_old_place(site):
    filter_ = tracked(site)
    elsewhere = np.array([1.4, -1.2, 2.0])
    for number in range(9, 14):
        image = picture(site, elsewhere + np.array([0.05 * number, 0.0, 0.0]))
        observation = Observation(image, site.depth_map.camera, (number + 1) * 10**9, np.eye(3), POSES[8])
        assert filter_.update(observation).status.state is not State.TRACKING


def test_who_is_carried_off_while_the_wheels_stand_is_compared_with_the_map_at_once(site, monkeypatch):
    filter_, carried = tracked(site), Verdict(Reason.JUMP_REJECTED, 9.0, 4.0)
    for tenth, finding, is_compared in [(1, FINE, True), (2, FINE, False), (3, carried, True)]:
        monkeypatch.setattr(filter_.odometry, "reconcile", lambda seen, is_held, f=finding: Reconciled(seen, f))
        seen = replace(observe(site, POSES[8], 8), stamp_ns=9 * 10**9 + tenth * 10**8)
        seen = replace(seen, image=seen.image + tenth)  # no frozen one
        assert (filter_.update(seen).belief is not None) == is_compared


def test_images_of_another_size_and_repeated_stamps_change_nothing(site):
    filter_ = site.filter()
    filter_.update(observe(site, POSES[0], 0))
    before = filter_.particles
    wrong = Observation(np.zeros((10, 10), np.uint8), Spherical(64, 32), 2 * 10**9, np.eye(3))
    assert filter_.update(wrong).status.reason == "BAD_INFO"
    assert filter_.update(observe(site, POSES[0], 0)).status.reason == "BAD_STAMP"
    assert filter_.particles is before
