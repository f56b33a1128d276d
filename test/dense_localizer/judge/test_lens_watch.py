"""A wrong lens is told from a wrong map; what is before the lens moves with the vehicle, and is left out."""

from __future__ import annotations

import numpy as np
import pytest

from dense_localizer.judge.candidate import PoseCandidate, refuse
from dense_localizer.judge.integrity import Integrity, align_rig
from dense_localizer.judge.lens_watch import LensWatch, ViewMask
from dense_localizer.judge.residual import residual_image
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, References
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason, State
from sphere_nav.params import build
from sphere_nav.photometric import Alignment, RegistrationParams, build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.lens import Stretch
from worlds.localizer import PINHOLE, SMALL_IMAGES, Run, at, error, make_localizer

ALONG = np.array([0.0, 0.0, 7.0, 0.0, 0.1, 0.0])  # m, rad by a share


def told(*shares, sigma=0.003, camera=""):
    """A watch that key spheres have told shares."""
    watch = LensWatch()
    for number, share in enumerate(shares):
        watch.add([Stretch(camera, share, sigma, ALONG)], number)
    return watch


@pytest.mark.parametrize(
    ("shares", "is_wrong"),
    [
        ([0.004], False),
        ([-0.02], False),  # one key sphere may be wrong by as much
        ([-0.06], True),
        ([0.02, 0.021, 0.019], True),
        ([0.02, -0.02, 0.06], False),  # they do not agree
        ([0.009] * 64, False),  # however sure it is
        ([0.012] * 64, True),
    ],
)
def test_a_lens_is_wrong_beyond_one_per_cent_and_four_deviations_of_what_key_spheres_tell(shares, is_wrong):
    assert (told(*shares).finding.reason is Reason.BAD_INFO) == is_wrong


def test_many_images_near_one_key_sphere_are_no_surer_than_it_is():
    watch = LensWatch()
    for _ in range(100):
        watch.add([Stretch("", 0.018, 0.003, ALONG)], 1)
    assert watch.finding is FINE


@pytest.mark.parametrize(("share", "word"), [(0.05, "longer"), (-0.05, "shorter")])
def test_the_value_is_told_with_the_camera_and_what_to_do(share, word):
    finding = told(*[share] * 4, camera="left").finding
    assert finding.value == pytest.approx(0.05)
    assert finding.detail == f"the lens of camera left is 5.0 ± 0.3 % {word} than camera_info says"
    assert "calibrate" in finding.advice


def test_a_pose_is_as_uncertain_as_its_lens_makes_it():
    assert not told(0.001).covariance.any()  # within what one key sphere may be wrong by
    covariance = told(*[0.02] * 16).covariance
    assert np.sqrt(np.diagonal(covariance)) == pytest.approx(0.02 * ALONG, rel=0.01)


def test_what_was_told_long_ago_is_forgotten():
    watch = told(*[0.02] * 20)
    for number in range(100, 164):
        watch.add([Stretch("", 0.0, 0.003, ALONG)], number)
    assert watch.finding is FINE
    assert not watch.covariance.any()


@pytest.fixture
def asked(monkeypatch):
    """The images that are asked, and whether as clear ones; each tells 5 %."""
    images = []

    def find(images_of, *_, far, is_clear):
        images.append((images_of, is_clear))
        return [Stretch("", 0.05, 0.003, ALONG)], {}

    monkeypatch.setattr("dense_localizer.judge.lens_watch.find_stretches", find)
    return images


def candidate(number, *, is_biased=False, is_by_range=False):
    choice = Choice((number,), (), 1.0, 0.0, 5.0, 1.0)
    alignment = Alignment(SE3.identity(), np.eye(6), "", 1, 1000, 1.0, 1.0, 1.0, 0.9, (1.0,), (0.0,))
    given = Prediction.guess(SE3.identity()), choice, refuse(FINE), alignment, None, (number,)
    return PoseCandidate(SE3.identity(), np.eye(6), *given, is_biased=is_biased, is_by_range=is_by_range)


@pytest.mark.parametrize(("state", "numbers"), [(State.TRACKING, [0, 10, 20]), (State.PROBATION, [0, 10, 20])])
def test_one_of_ten_images_is_asked(asked, state, numbers):
    watch = LensWatch()
    for number in range(21):
        watch.observe(candidate(number), RegistrationParams(), state)
    assert [images[0] for images, _ in asked] == numbers
    assert watch.finding.reason is Reason.BAD_INFO


def test_each_image_of_a_pose_on_probation_is_asked_while_no_lens_is_wrong(asked, monkeypatch):
    monkeypatch.setattr("dense_localizer.judge.lens_watch.MAX_SHARE", 1.0)
    watch = LensWatch()
    for number in range(3):
        watch.observe(candidate(number, is_biased=number == 1), RegistrationParams(), State.PROBATION)
    assert [is_clear for _, is_clear in asked] == [True, False, True]
    watch.observe(candidate(4, is_by_range=True), RegistrationParams(), State.PROBATION)
    assert len(asked) == 3


def test_lenses_that_are_far_longer_and_far_shorter_are_tried_in_turn(monkeypatch):
    tried, watch = [], LensWatch()

    def find(*_, far, is_clear):
        tried.append(far)
        return [], {}

    monkeypatch.setattr("dense_localizer.judge.lens_watch.find_stretches", find)
    for number in range(41):
        watch.observe(candidate(number), RegistrationParams(), State.TRACKING)
    assert tried == [-8, 8, -8, 8, -8]


