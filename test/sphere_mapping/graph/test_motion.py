import numpy as np

from sphere_mapping.graph.motion import DriveMotion, Expectation, Placed
from sphere_nav.geometry import SE3

CONTRADICTED = 2

STEP = SE3.exp([0.3, 0.0, 0.05, 0.0, 0.02, 0.1])


def close(a, b):
    np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-12)


def moving(odometry=(None, None)):
    prior = DriveMotion()
    prior.update(Placed(0, SE3.identity(), odometry[0]))
    prior.update(Placed(100, STEP, odometry[1]))
    return prior


def test_velocity_is_carried_on_in_proportion_to_time():
    close(moving().predict(200), STEP @ STEP)
    close(moving().predict(150), STEP @ SE3.exp(STEP.log() / 2))
    close(moving().predict(700), STEP @ SE3.exp(STEP.log() * 6))


def test_the_velocity_at_a_sphere_is_by_those_before_and_after_it():
    prior, faster = moving(), SE3.exp(3.0 * STEP.log())
    after = STEP @ faster
    np.testing.assert_allclose(prior.velocity_through(after, 200), 2.0 * STEP.log() / 100e-9, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(prior.velocity_to(after, 200), 3.0 * STEP.log() / 100e-9, rtol=1e-9, atol=1e-6)
    first = DriveMotion()
    first.update(Placed(0, SE3.identity()))
    np.testing.assert_allclose(first.velocity_through(STEP, 100), STEP.log() / 100e-9, rtol=1e-9, atol=1e-6)


def test_odometry_goes_before_velocity_whatever_its_frame():
    T_odom_map = SE3.exp([5.0, 2.0, 0.0, 0.0, 0.0, 1.0])
    turn = SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    prior = moving((T_odom_map, T_odom_map @ STEP))
    close(prior.predict(200, T_odom_map @ STEP @ turn), STEP @ turn)
    close(moving().predict(200, T_odom_map), STEP @ STEP)  # not heard before: cannot be used


def test_an_expectation_is_as_sure_as_what_it_is_made_of():
    """By velocity it errs by accelerations of 5 m/s^2 and 10 rad/s^2, by odometry by a tenth of the motion."""
    moving_on = DriveMotion()
    moving_on.update(Placed(0, SE3.identity()))
    moving_on.update(Placed(200_000_000, STEP))
    expected = moving_on.expect(400_000_000)
    close(expected.T_map_sphere, STEP @ STEP)
    np.testing.assert_allclose([expected.sigma_m, expected.sigma_rad], [0.05 + 0.5 * 5 * 0.04, 0.03 + 0.5 * 10 * 0.04])
    rolled = SE3.exp([2.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    by_wheels = DriveMotion()
    by_wheels.update(Placed(0, SE3.identity(), STEP))
    expected = by_wheels.expect(400_000_000, STEP @ rolled)
    close(expected.T_map_sphere, rolled)
    distance, angle = SE3.identity().distance(rolled)
    np.testing.assert_allclose([expected.sigma_m, expected.sigma_rad], [0.05 + 0.1 * distance, 0.03 + 0.1 * angle])


def test_an_expectation_allows_as_much_as_three_numbers_vary_and_is_sharp_up_to_20_cm_and_a_tenth_of_a_radian():
    for sigmas, is_sharp in (((0.2, 0.1), True), ((0.21, 0.1), False), ((0.2, 0.11), False)):
        expected = Expectation(SE3.identity(), *sigmas)
        assert expected.is_sharp == is_sharp
        for share, is_allowed in ((4.03, True), (4.04, False)):
            assert expected.allows(SE3.exp([0.0, share * sigmas[0], 0.0, 0.0, 0.0, 0.0])) == is_allowed
            assert expected.allows(SE3.exp([0.0, 0.0, 0.0, 0.0, 0.0, share * sigmas[1]])) == is_allowed


def test_a_motion_is_known_by_odometry_or_for_as_long_as_one_sphere_takes():
    assert not DriveMotion().expect(5).is_known
    first = DriveMotion()
    first.update(Placed(0, SE3.identity(), SE3.identity()))
    assert not first.expect(100).is_known  # the first pair of a drive
    assert first.expect(100, STEP).is_known
    assert [moving().expect(stamp).is_known for stamp in (200, 300, 351)] == [True, True, False]


def test_odometry_that_spheres_in_a_row_contradict_is_not_believed():
    prior = moving((SE3.identity(), STEP))
    reset = SE3.from_planar(50.0, 0.0, 0.0)
    for _ in range(CONTRADICTED):
        close(prior.expect(200, reset).T_map_sphere, reset)
        prior.lose()
    close(prior.expect(200, reset).T_map_sphere, STEP @ STEP)
    prior.update(Placed(200, STEP @ STEP, reset))
    close(prior.expect(300, reset @ STEP).T_map_sphere, STEP @ STEP @ STEP)
    assert not prior.expect(300).is_known  # how it came there is not how it goes on
