"""Numbers that spheres and what is found by them depend on, with unit, origin and the test that notices a change.

Tests are named below test/sphere_nav/spheres/. What a recorded map is made of stands with its format.
"""

import numpy as np

# A motion measured both ways (spheres/test_range_alignment, graph/test_both_ways)
MAX_GAP, MAX_GAP_SHARE = (0.05, 0.02), 0.02  # m, rad between both results; share of their distance
EDGE_SHARE = 0.005  # standard deviation by the distance between the spheres: ranges and calibration err

# Ranges against ranges (spheres/test_range_alignment)
NUM_RANGE_POINTS = 3000  # of a coarse sphere
RANGE_GATES = ((0.3, 4), (0.1, 2), (0.04, 1))  # difference of range at which a point counts; every which point
RANGE_STEPS, MIN_RANGE_STEP = 10, 3e-4  # iterations of each gate at most; m and rad, of the last
MIN_RANGE_POINTS = 50  # in an alignment
RANGE_NOISE = (0.003, 0.004)  # m, by the range: standard deviation of ranges, at least
MAX_NORMAL_ANGLE = 1.2  # rad between a surface and the view of it, or two views of it
MIN_RANGE_OVERLAP = 0.3  # share of the points that must fall on known ranges
MIN_FACING_SHARE = 0.08  # of the points seen, that face along one axis, for these to be judged by themselves
MIN_COARSE_AGREEMENT = 0.4  # the same on the way: below it, and there is no use in going on
MIN_RANGE_AGREEMENT = 0.75  # share of these that must lie there, within the last gate
MAX_RANGE_SIGMA = 0.01  # m: largest standard deviation of a motion, were errors independent: all six directions held
RANGE_EDGE_FLOOR = (0.005, 0.002)  # standard deviations that no motion by ranges falls below; neighbours err alike
RANGE_TURN_SHARE = 0.05  # deviation by the turn: a depth camera's lens is known to a few percent, and bends space

# Features of a sphere or image (appearance/test_features)
MAX_FEATURES = 500  # the strongest of an image
MAX_WHOLE, MAX_PARTIAL = 82.0, 130.0  # px per radian of a whole sphere and of other images; SIFT doubles them
FINE_FACTOR = 3.0  # times as many in images taken shortly after each other: what is seen again from nearby is finer
MIN_FEATURE_SIDE = 64  # px that an image keeps
FEATURE_SEAM = 64  # px by which a whole sphere is continued on either side
MAX_ELEVATION = np.radians(60.0)  # nearer to the poles a sphere is drawn too wide, and nothing tells headings apart
CONTRAST = 0.02  # of SIFT, half of OpenCV's: walls in the shade count, too

# Words and what is alike (appearance/test_features, appearance/test_index)
MIN_WORD_COSINE = 0.86  # of a descriptor with its word
MAX_WORDS = 8192  # then every descriptor takes the word most like it: the cost of a look-up is bounded
NUM_TURN_BINS = 36  # turns of 10 degrees
TURN_WINDOW = 3  # neighbouring turns that count as one: what is near moves as the viewpoint does
MAX_RISE = np.radians(20.0)  # between two views of one feature; a sphere is upright within less
MAX_REPEATS = 4  # of a word in one image; a fence says nothing

# A pose by features (appearance/test_pose)
MAX_MATCH_RATIO = 0.85  # of the distances to the best and to the second best descriptor (Lowe 2004)
NUM_POSE_TRIALS = 150  # of three features each
MAX_RAY_ANGLE = np.radians(1.0)  # between a ray and its point
NUM_POSE_REFINEMENTS = 6  # of the best one, by all that agree with it
MIN_FORWARD = 0.1  # of the three rays along their mean: P3P needs them before a plane

# Small spheres (test_sphere)
MIN_COARSE_SIDE = 96  # px; 1024 rows become 128
SURFACE_RATIO = 1.1  # ranges within this ratio of the nearest in a block are one surface

# Experiences of a place (test_experiences)
PLACE_REACH = 0.5  # of the radius of a region: key spheres so near each other are of one place
PLACE_TURN = 0.6  # rad between views of one place, where spheres do not see in every direction
FADING = 0.5  # weight of what a key sphere explained in earlier drives, with each later one of its light

# Headings at which an image looks as in a sphere, in any light (appearance/test_headings)
GRID_WIDTH = 256  # columns of the grid: 1.4 degrees
CELL_SIDE = 10  # of the grid: 14 degrees; headings nearer to each other are one
CELL_REACH = (4, 2)  # columns and rows by which a cell may lie beside its place: the viewpoint differs
SOFT_GRADIENT = 2.0  # grey levels over two columns, at which a gradient counts half
STRONG_SHARE = 0.5  # of the gradients of a view, the strongest, that are compared
MIN_CELL_EDGES = 8  # of a cell, to be asked
