"""Each kernel against a few lines of NumPy, and against the definitions in sphere_geometry."""

import numpy as np
import pytest

from photometric import kernels
from photometric.reference import kernel_camera
from photometric.robust import huber_weights, median_and_mad
from photometric.scratch import scratch
from sphere_geometry import SE3, Fisheye, Pinhole, Spherical

CAMERAS = [
    Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5),
    Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5, (-0.2, 0.05, 1e-3, -2e-3, 0.01)),
    Fisheye(64, 64, 20.0, 20.5, 31.0, 32.0, (0.05, -0.06, 0.03, -0.005)),
    Spherical(128, 64),
    Spherical(40, 30, 128.0, 110.0, 12.0),
]


def points_before(camera, rng, number=1500):
    pixels = np.stack([rng.uniform(0, camera.width - 1, number), rng.uniform(0, camera.height - 1, number)], axis=-1)
    rays = camera.unproject(pixels)
    return rays[~np.isnan(rays[:, 0])] * rng.uniform(0.5, 20.0, (np.sum(~np.isnan(rays[:, 0])), 1))


def project(camera, points):
    model, k = kernel_camera(camera)
    number = len(points)
    x, y, z = (np.ascontiguousarray(row, dtype=np.float32) for row in points.T)
    u, v = np.empty(number, np.float32), np.empty(number, np.float32)
    J = tuple(np.empty(number, np.float32) for _ in range(6))
    kernels._project(model, k, number, x, y, z, u, v, J)
    return np.stack([u, v], axis=-1), np.stack(J, axis=-1).reshape(number, 2, 3)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: f"{camera.model}-{len(camera.coefficients)}")
def test_projection_and_its_jacobian_are_those_of_sphere_geometry(camera, rng):
    points = points_before(camera, rng)
    pixels, J = project(camera, points)
    expected, _ = camera.project(points)
    assert np.abs(pixels - expected).max() < 2e-4  # float32 at a few hundred pixels
    J_expected = camera.J_project(points)
    assert np.abs(J - J_expected).max() / np.abs(J_expected).max() < 1e-5


def test_projection_refuses_what_the_camera_cannot_see():
    behind = np.array([[0.1, 0.1, -1.0], [0.0, 0.0, 0.0]])
    assert np.isnan(project(CAMERAS[0], behind)[0]).any(axis=-1).all()
    folding = Pinhole(64, 48, 50.0, 52.0, 31.0, 24.5, (-0.3,))  # turns back at a radius of 1.05
    assert np.isnan(project(folding, np.array([[1.8, 0.0, 1.0]]))[0]).any()


def test_arctangent_is_exact_to_float32_in_all_quadrants(rng):
    y, x = rng.normal(size=(2, 4000)).astype(np.float32)
    found = np.array([kernels._arctangent2(a, b) for a, b in zip(y, x, strict=True)])
    assert np.abs(found - np.arctan2(y, x)).max() < 1e-6


def case(rng, camera, number=3000):
    """Random pixels of a random reference, seen from nearby."""
    points = np.ascontiguousarray(points_before(camera, rng, number).T, dtype=np.float32)
    number = points.shape[1]
    return {
        "points": points,
        "intensity": rng.uniform(0, 255, number).astype(np.float32),
        "reference_gradient": rng.normal(size=(3, number)).astype(np.float32) * 50,
        "image": rng.uniform(0, 255, (camera.height, camera.width)).astype(np.float32),
        "T": SE3.exp([0.05, -0.03, 0.04, 0.01, -0.02, 0.015]),
    }


def linearise(c, camera, gain=1.0, bias=0.0):
    model, k = kernel_camera(camera)
    number = c["points"].shape[1]
    residual, gradient = np.empty(number, np.float32), np.empty((3, number), np.float32)
    histogram = np.empty((kernels.NUM_CHUNKS, kernels.NUM_BINS), np.int32)
    T = np.ascontiguousarray(c["T"].matrix[:3], dtype=np.float32)
    kernels.linearise(
        c["points"], c["intensity"], c["reference_gradient"], T, model, k, c["image"], 0,
        np.float32(gain), np.float32(bias), scratch(), residual, gradient, histogram,
    )  # fmt: skip
    return residual, gradient, histogram[: kernels.num_pieces(number)]


