"""Numbers that drawn views and regions depend on, with unit, origin and the test that notices a change.

Tests are named below test/sphere_nav/view_synthesis/. What compiled code uses is beside it, in `kernels.py`.
"""

import numpy as np

from sphere_nav.geometry import Spherical

# The region around a sphere (test_region)
MAX_RESOLUTION_RATIO = 2.0  # of the drawing's to the sphere's, either way, that is usable
MIN_USABLE_SHARE = 0.2  # of what is usable at the sphere: both kinds of error were alike on towns 3, 5, 7 and 11
WINDOW = Spherical(96, 21, 96, 0.0, 13.5)  # of 40 degrees above and below the horizon, where cameras look
SKY = np.float32(1 / 300.0)  # 1/m: what is farther tells no position
NUM_DIRECTIONS = 6  # azimuths, of which most count
MAX_DOUBLINGS, NUM_BISECTIONS = 4, 3  # of the way in a direction, until it is too far; between both, then

# Drawing and blending (test_synthesis, test_surface, test_scene)
FAR_NEARNESS = np.float32(1e-6)  # 1/m, of what is so far that no motion moves it
SAME_SURFACE = np.float32(0.05), np.float32(0.005)  # of nearness, 1/m: drawings that differ by less show one surface
POLE_RAD = 0.35  # around each pole of a drawing on a whole sphere, that is drawn apart
MIN_KNOWN_NEIGHBORS = 5  # of 8 neighbours: holes that hold no more than a line of pixels are closed
NUM_BLENDED = 2  # key spheres, the best ones
# Limits of differences in nearness: as share of it, and for far surfaces in 1/m.
# Of neighbours on one surface from its slope: 2 m open less than 0.5 deg
BREAK = np.float32(0.03), np.float32(0.004)
FLAT = np.float32(0.003), np.float32(5e-4)  # of a pixel of a large quad from its plane: half a pixel after 2 m
PER_TURN = 256  # of the largest quads: their planes bend from the sphere by less than 1e-4 rad
