"""Words for what is seen often: a descriptor unlike all words so far becomes a new one (M15 section 3.5.2).

The dictionary is built while driving, from nothing; it needs no training and the same drive gives the same words.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry.arrays import Floats, Integers
from sphere_nav.spheres.constants import MAX_WORDS, MIN_WORD_COSINE


class Dictionary:
    """Words (W, 128), unit vectors, in the order in which they were seen first."""

    def __init__(self) -> None:
        self._words = np.empty((256, 128), np.float32)
        self._number = 0

    def __len__(self) -> int:
        return self._number

    @property
    def words(self) -> Floats:
        """The words (W, 128)."""
        return self._words[: self._number]

    def read(self, descriptors: Floats) -> Integers:
        """Return the word (N,) most like each unit descriptor (N, 128), -1 where none is like it."""
        if not self._number or not len(descriptors):
            return np.full(len(descriptors), -1, np.int64)
        cosines = descriptors @ self.words.T
        word = np.argmax(cosines, axis=1)
        is_like = (cosines[np.arange(len(word)), word] >= MIN_WORD_COSINE) | (self._number >= MAX_WORDS)
        return np.where(is_like, word, -1)

    def learn(self, descriptors: Floats) -> Integers:
        """Return the word (N,) of each unit descriptor (N, 128); what is like none becomes one."""
        words = self.read(descriptors)
        unlike = np.flatnonzero(words < 0)
        own = descriptors[unlike]
        alike = own @ own.T >= MIN_WORD_COSINE
        fresh: list[int] = []  # rows of `own` that became words
        for row in range(len(own)):
            known = np.flatnonzero(alike[row, fresh])
            if known.size:
                words[unlike[row]] = words[unlike[fresh[known[0]]]]
            elif self._number < MAX_WORDS:
                words[unlike[row]] = self._append(own[row])
                fresh.append(row)
        late = np.flatnonzero(words < 0)  # after the last word
        if late.size:
            words[late] = self.read(descriptors[late])
        return words

    def restore(self, descriptors: Floats, words: NDArray[np.integer]) -> None:
        """Take the words that `learn` gave to these unit descriptors (N, 128) before; ValueError for a gap."""
        unknown, first = np.unique(words, return_index=True)
        for word, row in zip(unknown.tolist(), first.tolist(), strict=True):
            if word >= self._number:
                if word != self._number or self._number >= MAX_WORDS:
                    raise ValueError(f"words: expected the next to be {self._number} of {MAX_WORDS}, found {word}")
                self._append(descriptors[row])

    def _append(self, word: Floats) -> int:
        if self._number == len(self._words):
            self._words = np.concatenate([self._words, np.empty_like(self._words)])
        self._words[self._number] = word
        self._number += 1
        return self._number - 1
