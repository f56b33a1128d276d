"""Passes at one level of the pyramid until the pose stands still, and the comparison that judges it.

Poses are (3, 4) f64. Arrays are filled number by number: the check of shapes in `a[:] = b` brings numba's texts along,
five seconds to compile. Of N views come blocks, cameras and images as tuples, which may be longer, T_world_reference
and T_camera_body (N, 3, 4): where the reference is, and where the body is from the camera that sees the view.
"""

import math

import numpy as np

from sphere_nav.estimation.kernels import SIGMA_OF_MAD, newton_step
from sphere_nav.kernel_cache.kernels import OPTIONS, njit
from sphere_nav.photometric.align.iteration.kernels import (
    BLOCK,
    INLIERS,
    NUM_BINS,
    NUM_COLUMNS,
    NUM_SUMS,
    SCRATCH,
    SIDE,
    VISIBLE,
    accumulate,
    scale,
)

SCALE_STEP = 4  # of so many blocks one serves for the scale, and at least so many in all:
MIN_SCALE_BLOCKS = 8
NUM_PIECES = 16  # at most so many pieces of a view show how differently its parts bias a pose, of at least
PIECE_BLOCKS = 8
MIN_GAIN, MAX_GAIN = 0.1, 10.0
LIGHT_PRIOR = 1e-9  # keeps gain and bias defined on an even image
NUM_FACTS = 10
MEDIAN, MAD, NUM_VISIBLE, NUM_INLIERS, NUM_CUT = range(5)  # the last: pieces
SUM_REFERENCE, SUM_CURRENT, PRODUCT, SQUARE_REFERENCE, SQUARE_CURRENT = range(5, NUM_FACTS)


@njit(**OPTIONS)
def invert(T):
    """Return the motion back."""
    out = np.empty((3, 4))
    for i in range(3):
        for j in range(3):
            out[i, j] = T[j, i]
        out[i, 3] = -(T[0, i] * T[0, 3] + T[1, i] * T[1, 3] + T[2, i] * T[2, 3])
    return out


@njit(**OPTIONS)
def compose(A, B):
    """Return A @ B of two motions."""
    out = np.empty((3, 4))
    for i in range(3):
        for j in range(4):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]
        out[i, 3] += A[i, 3]
    return out


@njit(**OPTIONS)
def exponential(xi):
    """Return the motion (3, 4) of a tangent vector (v, omega) (M15 eq. 1)."""
    a, b, c = xi[3], xi[4], xi[5]
    square = a * a + b * b + c * c
    angle = math.sqrt(square)
    if angle < 1e-4:
        by_sine, by_cosine, by_cube = 1 - square / 6, 0.5 - square / 24, 1 / 6 - square / 120
    else:
        by_sine, by_cosine = math.sin(angle) / angle, (1 - math.cos(angle)) / square
        by_cube = (1 - by_sine) / square
    k = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    out = np.empty((3, 4))
    for i in range(3):
        out[i, 3] = 0.0
        for j in range(3):
            kk = k[i, 0] * k[0, j] + k[i, 1] * k[1, j] + k[i, 2] * k[2, j]
            one = 1.0 if i == j else 0.0
            out[i, j] = one + by_sine * k[i, j] + by_cosine * kk
            out[i, 3] += (one + by_cosine * k[i, j] + by_cube * kk) * xi[j]
    return out


@njit(**OPTIONS)
def unpack_sums(sums, H, g):
    """Write sums (NUM_SUMS,) into H (8, 8) and g (8,) over (v, omega) of the reference, gain and bias."""
    s = 0
    for a in range(NUM_COLUMNS):
        for b in range(a, NUM_COLUMNS):
            H[a, b] = H[b, a] = sums[s]
            s += 1
        g[a] = sums[s]
        s += 1


@njit(**OPTIONS)
def by_body(T):
    """Return A (8, 8): x = A xi turns xi in T_world_body exp(xi), gain and bias into x in T exp(x) (eq. 31-32).

    T (3, 4) is reference -> body; x = -Ad(T^-1) xi. It is the same x on the right of a camera's T_camera_reference.
    """
    A = np.zeros((8, 8))
    for i in range(3):
        for j in range(3):
            A[i, j] = A[3 + i, 3 + j] = -T[j, i]  # R' of the inverse
    t0, t1, t2 = T[0, 3], T[1, 3], T[2, 3]
    for i in range(3):  # [t']x R' with t' = -R' t is -R' [t]x
        a, b, c = T[0, i], T[1, i], T[2, i]
        A[i, 3], A[i, 4], A[i, 5] = b * t2 - c * t1, c * t0 - a * t2, a * t1 - b * t0
    A[6, 6] = A[7, 7] = 1.0
    return A


