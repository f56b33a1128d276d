"""The inner loops of the joint evidence: fields (A, X, Y) f4 by heading and cell. Plain arrays in and out."""

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit


@njit(**OPTIONS)
def shift_headings(field, shifts, turn, outside, out):
    """Write field[a, x, y] to out[a + turn, x + shifts[a, 0], y + shifts[a, 1]]; `outside` where nothing comes from."""
    A, X, Y = field.shape
    for a in range(A):
        target = (a + turn) % A
        dx, dy = shifts[a, 0], shifts[a, 1]
        for x in range(X):
            source = x - dx
            if source < 0 or source >= X:
                out[target, x, :] = outside
                continue
            for y in range(Y):
                out[target, x, y] = field[a, source, y - dy] if 0 <= y - dy < Y else outside


@njit(**OPTIONS)
def is_maximum(field, mask, reach_headings, reach):
    """Return which elements (A, X, Y) of cells in mask (X, Y) exceed all others of the mask within reach, as bool."""
    A, X, Y = field.shape
    out = np.zeros((A, X, Y), np.bool_)
    for a in range(A):
        for x in range(X):
            for y in range(Y):
                if mask[x, y]:
                    out[a, x, y] = _exceeds(field, mask, a, x, y, reach_headings, reach)
    return out


@njit(**OPTIONS)
def _exceeds(field, mask, a, x, y, reach_headings, reach):
    """Whether an element exceeds its neighbours; of equal ones the first counts."""
    A, X, Y = field.shape
    value, place = field[a, x, y], (a * X + x) * Y + y
    for step in range(-reach_headings, reach_headings + 1):
        other = (a + step) % A
        for i in range(max(x - reach, 0), min(x + reach, X - 1) + 1):
            for j in range(max(y - reach, 0), min(y + reach, Y - 1) + 1):
                if not mask[i, j]:
                    continue
                if field[other, i, j] > value:
                    return False
                if field[other, i, j] == value and (other * X + i) * Y + j < place:
                    return False
    return True
