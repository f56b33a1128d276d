"""The second opinion on two spheres finds a known motion from their ranges."""

import numpy as np

from benchmarks.depth_icp import icp
from benchmarks.room import render
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.sphere import Sphere

CAMERA = Spherical(256, 128)
PLACE = SE3.exp([2.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # where walls of all directions are within reach


def test_a_known_motion_is_found_by_ranges_alone():
    motion = SE3.exp([0.2, -0.15, 0.05, 0.02, -0.01, 0.03])
    rng = np.random.default_rng(0)
    spheres = []
    for pose in (SE3.identity(), motion):
        _, range_m = render(CAMERA, PLACE @ pose)
        noisy = range_m + rng.normal(0.0, 0.005, range_m.shape)
        spheres.append(Sphere(np.full(range_m.shape, 128, np.uint8), noisy.astype(np.float32), CAMERA))
    distance, angle = icp(*spheres, SE3.identity()).distance(motion)
    assert distance < 0.01  # 5 mm of noise, thousands of pairs
    assert angle < np.radians(0.3)
