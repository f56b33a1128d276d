"""The inner loops of likeness: eq. 2, correlations. Plain arrays in and out.

Panoramas are (H, W) float32 whose columns wrap around; nothing here may show a seam.
"""

import math
import os

import numpy as np

from sphere_nav.kernel_cache.kernels import OPTIONS, njit, prange

# Threads that spin while they wait stall every other process of a small vehicle computer; read when a kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


NO_DIRECTION = 255  # code of a pixel without a gradient
NUM_DIRECTIONS = 255  # codes of the half circle

_angles = (np.arange(256) * (math.pi / NUM_DIRECTIONS)).astype(np.float32)
COSINES = np.where(np.arange(256) == NO_DIRECTION, 0, np.cos(_angles)).astype(np.float32)
SINES = np.where(np.arange(256) == NO_DIRECTION, 0, np.sin(_angles)).astype(np.float32)
SQUARES = ((np.arange(256) / 255.0) ** 2).astype(np.float32)


# ---- eq. 2 ------------------------------------------------------------------------------------------------------


@njit(**OPTIONS)
def _add_row(vx, vy, vm, seen, dx, dy, dm, sums):
    """Add the terms of eq. 2 of one row for all rotations, and the depth gradients in view.

    v, seen (W,), d (2W,) repeated, sums (num_alpha, 3).
    """
    W = len(vx)
    num_alpha = len(sums)
    for i in range(num_alpha):
        offset = W - i * (W // num_alpha)
        x, y, m = dx[offset : offset + W], dy[offset : offset + W], dm[offset : offset + W]
        visual, depth, in_view = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for u in range(W):
            c = abs(vx[u] * x[u] + vy[u] * y[u])
            visual += c * vm[u]
            depth += c * m[u]
            in_view += seen[u] * m[u]
        sums[i, 0] += visual
        sums[i, 1] += depth
        sums[i, 2] += in_view


@njit(**OPTIONS)
def _join_terms(sums, share, out):
    """Write s (num_alpha,) from sums (num_alpha, 3).

    Both magnitudes are to sum to 1: where the view is partial, those of the depth gradients in view do; a view
    with fewer of them than half of its share of the picture is taken to have that many.
    """
    for i in range(len(sums)):
        weight = 1.0
        if share < 1.0:
            weight = 1.0 / max(sums[i, 2], 0.5 * share)
        out[i] = sums[i, 0] + weight * sums[i, 1]


@njit(parallel=True, **OPTIONS)
def compare_headings_many(vx, vy, vm, seen, directions, magnitudes, scales, indices, num_alpha):
    """Return eq. 2 (M, num_alpha) f4 for the coded panoramas (N, H, W) of indices (M,)."""
    H, W = vx.shape
    out = np.empty((len(indices), num_alpha), np.float32)
    share = seen.mean()
    for i in prange(len(indices)):
        j = indices[i]
        sums = np.zeros((num_alpha, 3))
        rows = np.empty((3, 2 * W), np.float32)
        for y in range(H):
            for x in range(W):
                direction, m = directions[j, y, x], scales[j] * SQUARES[magnitudes[j, y, x]]
                rows[0, x] = rows[0, W + x] = COSINES[direction]
                rows[1, x] = rows[1, W + x] = SINES[direction]
                rows[2, x] = rows[2, W + x] = m
            _add_row(vx[y], vy[y], vm[y], seen[y], rows[0], rows[1], rows[2], sums)
        _join_terms(sums, share, out[i])
    return out


# ---- correlation -------------------------------------------------------------------------------------------------


@njit(parallel=True, **OPTIONS)
def correlate_codes(codes, scales, slots, weights):
    """Return sum of weights (F, P) c8 times the conjugate of spectra in slots (M,), (M, F) c8; 0 for slot -1.

    codes (N, F, 2 P) i1: real, then imaginary parts, in units of scales (N, F).
    """
    F, size = codes.shape[1:]
    real = np.concatenate((weights.real, weights.imag), axis=1)
    imaginary = np.concatenate((weights.imag, -weights.real), axis=1)
    out = np.zeros((len(slots), F), np.complex64)
    for m in prange(len(slots)):
        n = slots[m]
        if n < 0:
            continue
        for f in range(F):
            a, b = np.float32(0.0), np.float32(0.0)
            for i in range(size):
                value = np.float32(codes[n, f, i])
                a += value * real[f, i]
                b += value * imaginary[f, i]
            out[m, f] = scales[n, f] * complex(a, b)
    return out
