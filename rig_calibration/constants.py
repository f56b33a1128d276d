"""The numbers that results depend on and nobody would set: unit, origin, and the test that pins each group.

Tests are named below test/rig_calibration/. "Chosen" means: by the test named, on rendered boards and drives, where no
other origin is given. What the layout of parameter vectors says stands with it.
"""

from __future__ import annotations

import numpy as np

# Corners in an image (boards/test_chessboard, test_charuco)
HALVED_FROM = 600  # rows and columns from which on several boards are looked for at half size
AROUND = 1.25  # a board is wiped out with this much around its inner corners before the next one is looked for
MIN_CORNERS = 4  # of a ChArUco board: as many as a homography needs
HALF_WINDOW = (2, 7)  # px, least and most, in which a corner is refined
REFINEMENT = (3, 50, 1e-3)  # of a corner by OpenCV: at most so many steps, or (1 + 2) until one is below so many px
BLUR_PX = 0.5  # an edge that lies this far inside a window does not bend the corner
MIN_SPACING_PX = 4.0  # below it neighbours blur into each other

# Start of one camera (test_calibrate, boards/test_bundle): pixels per radian on its axis by the image's width
FOCAL_LENGTHS = {"pinhole": np.geomspace(0.25, 4.0, 15)}
FOCAL_LENGTHS |= dict.fromkeys(("fisheye", "omni"), np.geomspace(0.12, 1.2, 13))
MIN_AHEAD = 0.1  # cosine to the middle ray of a board, from which on a ray says where it is

# Joining cameras and boards (boards/test_assembly)
MIN_HAND_EYE = 4  # instants
LOST = 0.1  # rad, or part of the distance, from which on a board is somewhere else: one such outvotes nobody
MAX_CANDIDATES = 400  # that are tried as the pose of a camera or board

# Bundle adjustment and false corners (boards/test_bundle, test_rejection)
FIRST_DAMPING, MAX_DAMPING = 1e-4, 1e10
MIN_GAIN = 1e-10  # part of the cost that a step must gain to go on
MAX_ROUNDS = 8  # of leaving corners out
NUM_DISTORTION = 5  # coefficients of a pinhole, as OpenCV's usual ones
MIN_SEEN, MIN_VIEWS = 8, 4  # corners that a view must have; such views of a camera
CORNER_LIMIT, MIN_RESIDUAL_PX = 5.0, 0.1  # deviations beyond which a corner is left out, but none below so many px
VIEW_RATIO = 4.0  # of the median residual of a view to that of its camera, beyond which it is left out
HELD_OUT_EVERY = 4  # every how many instants one is held out to judge by (boards/test_report)
MIN_FITTING = 0.5  # of its corners that must fit for a view to count at all
FLOOR_RATIO = 3.0  # a view is left out from this multiple of MIN_RESIDUAL_PX on, whatever the others are like

# What the images do not tell (boards/test_observability, test_quality, test_report)
OPEN_EIGENVALUE = 1e-11  # of the information scaled to a diagonal of one
OPEN_SHARE = 1e-3  # of a parameter in an open direction that makes it open itself
MAX_POSITION_STD_M, MAX_ROTATION_STD_DEG = 0.005, 0.1  # of a camera's pose: beyond, it is worth a warning
OPEN_FACTOR = 10.0  # an axis this much worse than the warning's limit is called unobservable

# Whether images are good (boards/test_quality, test_detect; chosen on five drawn sets of each flaw)
SAMPLED_PX2 = 0.45  # variance in px^2 that samples of whole pixels add to that of an edge (boards/test_detect)
MAX_BLUR_SHARE = 0.00135  # of the image's width, not below 1.35 px: a sharp lens has 0.4 to 0.9 px
MIN_GOOD_VIEWS = 10  # instants of a camera: 40 are advised
MIN_TILT_DEG = 6.0  # RMS of the boards' tilt: 20 deg to all sides are advised
MIN_COVERED = 0.4  # of the cells of an image, and of each half of it: else there the lens is a guess
MAX_HALVES_MM, MAX_HALVES_DEG, MAX_HALVES_FOCAL = 5.0, 0.3, 0.01  # between halves of the images

# Refinement by a drive (drive/test_refinement)
UNOBSERVED = 0.5  # of the deviation known beforehand: more is left than the drive has told
MIN_PIXELS, MIN_SIGMA = 100, 0.5  # of an image, to say anything; grey levels of their noise
NUM_LENS_PIXELS, NUM_LENS_LEVELS = 3_000, 3  # of each level, the most salient
LENS_STEPS, MIN_LENS_STEP = 12, 0.02  # at a level; in standard deviations, below which a level is done
FOCAL_SHARE, CENTER_SHARE, READOUT_S = 0.1, 0.05, 0.02  # deviations before: of focal length and image width; s
DISTORTION = {"pinhole": (0.3, 0.3, 0.01, 0.01), "fisheye": (0.1, 0.1, 0.1, 0.1)}  # the same
MAP_LENS = (0.03, 0.03, 0.02, 0.02, 0.05, 0.05)  # deviations before of the map's own lens: f, centre / f, k1, k2
MAX_TANGENT = 1.5  # of a ray to the axis of the map's lens, up to which its error grows
SMALL = 1e-3  # of a deviation before, or m and rad: by which a parameter moves for a derivative
SAME_ROW = 1e-3  # rows by which a pixel and the instant of its row may differ: sampling errs by more
HELD = 1e-6  # of those: of a parameter that stays as it was known, in a lens and in a mounting
LENS_FLOOR = 5e-3  # of those: what sampling of image and map leaves however many images there are

# What proves a refined lens (drive/test_proof)
NUM_RUNS = 5  # of consecutive images in a half of the drive: neighbours err alike, runs hardly
MIN_HALF = 3  # images of a half
MIN_OWN_STEP = 1e-3  # part of the cost, the last gain of pose and light of an image under a given lens
APART = 0.5  # of how far both halves are off the given lens: as far may they be from each other; chance gives 2
LENS_GRID = (9, 7)  # pixels at which two lenses are compared
SIGMAS = 3.0  # that a standard deviation is to hold for, as it does of a normal error

# Mounting by odometry (drive/test_mounting): x y z roll pitch yaw in m and rad, scales of ways and turns
PIECE_M, PIECE_RAD = 1.0, 0.3  # driven or turned, whichever comes first
MIN_PIECES = 8  # of which the scatter is a covariance
MOUNTING_SIGMA = np.repeat([1.0, 0.5, 0.05], [3, 3, 2])  # (8,) standard deviations before anything is seen
MOUNTING_UNOBSERVED = np.repeat([0.1, 0.05, 0.02], [3, 3, 2])  # (8,) those that are not worth the name
MOUNTING_STEPS, SETTLED = 50, 1e-7  # at most; in standard deviations, the last one
DIFFERENCE = 1e-6  # of numerical derivatives
