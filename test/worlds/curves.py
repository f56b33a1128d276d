"""Curves of taught drives as their files give them."""

import numpy as np

from path_follower.constants import SPACING
from path_follower.smoothing import Curve, TaughtDrive


def even_curve(x, y, yaw, speed):
    """Return a curve with a point every SPACING m, at least two."""
    curve = Curve(x, y, np.unwrap(yaw), speed)
    s = np.linspace(0.0, curve.length, max(2, round(curve.length / SPACING) + 1))
    return Curve(*(np.interp(s, curve.arc, values) for values in (curve.x, curve.y, curve.yaw, curve.speed)))


def straight_road(length, speed=1.0):
    """Return a drive along x."""
    x = np.linspace(0.0, length, round(10 * length) + 1)
    return TaughtDrive(Curve(x, 0 * x, 0 * x, 0 * x + speed))
