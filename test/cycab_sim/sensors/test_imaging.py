from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.params import ImagingParams, SimCameraParams
from cycab_sim.sensors.cameras import forward_camera
from cycab_sim.sensors.imaging import Exposure, averaged, expose, vignette
from cycab_sim.simulator import Simulator
from sphere_nav.geometry import Pinhole

GAMMA, TENTH = 2.2, 100_000_000
AUTOMATIC = ImagingParams(has_automatic_exposure=True)


def gray(radiance, gain):
    return np.full((32, 32), 255.0 * min(1.0, radiance * gain) ** (1 / GAMMA), np.float32)


def run(exposure, radiances):
    levels = []
    for i, radiance in enumerate(radiances):
        image = gray(radiance, exposure.gains(i * TENTH)[1])
        exposure.observe(i * TENTH, image)
        levels.append(float(image[0, 0]))
    return np.array(levels)


def test_the_exposure_comes_to_its_target_after_its_delay(monkeypatch):
    monkeypatch.setattr(ImagingParams, "exposure_delay", 0.2)
    monkeypatch.setattr(ImagingParams, "exposure_lag", 0.5)
    levels = run(Exposure(AUTOMATIC, (1, 2)), [0.17] * 40 + [0.6] * 60)
    assert levels[39] == pytest.approx(115.0, abs=1.0)
    assert levels[40] > levels[39] + 60.0  # the light has changed at once
    assert levels[41] == pytest.approx(levels[40])  # and nothing is known of it for 0.2 s
    assert levels[43] < levels[41] - 3.0
    assert levels[99] == pytest.approx(115.0, abs=1.0)


def test_an_open_shutter_means_the_light_and_not_the_levels():
    def draw(offset):
        return np.full((2, 2), 255.0 if offset > 0 else 0.0, np.float32), np.zeros((2, 2), np.float32)

    np.testing.assert_allclose(averaged(draw, 0.01, 4), 255.0 * 0.5 ** (1 / GAMMA), rtol=1e-5)


@pytest.mark.slow
def test_a_moving_camera_blurs_along_its_way(small_params):
    simulator = Simulator(replace(small_params, world="ramp"))
    quiet = simulator.mounts["camera"]

    def detail(shutter, speed):
        simulator.mounts["camera"] = replace(quiet, imaging=ImagingParams(noise=0.0, shutter=shutter))
        simulator.teleport(*simulator.path.at(np.array(40.0))[:3], speed)
        image = simulator.capture("camera").image.astype(float)
        return np.abs(np.diff(image[80:], axis=0)).mean()  # of the road, which passes below

    sharp, still, blurred = detail(0.0, 3.0), detail(0.05, 0.0), detail(0.05, 3.0)
    assert still == pytest.approx(sharp, rel=0.02)
    assert blurred < 0.8 * sharp


def test_noise_has_its_size_and_belongs_to_its_image():
    levels = np.full((200, 200), 120.0, np.float32)
    image = expose(levels, 1.5, 0.02, (1, 7))
    # the variances of electronics, of light, and of rounding to whole levels
    assert image.std() == pytest.approx(np.sqrt(1.5**2 + 0.02 * 120 + 1 / 12), rel=0.03)
    assert image.mean() == pytest.approx(120.0, abs=0.05)
    np.testing.assert_array_equal(image, expose(levels, 1.5, 0.02, (1, 7)))
    assert np.mean(image == expose(levels, 1.5, 0.02, (1, 8))) < 0.3


def test_vignetting_takes_its_share_of_the_light_in_the_corners_and_none_in_the_middle():
    fall = vignette(Pinhole(81, 61, 50.0, 50.0, 40.0, 30.0), 0.4)
    assert fall.shape == (61, 81)
    assert fall[30, 40] == 1.0
    assert fall[[0, 0, -1, -1], [0, -1, 0, -1]] ** 2.2 == pytest.approx([0.6] * 4, abs=1e-5)
    assert fall[30, 0] > fall[0, 0]
    assert forward_camera(SimCameraParams(), ImagingParams(vignetting=0.3)).imaging.vignetting == 0.3
