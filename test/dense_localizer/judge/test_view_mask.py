"""What is before the lens moves with the vehicle, and is left out; the world is not."""

import numpy as np
import pytest

from dense_localizer.judge.integrity import Integrity
from dense_localizer.judge.residual import residual_image
from dense_localizer.judge.view_mask import ViewMask
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.track.candidates import align_rig
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, Run, at, error, make_localizer

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
