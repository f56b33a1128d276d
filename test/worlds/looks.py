"""Two references in a room, and what an image of one camera among them tells."""

from __future__ import annotations

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.photometric import View, prepare_reference
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.structure import find_rig_structure
from worlds.room import Room

SPHERE = Spherical(512, 256)
PLACES = (SE3.identity(), SE3.exp([0.3, 0.0, 0.1, 0.0, 0.0, 0.0]))
SOMEWHERE = SE3.exp([0.1, -0.05, 0.2, 0.02, 0.3, 0.01])


def soft_room(seed: int) -> Room:
    """Return a room without fine texture."""
    return Room((4.0, 3.0, 2.0), (1.0, 14.0, 30), gain=30.0, seed=seed)


def views_of(room, params, sphere=SPHERE, places=PLACES):
    """Return references of what spheres saw at the places."""
    return [View(prepare_reference(*room.render(sphere, T), sphere, params), T) for T in places]


def structure_of(pyramid, views, *rest):
    """Check the images of one camera."""
    return find_rig_structure([RigImage(pyramid, views=tuple(views))], *rest)