@njit(**OPTIONS)
def to_body_tangent(T, H, g):
    """Transform H (8, 8), g (8,) over x in T exp(x) to xi in T_world_body exp(xi), in place (eq. 31-32)."""
    A = by_body(T)
    HA, q = np.zeros((8, 8)), np.zeros(8)
    for i in range(8):
        for k in range(8):
            for j in range(8):
                HA[i, j] += H[i, k] * A[k, j]
    H[:] = 0.0
    for k in range(8):
        for i in range(8):
            q[i] += A[k, i] * g[k]
            for j in range(8):
                H[i, j] += A[k, i] * HA[k, j]
    for i in range(8):
        g[i] = q[i]


@njit(**OPTIONS)
def join_view(view, h, q, sigma, H, g):
    """Add one view's H (8, 8) and g (8,) to the system over (xi, gain 1, bias 1, gain 2, bias 2, ...) (eq. 19, 31).

    Unlike in the paper each view counts by the inverse variance of its residuals, so that a distant reference with
    much occlusion steadies the result without biasing it.
    """
    f = 1.0 / sigma**2
    for a in range(NUM_COLUMNS):
        i = a if a < 6 else a + 2 * view
        g[i] += f * q[a]
        for b in range(NUM_COLUMNS):
            j = b if b < 6 else b + 2 * view
            H[i, j] += f * h[a, b]
        if a >= 6:
            H[i, i] += LIGHT_PRIOR


@njit(**OPTIONS)
def add_expectation(T_world_body, expected, H, g):
    """Add what is known of the pose beforehand to H and g (6 or more), in place; see `Expectation.weighted`.

    The deviation is taken to first order in its rotation.
    """
    T_body_world, information, bound = expected
    D, r, q, square = compose(T_body_world, T_world_body), np.empty(6), np.zeros(6), 0.0
    for i in range(3):
        r[i] = D[i, 3]
        r[3 + i] = 0.5 * (D[(i + 2) % 3, (i + 1) % 3] - D[(i + 1) % 3, (i + 2) % 3])
    for i in range(6):
        for j in range(6):
            q[i] += information[i, j] * r[j]
        square += r[i] * q[i]
    weight = 1.0 if square <= bound**2 else bound / math.sqrt(square)
    for i in range(6):
        g[i] += weight * q[i]
        for j in range(6):
            H[i, j] += weight * information[i, j]


