"""Images that must not be used, each with its reason."""

import numpy as np
import pytest

from sphere_nav.geometry import Pinhole
from sphere_nav.localization import InputCheck, Reason
from sphere_nav.localization.params import InputParams
from sphere_nav.localization.status import Verdict

CAMERA = Pinhole(64, 48, 50.0, 50.0, 31.5, 23.5)
SECOND = 1_000_000_000


@pytest.fixture
def check():
    return InputCheck(InputParams())


def noise(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(20, 230, (48, 64), dtype=np.uint8)


def run(check: InputCheck, stamps: list[int]) -> list[str]:
    return [check.check(noise(k), CAMERA, stamp, is_moving=True).finding.reason for k, stamp in enumerate(stamps)]


def test_a_bad_stamp_is_refused_and_changes_nothing(check):
    for stamp, detail in [(0, "zero"), (10 * SECOND, "repeated"), (9 * SECOND, "backward"), (99 * SECOND, "forward")]:
        check.reset()
        run(check, [10 * SECOND])
        report = check.check(noise(7), CAMERA, stamp, is_moving=True)
        assert report.finding.reason is Reason.BAD_STAMP
        assert detail in report.finding.detail
        assert check.last_stamp_ns == 10 * SECOND
        assert check.check(noise(8), CAMERA, 11 * SECOND, is_moving=True).is_good


def test_stamps_that_agree_on_another_time_are_a_clock_jump_and_it_begins_with_any_camera(check):
    run(check, [100 * SECOND, 101 * SECOND])
    stamps, other = [SECOND, 2 * SECOND, 3 * SECOND, 4 * SECOND], Pinhole(64, 48, 51.0, 50.0, 31.5, 23.5)
    reports = [check.check(noise(k), other, stamp, is_moving=True) for k, stamp in enumerate(stamps)]
    assert [report.finding.reason for report in reports] == ["BAD_STAMP", "BAD_STAMP", "", ""]
    assert [report.is_clock_jump for report in reports] == [False, False, True, False]


def test_two_images_in_the_wrong_order_or_stamps_that_do_not_agree_are_no_clock_jump(check):
    stamps = [1 * SECOND, 3 * SECOND, 2 * SECOND, 4 * SECOND, 6 * SECOND, 5 * SECOND, 7 * SECOND]
    assert run(check, stamps) == ["", "", "BAD_STAMP", "", "", "BAD_STAMP", ""]
    check.reset()
    between = [100 * SECOND, 50 * SECOND, 101 * SECOND, 51 * SECOND, 102 * SECOND, 52 * SECOND]
    assert run(check, between) == ["", "BAD_STAMP"] * 3
    check.reset()
    run(check, [100 * SECOND])
    apart = [50 * SECOND, 50 * SECOND, 50 * SECOND, 70 * SECOND, 30 * SECOND, 31 * SECOND]  # by nothing, or by 20 s
    assert run(check, apart) == ["BAD_STAMP"] * 6
    assert run(check, [32 * SECOND]) == [""]


def test_an_image_of_another_size_than_its_info_is_named_and_an_info_that_changes_refused(check):
    report = check.check(noise()[:, :60], CAMERA, SECOND, is_moving=True)
    assert report.finding.reason is Reason.BAD_INFO
    assert (report.finding.value, report.finding.limit) == (60, 64)
    assert "60 x 48" in report.finding.detail
    assert "64 x 48" in report.finding.detail
    check.reset()
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


def test_a_frozen_camera_is_found_after_three_repeats_and_standing_still_may_be_allowed(check):
    reasons = [check.check(noise(), CAMERA, (k + 1) * SECOND, is_moving=True).finding.reason for k in range(5)]
    assert reasons == ["", "", "", "FROZEN", "FROZEN"]
    assert check.check(noise(1), CAMERA, 6 * SECOND, is_moving=True).is_good
    check = InputCheck(InputParams(allow_still=True))
    reasons = [check.check(noise(), CAMERA, (k + 1) * SECOND, is_moving=False).finding.reason for k in range(6)]
    assert reasons == [""] * 6
    assert check.check(noise(), CAMERA, 7 * SECOND, is_moving=True).finding.reason is Reason.FROZEN


@pytest.mark.parametrize("at", [(4, 4), (44, 60)])
def test_a_change_of_four_pixels_each_way_is_no_frozen_image(check, at):
    image = noise()
    for k in range(6):
        image[at[0] : at[0] + 4, at[1] : at[1] + 4] = 20 + k
        assert check.check(image.copy(), CAMERA, (k + 1) * SECOND, is_moving=True).is_good


DARK = [(6, 200, 0.95, "black"), (7, 200, 0.95, ""), (6, 200, 0.90, "")]
BRIGHT = [(250, 40, 0.95, "saturated"), (249, 40, 0.95, "")]


@pytest.mark.parametrize(("level", "rest", "share", "word"), [*DARK, *BRIGHT])
def test_what_is_clipped_counts_from_its_level_on_and_beyond_its_share(check, level, rest, share, word):
    image = np.full((80, 64), rest, np.float32)  # so far from the level that contrast is not missing
    image[: round(80 * share)] = level
    finding = check.check(image, Pinhole(64, 80, 50.0, 50.0, 31.5, 39.5), SECOND).finding
    assert finding.detail == (f"image is {word}" if word else "")
    if word:
        assert (finding.value, finding.limit) == (0.95, 0.9)


def test_contrast_is_the_standard_deviation():
    for spread, is_good in [(2, False), (3, True), (4, True)]:
        image = np.full((48, 64), 100 - spread, np.uint8)
        image[:24] = 100 + spread
        finding = InputCheck(InputParams()).check(image, CAMERA, SECOND).finding
        assert (finding.reason is Reason.NONE) == is_good
        assert is_good or (finding.value, finding.limit) == (pytest.approx(spread), 3.0)


@pytest.mark.parametrize(
    ("step_s", "value", "limit", "detail"),
    [
        (10.0, 0.0, 0.0, ""),
        (10.001, 10.001, 10.0, "stamp leaps forward by 10.001 s"),
        (-0.25, -0.25, 0.0, "stamp backward by 0.250 s"),
        (-103.0, -3.0, 0.0, "stamp is zero or negative"),
    ],
)
def test_a_step_of_the_stamps_is_said_with_its_sign_and_limit(check, step_s, value, limit, detail):
    assert check.check_stamp(100 * SECOND).is_good
    finding = check.check_stamp(100 * SECOND + round(step_s * SECOND)).finding
    assert (finding.value, finding.limit, finding.detail) == (pytest.approx(value), limit, detail)
    assert finding.reason is (Reason.BAD_STAMP if detail else Reason.NONE)


def test_silence_is_told_with_the_present_stamp_after_its_time(check):
    assert check.find_silence(9.0) is None  # nothing came yet
    run(check, [7 * SECOND])
    assert check.find_silence(0.5) is None
    stamp_ns, finding = check.find_silence(0.75)
    assert (stamp_ns, finding.reason, finding.value, finding.limit) == (7_750_000_000, Reason.TIMEOUT, 0.75, 0.5)
    dark = Verdict(Reason.LOW_TEXTURE, 0.95, 0.9)
    assert check.find_silence(0.75, dark) == (7_750_000_000, dark)  # images came, that is why none was used
