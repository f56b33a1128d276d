"""Curves of taught drives as their files give them."""

import numpy as np

from path_follower.constants import SPACING
from path_follower.routes.network import EdgeCurve


def even_curve(x, y, yaw, speed):
    """Return a curve with a point every SPACING m, at least two."""
    curve = EdgeCurve(x, y, np.unwrap(yaw), speed)
    s = np.linspace(0.0, curve.length, max(2, round(curve.length / SPACING) + 1))
    return EdgeCurve(*(np.interp(s, curve.arc, values) for values in (curve.x, curve.y, curve.yaw, curve.speed)))
