"""A room with boxes along its walls that come and go, as parked cars do: grey level and range in closed form."""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import SE3, Pinhole, Spherical
from worlds.room import Room, optical

SPHERE, CAMERA = Spherical(768, 384), Pinhole(240, 180, 165.0, 165.0, 119.5, 89.5)
TRUTH = optical(SE3.from_planar(-1.7, 0.1, 0.05))  # where images are taken


def boxes_along(seed, places, height=2.1):
    """Return boxes that begin at `places` (x, m) along both long walls of a room 6 m wide, 3 m high."""
    left = [((x, -2.9, -1.5), (x + 1.0, -1.3, height - 1.5), seed + i) for i, x in enumerate(places)]
    return left + [((x + 0.3, 1.3, -1.5), (x + 1.3, 2.9, height - 1.5), seed + 50 + i) for i, x in enumerate(places)]


class ParkingRoom(Room):
    """A room in which boxes stand, each (low, high, seed): opposite corners in m, and what is painted on it."""

    def __init__(self, *args, boxes=(), **values) -> None:
        super().__init__(*args, **values)
        self.boxes = [(np.array(low, float), np.array(high, float), seed) for low, high, seed in boxes]

    def cast(self, origin, rays):
        """Return grey level and range (m) of unit rays (..., 3) from a point beside the boxes."""
        gray, range_m = super().cast(origin, rays)
        for low, high, seed in self.boxes:
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.stack([(low - origin) / rays, (high - origin) / rays])
            near, far = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
            is_hit = (near > 0.0) & (near < far) & (near < range_m)
            gray[is_hit] = self.gray((origin + rays[is_hit] * near[is_hit][:, None]) + 10.0 * seed)
            range_m[is_hit] = near[is_hit]
        return gray, range_m


def parked(seed=1, places=(0.0, 2.0, 4.0)):
    """Return a long room with boxes along its walls; by default those of the day that is mapped."""
    boxes = boxes_along(seed, places, height=1.8)
    return ParkingRoom((8.0, 3.0, 1.5), (1.0, 40.0, 40), gain=30.0, boxes=boxes)


def other_day():
    """Return the room on another day: others, elsewhere."""
    return parked(7, (-0.7, 1.2, 3.2))
