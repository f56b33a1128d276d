import numpy as np
import pytest

from dense_localizer.judge.acceptance import Acceptance
from dense_localizer.judge.lens_watch import LensWatch
from sphere_nav.localization.status import FINE, Finding, Reason
from sphere_nav.photometric.checks.lens import LensError

SURE = np.diag([0.0005, 0.001]) ** 2
ALONG = np.zeros((6, 2))
ALONG[2] = 7.0, 2.0  # m by a share


def error(s, k=0.0, covariance=SURE, name=""):
    return LensError(np.array([s, k]), covariance, ALONG, name)


@pytest.mark.parametrize(("share", "reason"), [(0.002, ""), (-0.008, ""), (0.02, "LENS"), (-0.05, "LENS")])
def test_a_lens_that_is_one_per_cent_off_is_named_with_the_value(share, reason):
    verdict = LensWatch().judge([error(share)], 1)
    assert verdict.finding.reason == reason
    if reason:
        assert verdict.finding.value == pytest.approx(share)
        assert ("larger" if share > 0 else "smaller") in verdict.finding.detail


def test_what_one_direction_leaves_open_is_no_wrong_lens():
    assert not LensWatch().judge([error(0.005, 0.05, np.diag([0.0005, 0.03]) ** 2)], 1).finding.reason


def test_another_distortion_is_named_too():
    assert LensWatch().judge([error(0.0, 0.05)], 1).finding.reason is Reason.LENS


def test_the_pose_is_uncertain_by_what_the_lens_may_be():
    sigma = {share: np.sqrt(LensWatch().judge([error(share)], 1).covariance[2, 2]) for share in (0.0, 0.02)}
    assert 0.004 < sigma[0.0] < 0.02
    assert sigma[0.02] == pytest.approx(0.14, rel=0.05)
    blind = LensWatch().judge([error(0.0, covariance=np.diag([0.1, 0.1]))], 1)
    assert np.sqrt(blind.covariance[2, 2]) == pytest.approx(np.hypot(7.0 * 0.002, 2.0 * 0.006), rel=0.02)
    assert not LensWatch().judge([], 1).covariance.any()


def test_key_spheres_tell_more_than_many_images_near_one():
    watch, near = LensWatch(), LensWatch()
    for number in range(6):
        watch.add([error(0.001)], number)
        near.add([error(0.001)], 1)
    assert watch.judge([], 0).covariance[2, 2] < 0.6 * near.judge([], 0).covariance[2, 2]


def test_key_spheres_that_disagree_are_less_sure():
    alike, apart = LensWatch(), LensWatch()
    for number in range(6):
        alike.add([error(0.0)], number)
        apart.add([error(0.004 * (-1) ** number)], number)
    assert apart.judge([], 0).covariance[2, 2] > 2.0 * alike.judge([], 0).covariance[2, 2]


def test_another_lens_is_noticed_at_once_and_forgotten_by_a_reset():
    watch = LensWatch()
    for number in range(8):
        watch.add([error(0.0005)], number)
    assert watch.judge([error(0.03)], 9).finding.reason is Reason.LENS
    watch.add([error(0.03)], 9)
    assert watch.judge([], 9).finding.reason is Reason.LENS
    watch.reset()
    assert watch.judge([], 9).finding is FINE


def test_each_camera_is_judged_by_itself():
    finding = LensWatch().judge([error(0.0, name="left"), error(0.03, name="right")], 1).finding
    assert finding.detail.startswith("camera right:")


def test_a_wrong_lens_asks_for_care_and_is_the_reason():
    good, refused = Acceptance(True, True, FINE, 0.9), Acceptance(False, False, Finding(Reason.LOW_TEXTURE), 0.0)
    verdict = LensWatch().judge([error(0.02)], 1)
    for acceptance in (good, refused):
        qualified = verdict.qualify(acceptance)
        assert (qualified.is_accepted, qualified.is_good) == (acceptance.is_accepted, False)
        assert qualified.finding.reason is Reason.LENS
    assert LensWatch().judge([error(0.0)], 1).qualify(good) is good
