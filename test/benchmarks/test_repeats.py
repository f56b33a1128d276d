"""What the simulated repeats draw and judge by themselves; their rows are the commands."""

from dataclasses import replace

import numpy as np

from benchmarks.drive.missions import Taught
from benchmarks.drive.repeats import Drive, Found, deviations, judge
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory

SECOND = 10**9
OFF = np.full((1, 6), 0.01)
GOOD = Found(100, 1.0, 1.0, "", OFF, np.ones(1))


def test_what_is_judged_begins_with_the_second_visit_but_for_what_is_wrong():
    drives = [Drive(1, "snow", 1, 0.0), Drive(2, "snow", 2, 0.0), Drive(3, "", 2, 0.0)]
    wrong, fewer = replace(GOOD, share=0.1, off=20 * OFF), replace(GOOD, share=0.9, off=4 * OFF, num_images=50)
    found = [wrong, GOOD, fewer]
    measured = [bound.measured for bound in judge(list(zip(drives, found, strict=True)), 1.5, "")]
    np.testing.assert_allclose(measured, [145 / 150, 0.9, 1, 1.5, 0.04])


def drive_of(poses):
    return Trajectory(np.arange(len(poses), dtype=np.int64) * SECOND, SE3(np.stack([T.matrix for T in poses])))


def test_errors_are_relative_to_the_taught_drive():
    """A map that bends by a degree a meter says nothing of the drive: what both are off by alike is no error."""
    step, bent = SE3.exp([1.0, 0, 0, 0, 0, 0]), SE3.exp([1.0, 0, 0, 0, 0, 0.02])
    true, mapped = [SE3.identity()], [SE3.exp([5.0, 5.0, 0, 0, 0, 1.0])]
    for _ in range(5):
        true, mapped = [*true, true[-1] @ step], [*mapped, mapped[-1] @ bent]
    taught = Taught(drive_of(mapped), drive_of(true))
    off = SE3.exp([0.0, 0.1, 0, 0, 0, 0])  # the drive was beside the taught one, and the map says a little more
    more = SE3.exp([0.0, 0.13, 0, 0, 0, 0])
    told = replace(drive_of([T @ more for T in mapped]), covariances=np.tile(1e-4 * np.eye(6), (6, 1, 1)))
    found, sigmas = deviations(told, drive_of([T @ off for T in true]), taught)
    np.testing.assert_allclose(found, np.tile([0.0, 0.03, 0.0, 0.0, 0.0, 0.0], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(sigmas, 3.0, rtol=1e-4)