def bilinear(image, pixels):
    u, v = pixels.T
    iu, iv = np.floor(u).astype(int), np.floor(v).astype(int)
    du, dv = u - iu, v - iv
    a, b, c, d = image[iv, iu], image[iv, iu + 1], image[iv + 1, iu], image[iv + 1, iu + 1]
    grey = (1 - dv) * ((1 - du) * a + du * b) + dv * ((1 - du) * c + du * d)
    gradient = np.stack([(1 - dv) * (b - a) + dv * (d - c), (1 - du) * (c - a) + du * (d - b)], axis=-1)
    return grey, gradient


@pytest.mark.parametrize("camera", CAMERAS[:3], ids=["pinhole", "distorted", "fisheye"])
def test_linearise_is_the_esm_gradient_of_equation_30(camera, rng):
    c = case(rng, camera)
    residual, gradient, histogram = linearise(c, camera, gain=1.1, bias=-3.0)
    points = c["points"].T.astype(np.float64)
    moved = c["T"].apply(points)
    pixels, _ = camera.project(moved)
    with np.errstate(invalid="ignore"):
        inside = np.all((pixels >= 0) & (pixels < (camera.width - 1, camera.height - 1)), axis=-1)
    assert inside.sum() > 1000
    near_border = np.abs(pixels - np.round(pixels)).min(axis=-1) < 1e-3  # float32 may fall into the next pixel
    assert np.array_equal(~np.isnan(residual[~near_border]), inside[~near_border])
    both = inside & ~np.isnan(residual) & ~near_border
    grey, g = bilinear(c["image"].astype(np.float64), pixels[both])
    assert np.abs(residual[both] - (1.1 * grey - 3.0 - c["intensity"][both])).max() < 0.1
    by_point = 1.1 * np.einsum("ni,nij->nj", g, camera.J_project(moved[both])) @ c["T"].rotation
    expected = 0.5 * (c["reference_gradient"].T[both] + by_point)
    assert np.median(np.abs(gradient.T[both] - expected)) < 1e-3 * np.abs(expected).max()
    assert histogram.sum() == np.sum(~np.isnan(residual))


def test_median_and_mad_of_the_histogram_are_those_of_the_residuals(rng):
    camera = CAMERAS[0]
    c = case(rng, camera)
    residual, _, histogram = linearise(c, camera)
    median, mad, number = kernels.median_and_mad(histogram)
    expected_median, expected_mad = median_and_mad(residual)
    assert number == np.sum(~np.isnan(residual))
    assert abs(median - expected_median) < 1.0 / kernels.BINS_PER_GREY
    assert abs(mad - expected_mad) < 1.0 / kernels.BINS_PER_GREY


def test_median_and_mad_of_nothing_are_zero():
    assert kernels.median_and_mad(np.zeros((2, kernels.NUM_BINS), np.int32)) == (0.0, 0.0, 0)


def test_accumulate_sums_the_weighted_products_of_all_columns(rng):
    camera = CAMERAS[0]
    c = case(rng, camera)
    gain, bias, median, bound = 1.2, 4.0, 2.5, 40.0
    residual, gradient, _ = linearise(c, camera, gain, bias)
    sums = np.empty((kernels.NUM_CHUNKS, kernels.NUM_SUMS))
    kernels.accumulate(
        c["points"], c["intensity"], residual, gradient, np.float32(median), np.float32(bound),
        np.float32(gain), np.float32(bias), scratch(), sums,
    )  # fmt: skip
    seen = ~np.isnan(residual)
    e, b, p = residual[seen].astype(np.float64), gradient.T[seen].astype(np.float64), c["points"].T[seen]
    current = (e + c["intensity"][seen] - bias) / gain
    J = np.column_stack([b, np.cross(p, b), current, np.ones(e.size), e])
    w = huber_weights(e, median, bound)
    expected = (J * w[:, None]).T @ J
    total = sums[: kernels.num_pieces(residual.size)].sum(axis=0)
    found = np.zeros((9, 9))
    found[np.triu_indices(9)] = total[:45]
    assert np.abs(found - np.triu(expected)).max() / np.abs(expected).max() < 1e-5
    assert total[45] == pytest.approx(w.sum(), rel=1e-5)
    assert total[46] == np.sum(np.abs(e - median) <= bound)


