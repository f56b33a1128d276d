"""Images that must not be compared, each with its reason."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import mcl_depth
from localization.status import Reason
from mcl_depth.input_check import InputCheck
from mcl_depth.params import InputParams
from mcl_depth.reasons import FINE, REMEDIES, Finding
from sphere_geometry import Spherical

CAMERA = Spherical(64, 32)
SECOND = 10**9


def picture(number=0):
    return np.random.default_rng(number).integers(0, 255, (32, 64)).astype(np.uint8)


def test_good_images_are_fine():
    check = InputCheck(InputParams())
    assert [check.check(picture(k), CAMERA, k * SECOND) for k in (1, 2, 3)] == [FINE] * 3


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.zeros((32, 64), np.uint8), Reason.LOW_TEXTURE),
        (np.full((32, 64), np.nan, np.float32), Reason.LOW_TEXTURE),
        (picture()[:16], Reason.BAD_INFO),
    ],
)
def test_images_without_content_or_of_another_size_are_refused(image, reason):
    assert InputCheck(InputParams()).check(image, CAMERA, SECOND).reason is reason


def test_stamps_must_be_set_and_grow():
    check = InputCheck(InputParams())
    found = [check.check_stamp(stamp).reason for stamp in (0, 5 * SECOND, 5 * SECOND, 4 * SECOND, 6 * SECOND)]
    assert found == [Reason.BAD_STAMP, Reason.NONE, Reason.BAD_STAMP, Reason.BAD_STAMP, Reason.NONE]


def test_several_images_that_agree_make_a_new_time():
    check = InputCheck(InputParams(clock_jump_images=3))
    check.check_stamp(100 * SECOND)
    found = []
    for second in (1, 2, 3):
        found.append((check.check_stamp(second * SECOND).reason, check.is_new_time))
    assert found == [(Reason.BAD_STAMP, False), (Reason.BAD_STAMP, False), (Reason.NONE, True)]


def test_a_camera_that_repeats_itself_is_frozen_unless_it_may():
    for allow_still, expected in ((False, Reason.FROZEN), (True, Reason.NONE)):
        check = InputCheck(InputParams(frozen_images=3, allow_still=allow_still))
        found = [check.check(picture(), CAMERA, k * SECOND).reason for k in range(1, 5)]
        assert found == [Reason.NONE] * 3 + [expected]


def test_every_reason_given_has_its_remedy_led_by_the_detail():
    sources = "".join(
        path.read_text() for path in Path(mcl_depth.__file__).parent.glob("*.py") if path.stem != "reasons"
    )
    used = {Reason[name] for name in re.findall(r"Reason\.([A-Z_]+)", sources)}
    assert used <= set(REMEDIES)
    assert Reason.AMBIGUOUS in used
    assert Finding(Reason.FROZEN, detail="eye shut").remedy.startswith("eye shut; the camera repeats")
