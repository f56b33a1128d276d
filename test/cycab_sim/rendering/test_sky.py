import numpy as np
import pytest

from cycab_sim.params import LightParams
from cycab_sim.rendering.sky import SUN, light_at, sun_angles


def test_the_sun_goes_from_east_over_south_to_west():
    azimuths, elevations = np.degrees([sun_angles(hour, np.radians(20.0)) for hour in (7.0, 12.0, 17.0)]).T
    assert -20.0 < azimuths[0] < 20.0  # east is the x axis
    assert azimuths[1] == pytest.approx(-90.0)
    assert abs(azimuths[2]) > 160.0
    assert elevations[1] == pytest.approx(90.0 - 45.78 + 20.0)  # 90 deg - latitude + declination
    assert elevations[0] == pytest.approx(elevations[2])


def test_clouds_take_the_sun_and_give_it_back():
    params = LightParams(clouds=0.8)
    shares = np.array([light_at(params, t, 3).sun_color[0] / SUN[0] for t in np.arange(0.0, 600.0, 1.0)])
    assert shares.min() < 0.3  # 1 - 0.8 at the darkest
    assert shares.max() > 0.9
    assert np.abs(np.diff(shares)).max() < 0.8 * 3 * 2 * np.pi / 90.0  # three waves at their steepest: no flicker
    assert shares[17] == light_at(params, 17.0, 3).sun_color[0] / SUN[0]