def test_normal_equations_are_turned_into_the_camera_tangent_by_the_adjoint(rng):
    camera = CAMERAS[0]
    c = case(rng, camera)
    model, k = kernel_camera(camera)
    number = c["points"].shape[1]
    buffers = (
        scratch(),
        np.empty(number, np.float32),
        np.empty((3, number), np.float32),
        np.empty((kernels.NUM_CHUNKS, kernels.NUM_BINS), np.int32),
        np.empty((kernels.NUM_CHUNKS, kernels.NUM_SUMS)),
    )
    H, g = np.empty((8, 8)), np.empty(8)
    inputs = (c["points"], c["intensity"], c["reference_gradient"], c["T"].matrix[:3], model, k, c["image"], 0)
    median, mad, _, inliers = kernels.normal_equations(*inputs, 1.2, 4.0, 1.345, 1.0, *buffers, H, g)
    residual, gradient = buffers[1], buffers[2]
    seen = ~np.isnan(residual)
    e, b, p = residual[seen].astype(np.float64), gradient.T[seen].astype(np.float64), c["points"].T[seen]
    J = np.column_stack([b, np.cross(p, b), (e + c["intensity"][seen] - 4.0) / 1.2, np.ones(e.size)])
    J[:, :6] = -J[:, :6] @ c["T"].inverse().adjoint()  # M15 eq. 31-32
    bound = 1.345 * 1.4826 * mad
    w = huber_weights(e, median, bound)
    expected = (J * w[:, None]).T @ J
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((H - expected) / scale).max() < 1e-5
    assert np.abs((g - J.T @ (w * e)) / np.sqrt(np.diag(expected))).max() < 1e-4 * np.linalg.norm(e)
    assert inliers == np.sum(np.abs(e - median) <= bound)


def test_halve_weighs_1_3_3_1(rng):
    image = rng.uniform(0, 255, (12, 17)).astype(np.float32)
    out = np.empty((6, 8), np.float32)
    kernels.halve(image, out)
    padded = np.pad(image, 1, mode="edge").astype(np.float64)
    weights = np.outer([1, 3, 3, 1], [1, 3, 3, 1]) / 64
    expected = [[np.sum(weights * padded[2 * v : 2 * v + 4, 2 * u : 2 * u + 4]) for u in range(8)] for v in range(6)]
    assert np.abs(out - expected).max() < 1e-4


def test_halve_range_keeps_to_the_nearest_surface():
    nan, inf = np.nan, np.inf
    upper, lower = [1.0, 1.0, nan, nan, 2.0, 10.0, inf, inf], [1.0, 1.0, nan, 3.0, 10.0, inf, inf, nan]
    blocks = np.array([upper, lower], np.float32)
    out = np.empty((1, 4), np.float32)
    kernels.halve_range(blocks, np.float32(1.1), out)
    assert out.tolist() == [[1.0, 3.0, 2.0, inf]]


def test_salient_pixels_are_picked_by_algorithm_1(rng):
    number = 400
    points = rng.uniform(-5, 5, (3, number)).astype(np.float32)
    gradient = (rng.normal(size=(3, number)) * 2.0 ** rng.integers(-12, 12, number)).astype(np.float32)
    order = np.empty((6, number), np.uint32)
    kernels.sort_columns(points, gradient, np.empty((6, number), np.uint16), order)
    J = np.abs(np.column_stack([gradient.T, np.cross(points.T, gradient.T)]))
    for j in range(6):
        column = J[order[j], j]
        ordered = column[1:] <= np.maximum(column[:-1] * 1.01, 2.0**-12)  # what is smaller is all the same
        assert np.all(ordered)
    rank = np.empty(number, np.int32)
    kernels.pick_in_turn(order, rank)
    taken, expected = set(), []
    while len(expected) < number:  # the paper's algorithm, literally, on the sorted columns
        for j in range(6):
            rest = [int(i) for i in order[j] if int(i) not in taken]
            if rest:
                taken.add(rest[0])
                expected.append(rest[0])
    assert np.argsort(rank).tolist() == expected


def test_best_of_gives_the_best_seen_pixels_in_scan_order(rng):
    rank = rng.permutation(1000).astype(np.int32)
    seen = rng.random(1000) < 0.5
    chosen = kernels.best_of(seen, rank, 100)
    expected = np.sort(np.flatnonzero(seen)[np.argsort(rank[seen])[:100]])
    assert np.array_equal(chosen, expected)
    assert np.array_equal(kernels.best_of(seen, rank, 5000), np.flatnonzero(seen))


def test_the_number_of_threads_does_not_change_the_sums(rng):
    numba = pytest.importorskip("numba")
    camera = CAMERAS[0]
    c = case(rng, camera, 20000)
    before = numba.get_num_threads()
    results = []
    try:
        for threads in (1, before):
            numba.set_num_threads(threads)
            results.append(linearise(c, camera))
    finally:
        numba.set_num_threads(before)
    for a, b in zip(*results, strict=True):
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
