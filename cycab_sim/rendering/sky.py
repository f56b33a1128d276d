"""The light of an instant: where the sun stands at an hour of the day, how red it is, and clouds before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cycab_sim.params import LightParams
from sphere_nav.geometry.arrays import Array

SUN, AMBIENT = np.array([1.25, 1.15, 0.98]), np.array([0.34, 0.40, 0.52])  # radiance with the sun 43 deg high
LATITUDE = np.radians(45.78)  # of Clermont-Ferrand
LOWEST = np.radians(3.0)  # the sun does not set, and longer shadows are not drawn
HAZE = np.array([0.10, 0.16, 0.30])  # what the air overhead takes of red, green and blue
USUAL = np.radians(43.0)
UNIT = 40_000.0  # lx on a surface that is a radiance of one: AMBIENT, 0.4 overhead, is 16,000 lx of blue sky
# light of a clear sky on the ground by the sun's elevation, deg and lx, rounded from tables of twilight; the last of
# the night is the glow of a town
ELEVATIONS = np.array([-18.0, -12.0, -6.0, -3.0, 0.0, 5.0, 10.0, 20.0, 43.0, 90.0])
DIFFUSE = np.array([0.15, 0.2, 3.4, 40.0, 400.0, 3000.0, 6000.0, 10_000.0, 16_000.0, 19_000.0])
THICK = 0.28  # of the light of a clear day that comes through a closed layer of clouds
SOLSTICE, TILT = 172.0, np.radians(23.44)  # day of the year when the sun is highest, and its declination then
FADE = np.radians(0.53)  # the sun sets within its own width
CLOUD_WAVES = np.array([1.0, 2.3, 4.1])  # clouds come and go with these multiples of their rate


@dataclass(frozen=True, eq=False)
class SkyLight:
    """Unit vector (3,) towards the sun, radiance (3,) of sun and open sky on a surface, and a factor on the sky."""

    sun: Array
    sun_color: Array
    sky_color: Array
    sky_gain: float


def light_at(params: LightParams, seconds: float, seed: int) -> SkyLight:
    """Return the light after a time: the sun stands still, clouds pass."""
    if not params.has_hour:
        azimuth, elevation = np.radians(params.sun_deg)
        red, share = np.ones(3), 1.0
    else:
        day, hour = params.day_and_hour
        azimuth, true_elevation = sun_angles(hour, declination(day))
        elevation = max(true_elevation, LOWEST)  # of the shadows
        above = float(np.clip(true_elevation / FADE + 0.5, 0.0, 1.0))
        red = np.exp(-HAZE * (_air(max(true_elevation, 0.0)) - _air(USUAL))) * above
        share = float(np.exp(np.interp(np.degrees(true_elevation), ELEVATIONS, np.log(DIFFUSE / 16_000.0))))
    sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    cover = params.clouds * _cloud(seconds / params.cloud_period, seed) if params.clouds else 0.0
    sun_color, sky_color = SUN * red * (1.0 - cover), AMBIENT * share * (1.0 + 0.25 * cover)
    if params.overcast:
        gray = THICK * float(np.mean(sun_color * max(np.sin(elevation), 0.0) + sky_color))
        sky_color = (1.0 - params.overcast) * sky_color + params.overcast * gray
        sun_color = (1.0 - params.overcast) * sun_color
    return SkyLight(sun, sun_color, sky_color, share * (1.0 - 0.2 * cover))


def declination(day: float) -> float:
    """Return the sun's declination on a day of the year, rad."""
    return float(TILT * np.cos(2.0 * np.pi * (day - SOLSTICE) / 365.25))


def sun_angles(hour: float, tilt: float) -> tuple[float, float]:
    """Return azimuth, counter-clockwise from the x axis (east), and elevation, rad, at a solar hour of the day.

    tilt: the sun's declination, rad
    """
    turn = np.pi / 12.0 * (hour - 12.0)
    up = np.sin(LATITUDE) * np.sin(tilt) + np.cos(LATITUDE) * np.cos(tilt) * np.cos(turn)
    east = -np.cos(tilt) * np.sin(turn)
    north = np.cos(LATITUDE) * np.sin(tilt) - np.sin(LATITUDE) * np.cos(tilt) * np.cos(turn)
    return float(np.arctan2(north, east)), float(np.arcsin(up))


def _air(elevation: float) -> float:
    """Return the way through the air over that straight down (Kasten and Young 1989)."""
    return float(1.0 / (np.sin(elevation) + 0.50572 * (np.degrees(elevation) + 6.07995) ** -1.6364))


def _cloud(turns: float, seed: int) -> float:
    """Return how much of the sun is hidden, 0 to 1: a smooth function, mostly one or the other."""
    phases = np.random.default_rng([seed, 81]).uniform(0.0, 2 * np.pi, len(CLOUD_WAVES))
    wave = np.sum(np.sin(2 * np.pi * CLOUD_WAVES * turns + phases) / CLOUD_WAVES)
    return float(1.0 / (1.0 + np.exp(-4.0 * wave)))
