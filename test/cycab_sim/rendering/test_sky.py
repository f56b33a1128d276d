import numpy as np
import pytest

from cycab_sim.params import LightParams
from cycab_sim.rendering.sky import AMBIENT, SUN, is_constant, light_at, sun_angles


def test_without_an_hour_the_angles_decide():
    light = light_at(LightParams(sun="90,30"), 1234.5, 1)
    np.testing.assert_allclose(light.sun, [0.0, np.cos(np.pi / 6), 0.5], atol=1e-12)
    np.testing.assert_array_equal(light.sun_color, SUN)
    np.testing.assert_array_equal(light.sky_color, AMBIENT)
    assert light.sky_gain == 1.0


def test_the_sun_goes_from_east_over_south_to_west():
    azimuths, elevations = np.degrees([sun_angles(hour) for hour in (7.0, 12.0, 17.0)]).T
    assert -20.0 < azimuths[0] < 20.0  # east is the x axis
    assert azimuths[1] == pytest.approx(-90.0)
    assert abs(azimuths[2]) > 160.0
    assert elevations[1] == pytest.approx(90.0 - 45.78 + 20.0)  # 90 deg - latitude + declination
    assert elevations[0] == pytest.approx(elevations[2])


def test_a_low_sun_is_weak_and_red():
    noon, evening = (light_at(LightParams(sun=f"{hour}h"), 0.0, 1) for hour in (12.0, 18.3))
    assert evening.sun_color.sum() < 0.7 * noon.sun_color.sum()
    assert evening.sun_color[2] / evening.sun_color[0] < 0.8 * noon.sun_color[2] / noon.sun_color[0]


def test_the_hour_passes():
    params = LightParams(sun="9h", hour_rate=0.001)
    np.testing.assert_allclose(light_at(params, 3000.0, 1).sun, light_at(LightParams(sun="12h"), 0.0, 1).sun)
    assert not is_constant(params)
    assert is_constant(LightParams(sun="9h"))
    assert is_constant(LightParams())


def test_clouds_take_the_sun_and_give_it_back():
    params = LightParams(clouds=0.8)
    assert not is_constant(params)
    shares = np.array([light_at(params, t, 3).sun_color[0] / SUN[0] for t in np.arange(0.0, 600.0, 1.0)])
    assert shares.min() < 0.3  # 1 - 0.8 at the darkest
    assert shares.max() > 0.9
    assert np.abs(np.diff(shares)).max() < 0.8 * 3 * 2 * np.pi / 90.0  # three waves at their steepest: no flicker
    assert shares[17] == light_at(params, 17.0, 3).sun_color[0] / SUN[0]


def test_on_a_day_of_the_year_light_falls_with_the_sun_through_twilight_into_night():
    hours = np.arange(12.0, 24.0, 0.25)
    lights = [light_at(LightParams(sun=f"80,{hour}h"), 0.0, 1) for hour in hours]  # sets at 18 h
    ground = np.array(
        [np.maximum(light.sun[2], 0.0) * light.sun_color.sum() + light.sky_color.sum() for light in lights]
    )
    assert np.all(np.diff(ground) <= 0.0)
    suns = np.array([light.sun_color.sum() for light in lights])
    assert np.all(suns[hours > 18.25] == 0.0)
    assert np.all(suns[hours < 17.75] > 0.0)
    assert ground[-1] < 1e-4 * ground[0]
    assert np.diff(np.log(ground)).min() > np.log(1 / 12)  # a quarter of an hour: no switch


def test_a_winter_sun_is_lower():
    heights = [light_at(LightParams(sun=f"{day},12h"), 0.0, 1).sun[2] for day in (172, 80, 355)]
    np.testing.assert_allclose(np.degrees(np.arcsin(heights)), [67.7, 44.2, 20.8], atol=0.6)  # 90 deg - 45.78 +- 23.44


def test_clouds_over_all_of_the_sky_leave_a_third_of_the_light():
    clear, gray = light_at(LightParams(), 0.0, 1), light_at(LightParams(overcast=1.0), 0.0, 1)
    total = np.mean(clear.sun_color * clear.sun[2] + clear.sky_color)
    assert not gray.sun_color.any()
    assert np.ptp(gray.sky_color) == 0.0
    assert gray.sky_color[0] == pytest.approx(0.28 * total)


def test_an_instant_has_its_light(fingerprint):
    """Over days, hours and clouds: two of a condition are one, in every version."""
    suns = [f"{day},{hour}h" for day in (20, 172, 300) for hour in (5.5, 7.0, 12.0, 17.25, 19.0, 22.0)] + [
        "12h",
        "30,40",
    ]
    params = [LightParams(sun=sun, overcast=over, clouds=0.6) for sun in suns for over in (0.0, 0.4)]
    lights = [light_at(one, 50.0 * number, 3) for number, one in enumerate(params)]
    columns = [
        np.array([getattr(one, name) for one in lights]) for name in ("sun", "sun_color", "sky_color", "sky_gain")
    ]
    sizes = [float(np.linalg.norm(column)) for column in columns]
    assert [*fingerprint(*columns), *sizes] == pytest.approx(
        [-0.35631, 0.00483, -0.76739, -0.48326, 6.32456, 4.36608, 2.54789, 3.24951], abs=2e-5
    )
