import numpy as np
import pytest

from sphere_nav.spheres.appearance.dictionary import Dictionary

# Written out: imported, a change would go unseen.
MIN_COSINE = 0.86


def random_units(rng, number):
    values = rng.normal(size=(number, 128)).astype(np.float32)
    return values / np.linalg.norm(values, axis=1, keepdims=True)


def near(rng, units, spread):
    values = units + spread * random_units(rng, len(units))
    return (values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float32)


def test_what_is_unlike_becomes_a_word_and_what_is_like_takes_it(rng):
    words, book = random_units(rng, 40), Dictionary()
    np.testing.assert_array_equal(book.learn(words), np.arange(40))
    np.testing.assert_array_equal(book.learn(near(rng, words, 0.2)), np.arange(40))
    assert len(book) == 40
    assert np.all(book.read(random_units(rng, 10)) == -1)  # reading adds nothing


def test_the_same_word_twice_in_one_image_is_one_word(rng):
    words = random_units(rng, 3)
    found = Dictionary().learn(np.concatenate([words, near(rng, words, 0.1)]))
    np.testing.assert_array_equal(found, [0, 1, 2, 0, 1, 2])


def test_words_are_restored_from_what_was_stored(rng):
    first, second = random_units(rng, 30), random_units(rng, 30)
    book, again = Dictionary(), Dictionary()
    for descriptors in (first, second):
        again.restore(descriptors, book.learn(descriptors))
    np.testing.assert_array_equal(again.words, book.words)
    with pytest.raises(ValueError, match="expected the next to be 60"):
        again.restore(first, np.full(30, 99))


def test_words_are_apart(rng):
    book = Dictionary()
    for _ in range(5):
        book.learn(near(rng, random_units(rng, 20), 0.5))
    cosines = book.words @ book.words.T - 2 * np.eye(len(book))
    assert cosines.max() < MIN_COSINE