def test_of_a_lens_that_is_far_off_the_next_image_goes_on_from_what_was_thought(monkeypatch):
    answers = [([], {"": -5}), ([], {"": -10}), ([Stretch("", -0.2, 0.003, ALONG)], {"": -10}), ([], {})]
    thought, watch = [], LensWatch()

    def find(*given, far, is_clear):
        thought.append(dict(given[-1]))
        return answers[len(thought) - 1]

    monkeypatch.setattr("dense_localizer.judge.lens_watch.find_stretches", find)
    for number in range(13):
        watch.observe(candidate(number), RegistrationParams(), State.TRACKING)
        assert len(thought) == min(number + 1, 3) + (number >= 12)
    assert thought == [{}, {"": -5}, {"": -10}, {"": -10}]
    watch.reset()
    assert not watch._longer


def test_each_camera_is_judged_by_itself():
    watch = LensWatch()
    for number in range(4):
        watch.add([Stretch("a", 0.03, 0.003, ALONG), Stretch("b", -0.03, 0.003, ALONG[::-1])], number)
    assert "camera a is" in watch.finding.detail
    assert np.linalg.matrix_rank(watch.covariance) == 2
    for number in range(100, 164):
        watch.add([Stretch("a", 0.0, 0.003, ALONG)], number)
    assert "camera b is" in watch.finding.detail


@pytest.mark.parametrize(
    ("columns", "share", "is_named"), [(768, 0.017, False), (768, 0.019, True), (2048, 0.0105, True)]
)
def test_a_coarse_map_says_less_of_a_lens(columns, share, is_named):
    """An ideal lens was 1.2 % long in a map of 768 columns."""
    watch = LensWatch(columns / (2.0 * np.pi))
    for number in range(50):
        watch.add([Stretch("", share, 0.0001, ALONG)], number)
    assert (watch.finding.reason is Reason.BAD_INFO) == is_named


PARAMS = build(LocalizerParams, SMALL_IMAGES)
TOP = 90  # row of the image at which the bonnet begins: a quarter of the view, three rows of cells
PATTERN = np.kron(np.random.default_rng(7).integers(20, 230, (6, 32)), np.ones((5, 5))).astype(np.uint8)


def with_bonnet(image, pattern=PATTERN):
    return np.concatenate([image[:TOP], pattern])


def clean(image):
    return image


class Drive:
    """Images of a drive at their places, of which a mask is asked."""

    def __init__(self, room, room_map) -> None:
        self.room, self.mask = room, ViewMask(PARAMS.registration)
        self.references = References(room_map, PARAMS)
        self.integrity = Integrity(self.references, PARAMS)

    def see(self, poses, edit=with_bonnet):
        """Locate an image at each pose; return the cells of the last that are left out."""
        for number, pose in enumerate(poses):
            image, guess = edit(self.room.photograph(PINHOLE, pose, number)), Prediction.guess(pose)
            images = [RigImage(build_pyramid(image, PINHOLE, PARAMS.registration.pyramid))]
            chosen = self.mask.hide(self.references.choose_rig(images, guess))
            self.candidate = self.integrity.assess(chosen, align_rig(chosen, guess, PARAMS), guess)
            self.mask.observe(self.candidate)
        return self.mask.hidden("")


@pytest.fixture
def seen(room, room_map):
    one = Drive(room, room_map)
    yield one
    one.references.close()


def along(number, first=0):
    """Return places 0.3 m apart: a tenth of what is seen."""
    return [at(-1.5 + 0.3 * (first + k)) for k in range(number)]


def test_the_own_bonnet_is_left_out_after_five_places_and_seen_again_when_it_is_gone(seen):
    assert not seen.see(along(4)).any()
    hidden = seen.see(along(2, 4))
    assert hidden[9:].mean() > 0.8
    assert hidden[:9].mean() < 0.03
    seen.see(along(1, 6))
    picture = residual_image(np.zeros((120, 160), np.uint8), PINHOLE, seen.candidate)
    assert np.all(picture[np.kron(hidden, np.ones((10, 10), bool))] == 0)
    assert seen.see(along(4, 7), clean).mean() < 0.02


def test_a_cell_that_agrees_by_chance_amidst_hidden_ones_is_hidden():
    mask = ViewMask(PARAMS.registration)
    mask._log_odds[""] = np.full((12, 16), 6.0)
    mask._log_odds[""][9:, 3:] = -12.0
    mask._log_odds[""][11, 7] = mask._log_odds[""][10, 9] = 0.0
    assert np.array_equal(np.argwhere(mask.hidden("")).min(axis=0), [9, 3])
    assert mask.hidden("").sum() == 3 * 13


@pytest.mark.slow
def test_a_vehicle_that_stands_learns_nothing_and_a_clean_view_loses_nothing(seen):
    assert not seen.see([at(0.0)] * 6).any()
    assert seen.see(along(6), clean).mean() < 0.02


@pytest.mark.slow
def test_changed_scenery_that_passes_by_is_not_the_lens(seen, rng):
    assert seen.see(along(6), lambda image: with_bonnet(image, rng.permuted(PATTERN, axis=1)))[9:].mean() < 0.05


@pytest.mark.slow
def test_the_localizer_aligns_without_the_bonnet_once_it_is_known(room, room_map):
    run = Run(room, make_localizer(room_map))
    found = [run.see(at(-1.6 + 0.1 * k), with_bonnet) for k in range(21)][-1]
    unknown = np.isnan(found.candidate.images[0].pyramid.images[0])
    assert unknown[TOP:].mean() > 0.7
    assert unknown[: TOP - 5].mean() < 0.05  # half a cell around
    assert error(found, at(0.4))[0] < 0.03
