import numpy as np
import pytest

from dense_localizer.judge.odometry_check import OdometryCheck, OdometrySample
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Reason

DISPUTE_S = 10.0

STEP_NS = 50_000_000
COVARIANCE = np.diag([0.002**2] * 3 + [0.001**2] * 3)
ERROR = 0.05


def at(t):
    """A camera that weaves at 1 m/s."""
    return SE3.from_planar(t, 0.4 * np.sin(0.7 * t), 0.5 * np.sin(0.5 * t))


class Drive:
    """Odometry with 1 % of noise, images `late_s` late, poses with the noise that they admit."""

    def __init__(self, seed, late_s=0.0, scale=1.0):
        self.rng, self.late_s, self.scale = np.random.default_rng(seed), late_s, scale
        self.check, self.k, self.T_odom = OdometryCheck(ERROR), 100, SE3.identity()

    def settle(self):
        """Drive a second on poses like those of odometry."""
        for _ in range(20):
            self.step()
        return self

    def step(self, *, is_trusted=True, T_error=None, T_told=None, sigma=1.0, defies_odometry=False):
        self.k += 1
        t, before = self.k * STEP_NS * 1e-9, (self.k - 1) * STEP_NS * 1e-9
        moved = (at(before).inverse() @ at(t)).log()
        self.T_odom = self.T_odom @ SE3.exp(self.scale * moved * (1 + 0.01 * self.rng.normal(size=6)))
        self.check.propagate(self.T_odom, is_trusted=is_trusted)
        noise = SE3.exp(self.rng.normal(size=6) * np.sqrt(np.diagonal(COVARIANCE)))
        where = at(t - self.late_s) @ noise
        T_map_camera = where @ (T_error or SE3.identity())
        covariance = sigma**2 * COVARIANCE
        sample = OdometrySample(self.k * STEP_NS, T_map_camera, covariance, self.T_odom)
        joined = OdometrySample(self.k * STEP_NS, where @ T_told if T_told else T_map_camera, COVARIANCE, self.T_odom)
        return self.check.find(sample, joined, defies_odometry=defies_odometry)


@pytest.mark.parametrize("scale", [1.0, 1.04], ids=["right", "long"])
def test_odometry_within_its_error_raises_no_doubt(scale):
    drive = Drive(0, scale=scale)
    assert all(drive.step().reason is Reason.NONE for _ in range(600))


@pytest.mark.parametrize("late_s", [0.3, -0.3])
def test_a_delay_is_found_from_changes_of_the_motion(late_s):
    drive = Drive(1, late_s)
    findings = [drive.step() for _ in range(400)]
    late = [finding for finding in findings if finding.reason is Reason.ODOM_STALE]
    assert late
    assert np.median([finding.value for finding in late]) == pytest.approx(abs(late_s), abs=0.1)
    assert ("images late" if late_s > 0 else "odometry late") in late[-1].detail


def test_a_place_after_a_loss_must_be_where_odometry_says():
    drive = Drive(2).settle()
    for _ in range(20):
        drive.check.propagate(drive.T_odom, is_trusted=False)
    drive.check.start(OdometrySample(drive.k * STEP_NS, at(drive.k * STEP_NS * 1e-9), COVARIANCE, drive.T_odom))
    assert drive.step(is_trusted=False).reason is Reason.NONE


@pytest.mark.parametrize(("driven", "aside", "is_there"), [(9.0, 0.0, True), (9.0, 3.0, False), (11.0, 0.0, False)])
def test_a_place_is_found_again_where_odometry_says_the_camera_has_gone_while_it_knows(driven, aside, is_there):
    """By 5 % of the way it knows the position to 0.5 m after 10 m; nobody knows a place that was never sure."""
    for is_trusted in (True, False):
        check = OdometryCheck(ERROR)
        check.propagate(SE3.identity(), is_trusted=False)
        check.find(OdometrySample(STEP_NS, SE3.identity(), COVARIANCE, SE3.identity()))
        check.propagate(SE3.identity(), is_trusted=is_trusted)
        T_odom = SE3.from_planar(driven, 0.0, 0.0)
        check.propagate(T_odom, is_trusted=False)
        sample = OdometrySample(2 * STEP_NS, SE3.from_planar(driven, aside, 0.0), COVARIANCE, T_odom)
        assert check.start(sample) == (is_there and is_trusted)