@njit(**OPTIONS)
def scale_step(num_blocks):
    """Return every how many blocks are enough for the scale."""
    return max(1, min(SCALE_STEP, num_blocks // MIN_SCALE_BLOCKS))


@njit(**OPTIONS)
def num_pieces(num_blocks):
    """Return how many pieces a view is cut into."""
    return max(1, min(NUM_PIECES, num_blocks // PIECE_BLOCKS))


@njit(**OPTIONS)
def examine(blocks, T, camera, image, gain, bias, huber, min_sigma, facts, pieces):
    """Compare one view: facts (NUM_FACTS,) f64, sums of each piece (NUM_PIECES, NUM_SUMS) f64.

    T (3, 4) f64 reference -> camera. Sums of the correlation are of grey levels as they are, light not applied.
    """
    T32, gain32, bias32 = T.astype(np.float32), np.float32(gain), np.float32(bias)
    r, places, histogram = np.empty(SCRATCH, np.float32), np.empty(SIDE, np.int32), np.empty(NUM_BINS, np.int32)
    number = blocks.size // BLOCK
    median, mad, _ = scale(blocks, scale_step(number), T32, camera, image, gain32, bias32, r, places, histogram)
    middle, width = np.float32(median), np.float32(huber * max(SIGMA_OF_MAD * mad, min_sigma))
    facts[:] = 0.0
    facts[MEDIAN], facts[MAD] = median, mad
    count = num_pieces(number)
    facts[NUM_CUT] = count
    for p in range(count):
        pieces[p] = 0.0
        some = number * p // count, number * (p + 1) // count
        light = gain32, bias32, middle, width
        accumulate(blocks, *some, T32, camera, image, *light, r, places, pieces[p], facts[SUM_REFERENCE:])
        facts[NUM_VISIBLE] += pieces[p, VISIBLE]
        facts[NUM_INLIERS] += pieces[p, INLIERS]


@njit(**OPTIONS)
def linearize(views, T_world_body, light, robust, facts, pieces):
    """Robust normal equations of all views at a pose (M15 eq. 4, 6, 8, 19, 30-35), and how many pixels are visible.

    views are the blocks, cameras and images of N views or more, which beyond N do not count, N, and T_world_reference
    and T_camera_body (N, 3, 4). facts (N, NUM_FACTS) and pieces (N, ...) as of `examine`.
    """
    blocks, cameras, images, num_views, T_world_reference, T_camera_body = views
    (huber, min_sigma), n = robust, 6 + 2 * num_views
    H, g = np.zeros((n, n)), np.zeros(n)
    h, q, sums = np.empty((8, 8)), np.empty(8), np.empty(NUM_SUMS)
    T_body_world = invert(T_world_body)
    visible = 0.0
    for v in range(num_views):
        T_body_reference = compose(T_body_world, T_world_reference[v])
        T = compose(T_camera_body[v], T_body_reference)
        lit = light[v, 0], light[v, 1]
        examine(blocks[v], T, cameras[v], images[v], *lit, huber, min_sigma, facts[v], pieces[v])
        sums[:] = 0.0
        for p in range(int(facts[v, NUM_CUT])):
            for i in range(NUM_SUMS):
                sums[i] += pieces[v, p, i]
        visible += facts[v, NUM_VISIBLE]
        unpack_sums(sums, h, q)
        to_body_tangent(T_body_reference, h, q)
        join_view(v, h, q, max(SIGMA_OF_MAD * facts[v, MAD], min_sigma), H, g)
    return H, g, visible


@njit(**OPTIONS)
def image_motion(xi, T_camera_body, per_radian, depth):
    """Return by how many pixels an increment xi of the body moves the image of a camera, of points `depth` m away."""
    T = invert(T_camera_body)
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    a, b, c = xi[0] + xi[4] * z - xi[5] * y, xi[1] + xi[5] * x - xi[3] * z, xi[2] + xi[3] * y - xi[4] * x
    turn = math.sqrt(xi[3] ** 2 + xi[4] ** 2 + xi[5] ** 2)
    return (turn + math.sqrt(a**2 + b**2 + c**2) / depth) * per_radian


@njit(**OPTIONS)
def descend(views, T_world_body, light, robust, expected, scales, stop, limit, is_rotation, facts, pieces):
    """Iterate at one level (M15 eq. 6-7); T_world_body (3, 4) and light (N, 2) change in place.

    views as of `linearize`, robust is (Huber bound, smallest sigma), expected as of `add_expectation`, scales (N, 2)
    the pixels per radian of the views and their depth in m, stop (smallest increment in pixels, fewest visible pixels).
    A pure rotation (eq. 20) leaves the translation as it is. Returns the iterations, the last increment in pixels, and
    whether the images determined it; facts and pieces are those of the last pass, before its increment.
    """
    min_step, min_pixels = stop
    first = 3 if is_rotation else 0
    motion, iteration = 0.0, 0
    xi = np.zeros(6)
    num_views, _, T_camera_body = views[3:]
    while iteration < limit:
        H, g, visible = linearize(views, T_world_body, light, robust, facts, pieces)
        if visible < min_pixels:
            return iteration, motion, False
        add_expectation(T_world_body, expected, H, g)
        x, is_found = newton_step(H, g, first)
        if not is_found:
            return iteration, motion, False
        for i in range(first, 6):
            xi[i] = x[i - first]
        pose = compose(T_world_body, exponential(xi))
        for i in range(3):
            for j in range(4):
                T_world_body[i, j] = pose[i, j]
        iteration, motion = iteration + 1, 0.0
        for v in range(num_views):
            light[v, 0] = min(max(light[v, 0] + x[6 - first + 2 * v], MIN_GAIN), MAX_GAIN)
            light[v, 1] += x[7 - first + 2 * v]
            motion = max(motion, image_motion(xi, T_camera_body[v], scales[v, 0], scales[v, 1]))
        if motion < min_step:
            break
    return iteration, motion, True
