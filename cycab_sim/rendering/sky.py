"""The light of an instant: where the sun stands at an hour of the day, how red it is, and clouds before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cycab_sim.params import LightParams
from sphere_nav.geometry.arrays import Array

SUN, AMBIENT = np.array([1.25, 1.15, 0.98]), np.array([0.34, 0.40, 0.52])  # radiance with the sun 43 deg high
LATITUDE, DECLINATION = np.radians(45.78), np.radians(20.0)  # Clermont-Ferrand at the end of May
LOWEST = np.radians(3.0)  # the sun does not set
HAZE = np.array([0.10, 0.16, 0.30])  # what the air overhead takes of red, green and blue
USUAL = np.radians(43.0)
CLOUD_WAVES = np.array([1.0, 2.3, 4.1])  # clouds come and go with these multiples of their rate


@dataclass(frozen=True, eq=False)
class SkyLight:
    """Unit vector (3,) towards the sun, radiance (3,) of sun and open sky on a surface, and a factor on the sky."""

    sun: Array
    sun_color: Array
    sky_color: Array
    sky_gain: float


def is_constant(params: LightParams) -> bool:
    """Whether the light never changes."""
    return params.clouds == 0.0 and (params.hour == 0.0 or params.hour_rate == 0.0)


def light_at(params: LightParams, seconds: float, seed: int) -> SkyLight:
    """Return the light after a time."""
    if params.hour == 0.0:
        azimuth, elevation = np.radians([params.sun_azimuth_deg, params.sun_elevation_deg])
        red, share = np.ones(3), 1.0
    else:
        azimuth, elevation = sun_angles(params.hour + params.hour_rate * seconds)
        red = np.exp(-HAZE * (_air(elevation) - _air(USUAL)))
        share = 0.35 + 0.65 * float(np.sin(elevation) / np.sin(USUAL))
    sun = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    cover = params.clouds * _cloud(seconds / params.cloud_period, seed) if params.clouds else 0.0
    return SkyLight(sun, SUN * red * (1.0 - cover), AMBIENT * share * (1.0 + 0.25 * cover), share * (1.0 - 0.2 * cover))


def sun_angles(hour: float) -> tuple[float, float]:
    """Return azimuth, counter-clockwise from the x axis (east), and elevation, rad, at a solar hour of the day."""
    turn = np.pi / 12.0 * (hour - 12.0)
    up = np.sin(LATITUDE) * np.sin(DECLINATION) + np.cos(LATITUDE) * np.cos(DECLINATION) * np.cos(turn)
    east = -np.cos(DECLINATION) * np.sin(turn)
    north = np.cos(LATITUDE) * np.sin(DECLINATION) - np.sin(LATITUDE) * np.cos(DECLINATION) * np.cos(turn)
    return float(np.arctan2(north, east)), max(float(np.arcsin(up)), LOWEST)


def _air(elevation: float) -> float:
    """Return the way through the air over that straight down (Kasten and Young 1989)."""
    return float(1.0 / (np.sin(elevation) + 0.50572 * (np.degrees(elevation) + 6.07995) ** -1.6364))


def _cloud(turns: float, seed: int) -> float:
    """Return how much of the sun is hidden, 0 to 1: a smooth function, mostly one or the other."""
    phases = np.random.default_rng([seed, 81]).uniform(0.0, 2 * np.pi, len(CLOUD_WAVES))
    wave = np.sum(np.sin(2 * np.pi * CLOUD_WAVES * turns + phases) / CLOUD_WAVES)
    return float(1.0 / (1.0 + np.exp(-4.0 * wave)))
