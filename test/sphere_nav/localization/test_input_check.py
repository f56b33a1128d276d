"""Images that must not be used, each with its reason."""

import numpy as np
import pytest

from sphere_nav.geometry import Pinhole
from sphere_nav.localization import InputCheck, Reason
from sphere_nav.localization.params import InputParams

CAMERA = Pinhole(64, 48, 50.0, 50.0, 31.5, 23.5)
SECOND = 1_000_000_000


@pytest.fixture
def check():
    return InputCheck(InputParams())


def noise(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(20, 230, (48, 64), dtype=np.uint8)


def run(check: InputCheck, stamps: list[int]) -> list[str]:
    return [check.check(noise(k), CAMERA, stamp, is_moving=True).finding.reason for k, stamp in enumerate(stamps)]


def test_a_plain_stream_is_good(check):
    assert run(check, [SECOND, 2 * SECOND, 3 * SECOND]) == ["", "", ""]


@pytest.mark.parametrize(
    ("stamp", "detail"),
    [(0, "zero"), (-5, "negative"), (10 * SECOND, "repeated"), (9 * SECOND, "backward"), (99 * SECOND, "forward")],
)
def test_a_bad_stamp_is_refused_and_changes_nothing(check, stamp, detail):
    run(check, [10 * SECOND])
    report = check.check(noise(7), CAMERA, stamp, is_moving=True)
    assert report.finding.reason is Reason.BAD_STAMP
    assert detail in report.finding.detail
    assert check.last_stamp_ns == 10 * SECOND
    assert check.check(noise(8), CAMERA, 11 * SECOND, is_moving=True).is_good


def test_stamps_that_agree_on_another_time_are_a_clock_jump(check):
    run(check, [100 * SECOND, 101 * SECOND])
    stamps = [SECOND, 2 * SECOND, 3 * SECOND, 4 * SECOND]
    reports = [check.check(noise(k), CAMERA, stamp, is_moving=True) for k, stamp in enumerate(stamps)]
    assert [report.finding.reason for report in reports] == ["BAD_STAMP", "BAD_STAMP", "", ""]
    assert [report.is_clock_jump for report in reports] == [False, False, True, False]


def test_two_images_in_the_wrong_order_are_no_clock_jump(check):
    stamps = [1 * SECOND, 3 * SECOND, 2 * SECOND, 4 * SECOND, 6 * SECOND, 5 * SECOND, 7 * SECOND]
    assert run(check, stamps) == ["", "", "BAD_STAMP", "", "", "BAD_STAMP", ""]


def test_an_image_of_another_size_than_its_info_is_named(check):
    report = check.check(noise()[:, :60], CAMERA, SECOND, is_moving=True)
    assert report.finding.reason is Reason.BAD_INFO
    assert (report.finding.value, report.finding.limit) == (60, 64)
    assert "60 x 48" in report.finding.detail
    assert "64 x 48" in report.finding.detail


def test_a_camera_info_that_changes_is_refused(check):
    run(check, [SECOND])
    other = Pinhole(64, 48, 51.0, 50.0, 31.5, 23.5)
    assert check.check(noise(1), other, 2 * SECOND, is_moving=True).finding.reason is Reason.BAD_INFO
    check.reset()
    assert check.check(noise(1), other, 3 * SECOND, is_moving=True).is_good


def test_pixels_that_are_no_numbers_are_counted(check):
    image = noise().astype(np.float32)
    image[3, 5] = image[7, 1] = np.nan
    finding = check.check(image, CAMERA, SECOND, is_moving=True).finding
    assert (finding.reason, finding.value) == (Reason.LOW_TEXTURE, 2)


@pytest.mark.parametrize(("level", "word"), [(0, "black"), (255, "saturated"), (128, "contrast")])
def test_black_white_and_grey_images_have_no_texture(check, level, word):
    finding = check.check(np.full((48, 64), level, np.uint8), CAMERA, SECOND, is_moving=True).finding
    assert finding.reason is Reason.LOW_TEXTURE
    assert word in finding.detail


def test_a_frozen_camera_is_found_after_three_repeats(check):
    reasons = [check.check(noise(), CAMERA, (k + 1) * SECOND, is_moving=True).finding.reason for k in range(5)]
    assert reasons == ["", "", "", "FROZEN", "FROZEN"]
    assert check.check(noise(1), CAMERA, 6 * SECOND, is_moving=True).is_good


def test_standing_still_without_noise_may_be_allowed_but_not_while_moving():
    check = InputCheck(InputParams(allow_still=True))
    reasons = [check.check(noise(), CAMERA, (k + 1) * SECOND, is_moving=False).finding.reason for k in range(6)]
    assert reasons == [""] * 6
    assert check.check(noise(), CAMERA, 7 * SECOND, is_moving=True).finding.reason is Reason.FROZEN


def test_the_stamps_of_a_slow_camera_need_not_be_leaps():
    check = InputCheck(InputParams(max_leap_s=100.0))
    assert run(check, [SECOND, 60 * SECOND]) == ["", ""]