def test_a_place_that_contradicts_odometry_is_doubted_for_a_while_then_believed():
    drive, wrong = Drive(3).settle(), SE3.exp([0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    drive.step()
    findings = [drive.step(is_trusted=False, T_error=wrong) for _ in range(int(DISPUTE_S / 0.05) + 10)]
    assert all(finding.reason is Reason.ODOM_STALE for finding in findings[: int(DISPUTE_S / 0.05)])
    assert findings[-1].reason is Reason.NONE


def test_a_place_that_is_again_where_odometry_says_is_believed_at_once():
    drive, wrong = Drive(4).settle(), SE3.exp([0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    disputed = [drive.step(is_trusted=False, T_error=wrong).reason for _ in range(4)]
    assert disputed == [Reason.ODOM_STALE] * 4
    assert [drive.step(is_trusted=False).reason for _ in range(4)] == [Reason.NONE] * 4


@pytest.mark.parametrize(("sigmas", "is_disputed"), [(5.5, False), (5.7, True)])
def test_what_is_an_innovation_too_far_from_where_odometry_says_is_disputed(sigmas, is_disputed):
    """Both places err by their covariance, a comparison by 5 mm, 2 mrad at least."""
    for axis in [0, 4]:
        check, sigma = OdometryCheck(ERROR), np.sqrt(2 * COVARIANCE[axis, axis] + (0.005, 0.002)[axis // 3] ** 2)
        check.propagate(SE3.identity(), is_trusted=False)
        check.find(OdometrySample(STEP_NS, SE3.identity(), COVARIANCE, SE3.identity()))
        check.propagate(SE3.identity(), is_trusted=True)
        check.propagate(SE3.identity(), is_trusted=False)  # lost
        off = SE3.exp(sigmas * sigma * np.eye(6)[axis])
        check.start(OdometrySample(2 * STEP_NS, off, COVARIANCE, SE3.identity()))
        found = [check.find(OdometrySample(k * STEP_NS, off, COVARIANCE, SE3.identity())) for k in (3, 198, 204)]
        # for 10 s
        assert [finding.reason is Reason.ODOM_STALE for finding in found] == [is_disputed, is_disputed, False]


@pytest.mark.parametrize(("meters", "is_disputed"), [(0.4, True), (0.22, True), (0.1, False)])
@pytest.mark.parametrize("defies_odometry", [False, True])
def test_what_defies_odometry_is_held_to_it_though_the_pose_was_trusted(meters, is_disputed, defies_odometry):
    """Poses by images alone are not sure here, 0.04 m, those joined with odometry are: these must be far apart."""
    drive, off = Drive(5), SE3.exp([0.0, meters, 0.0, 0.0, 0.0, 0.0])
    for _ in range(20):
        drive.step(sigma=20.0)
    found = [drive.step(T_error=off, sigma=20.0, defies_odometry=defies_odometry) for _ in range(3)]
    assert {one.reason is Reason.ODOM_STALE for one in found} == {is_disputed and defies_odometry}
    assert all(one.value > one.limit for one in found if one.reason)


def test_a_dispute_ends_where_the_pose_that_is_told_is_where_odometry_says():
    """An image that is not sure is near to both, and what is told may stay at the disputed place."""
    drive, wrong = Drive(6).settle(), SE3.exp([0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    assert drive.step(T_error=wrong, defies_odometry=True).reason is Reason.ODOM_STALE
    assert drive.step(T_error=SE3.exp([0.0, 0.35, 0.0, 0.0, 0.0, 0.0]), sigma=60.0).reason is Reason.ODOM_STALE
    assert drive.step(T_told=wrong, sigma=60.0).reason is Reason.ODOM_STALE
    assert drive.step(T_error=SE3.exp([0.0, 0.02, 0.0, 0.0, 0.0, 0.0]), sigma=60.0).reason is Reason.NONE
