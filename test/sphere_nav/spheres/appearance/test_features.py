import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.appearance.dictionary import Dictionary
from sphere_nav.spheres.appearance.features import features_of_image, features_of_sphere
from sphere_nav.spheres.sphere import Sphere
from worlds.room import optical, sharp_room

ROOM = sharp_room()
CAMERA = Spherical(512, 256)
AT = SE3.exp([0.5, -0.4, 0.1, 0.0, 0.0, 0.3])


def matched(a, b):
    """Rows of `b` whose descriptor is the very best for each of `a`, where it is nearly the same."""
    cosines = a.unit_descriptors() @ b.unit_descriptors().T
    best = np.argmax(cosines, axis=1)
    return np.flatnonzero(cosines[np.arange(len(a)), best] > 0.95), best


def noise_of(seed):
    """Return an image (256, 512) with features everywhere."""
    noise = np.random.default_rng(seed).normal(size=(256, 512)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(128 + 50 * blurred / blurred.std(), 1, 255).astype(np.uint8)


def test_points_lie_on_the_walls():
    found = features_of_sphere(ROOM.sphere(AT, CAMERA))
    points = AT.apply(found.points.astype(np.float64))
    off = np.min(np.abs(np.abs(points) - ROOM.half), axis=1)
    assert len(found) > 100
    assert np.median(off) < 0.02  # a pixel is 12 mrad wide


def test_no_feature_is_lost_at_the_seam():
    image = ROOM.sphere(AT, CAMERA).image
    plain, turned = features_of_image(image, CAMERA), features_of_image(np.roll(image, 256, axis=1), CAMERA)
    rows, best = matched(plain, turned)
    assert len(rows) > 0.9 * len(plain)
    half_turn = np.array([-1.0, -1.0, 1.0])
    at_seam = rows[plain.rays[rows, 0] < -0.95]
    assert len(at_seam) > 0
    np.testing.assert_allclose(turned.rays[best[at_seam]], plain.rays[at_seam] * half_turn, atol=0.03)


def test_an_image_of_a_camera_shows_the_same_features():
    lens = Pinhole(400, 300, 250.0, 250.0, 199.5, 149.5)
    sphere = features_of_sphere(ROOM.sphere(AT, CAMERA))
    image = features_of_image(ROOM.photograph(lens, optical(AT)), lens)
    rows, best = matched(image, sphere)
    from_optical = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    angle = np.arccos(np.clip(np.sum(image.rays[rows] @ from_optical.T * sphere.rays[best[rows]], axis=1), -1, 1))
    assert len(rows) >= 10
    assert np.mean(angle < 0.03) > 0.8


def test_features_lie_in_every_column_of_a_sphere_once():
    found = features_of_image(noise_of(1), CAMERA, max_features=10**5)
    pixels, _ = CAMERA.project(found.rays.astype(np.float64))
    columns = np.rint(pixels[:, 0]).astype(int) % 512
    per_column = np.bincount(columns, minlength=512)
    assert per_column[[0, 511]].min() >= 1
    assert per_column[:8].sum() + per_column[-8:].sum() < 2.0 * 16 * per_column.mean()  # the pad counts none twice


def test_what_no_camera_saw_has_no_features_and_a_blank_image_none():
    whole = ROOM.sphere(AT, CAMERA)
    hidden = np.where(np.arange(512)[None, :] < 256, 0, whole.image).astype(np.uint8)
    range_m = np.where(np.arange(512)[None, :] < 256, np.nan, whole.range_m).astype(np.float32)
    found = features_of_sphere(Sphere(hidden, range_m, CAMERA))
    assert len(found) > 50
    assert np.all(found.rays[:, 1] < 0.05)  # the right half looks to the right
    assert len(features_of_image(np.full((256, 512), 90, np.uint8), CAMERA)) == 0


@pytest.mark.slow
def test_the_strongest_features_are_kept_and_none_at_the_poles():
    noisy = noise_of(0)
    found = features_of_image(noisy, CAMERA)
    assert len(found) == 500
    elevation = np.degrees(np.arcsin(found.rays[:, 2]))
    assert 57.0 < np.abs(elevation).max() < 60.0
    few = features_of_image(noisy, CAMERA, max_features=20)
    np.testing.assert_array_equal(few.descriptors, found.descriptors[:20])


MIN_COSINE = 0.86  # written out: imported, a change would go unseen


def random_units(rng, number):
    values = rng.normal(size=(number, 128)).astype(np.float32)
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def near(rng, units, spread):
    values = units + spread * random_units(rng, len(units))
    return (values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float32)


def test_what_is_unlike_becomes_a_word_and_what_is_like_takes_it_also_in_one_image(rng):
    words, book = random_units(rng, 40), Dictionary()
    np.testing.assert_array_equal(book.learn(words), np.arange(40))
    np.testing.assert_array_equal(book.learn(near(rng, words, 0.2)), np.arange(40))
    assert len(book) == 40
    assert np.all(book.read(random_units(rng, 10)) == -1)  # reading adds nothing
    words = random_units(rng, 3)
    found = Dictionary().learn(np.concatenate([words, near(rng, words, 0.1)]))
    np.testing.assert_array_equal(found, [0, 1, 2, 0, 1, 2])


def test_words_are_apart_and_restored_from_what_was_stored(rng):
    first, second = random_units(rng, 30), random_units(rng, 30)
    book, again = Dictionary(), Dictionary()
    for descriptors in (first, second):
        again.restore(descriptors, book.learn(descriptors))
    np.testing.assert_array_equal(again.words, book.words)
    with pytest.raises(ValueError, match="expected the next to be 60"):
        again.restore(first, np.full(30, 99))
    book = Dictionary()
    for _ in range(5):
        book.learn(near(rng, random_units(rng, 20), 0.5))
    cosines = book.words @ book.words.T - 2 * np.eye(len(book))
    assert cosines.max() < MIN_COSINE
