"""The numbers that spheres depend on and nobody would set: unit, origin, and the tests that pin each group.

Tests are named below test/sphere_mapping/acquisition/. "Chosen" means: by the test named, on simulated drives, where no
other origin is given. What compiled code uses is in `kernels.py`; numbers of coefficients stand with their polynomials.
"""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import Spherical

# Everywhere
VERY_FAR_M = 1e6  # taken for a direction's point where no range is: parallax vanishes (stitching/test_layouts)
GRID_STEP = 8  # px between the entries of tables that are interpolated (light/test_light, stitching/test_stitcher)
VIEW_GRID = Spherical(128, 64)  # directions in which the views of two cameras are compared (range/test_sweep_tables)
MIN_SHARED_VIEW = 0.03  # of all directions, seen by both cameras of a pair (range/test_sweep_tables, test_lens_check)
MAX_RATIO = 0.75  # distance of a match over that of the second best: Lowe 2004 has 0.8 (range/test_rectification)
# Below it, centers are one (stitching/test_layouts)
MIN_BASELINE_M = {"levels": 0.01, "side": 0.02, "stereo": 1e-3}

# Exposures and colors (light/test_light)
EXPOSED = (10, 245)  # grey levels between which cameras are compared
WHITE = 235  # grey level above which what is darkened rises to 255 again: nobody knows how bright it was
MAX_GAIN = 3.0  # largest factor of an exposure over the mean of all
MAX_WHITE_BALANCE = 1.15  # largest factor of a color over the mean of its camera's colors
NUM_INSTANTS = 8  # that the falloff is estimated from
HIGHLIGHTS = (99.0, 250.0)  # percentile of an image, and the grey level up to which a gain may raise it
MIN_FALLOFF = 0.01  # below which an image is left as it is

# Falloff of lenses, Goldman 2010 (light/test_light); deviations before anything is seen
FALLOFF_STD = 0.4  # of a coefficient: a lens keeps a third of the light at its rim, seldom less
LIKE_STD = 0.05  # of the difference of a coefficient of two lenses of one kind
LEAST_COEFFICIENT = -2.0  # of the polynomial: no lens loses more light
EXPOSURE_STD = 1.0  # of an exposure's logarithm
LEVEL_STD = 2.5  # grey levels, of a level: what is dark says little of a ratio
RATIO_STD = 0.05  # of the logarithm of a ratio: parallax, reflections
CORRELATED_DIRECTIONS = 10.0  # neighbors that count as one (`estimation/least_squares.py`)
LOSS_SCALES = np.geomspace(20.0, 2.0, 8)  # deviations, step by step: at first half of what is seen may disagree

# What cameras see in common (stitching/test_overlaps)
OVERLAP_GRID = Spherical(512, 256)  # directions that are compared
OVERLAP_CELL = 0.012  # rad, side of compared pixels, as far apart as the directions: noise and parallax matter less
OVERLAP_FROM_BORDER = 0.03  # rad from the border of both cameras
MIN_SHARED, MAX_SHARED = 30, 600  # directions from which on two cameras are compared; evenly chosen of more
DETAIL_WINDOW = 7  # directions, side of the neighborhood whose detail is compared
MIN_CORRELATION = 0.8  # of that detail
FAINT_DETAIL, FLAT_DETAIL = 0.01, 0.04  # deviation of log levels: below, nothing is correlated; there is no detail

# Seams (stitching/test_strips)
NUM_BANDS = 4  # of the Laplacian pyramid, Burt and Adelson 1983: the coarsest blends over 32 px
CAP_ROWS = 128  # next to a pole, where seams spread over many columns, make strips of their own
ALONE = 0.999  # share above which a view has a pixel to itself

# Partial spheres (partial/test_partial_sphere, partial/test_window)
WINDOW_LEVELS = 5  # of pyramids, that the sides of a window are aligned to
OUTLINE_RAYS = 64  # a side, from which the outline of the view is found
MIN_BLIND_ARC = np.radians(20.0)  # a view whose largest gap in azimuth is smaller is stored as a whole sphere
LEVEL_RAD = 0.1  # a camera that leans less is upright: its spheres have its own axes
MAX_STEEP_RAD = np.radians(70.0)  # rays of a view above the horizon of its sphere: there the image is stretched by 3
MIN_RANGE_M = 0.1  # what is nearer is not trusted
MAX_MAGNIFICATION, MAX_SUPERSAMPLING = 1.5, 4  # beyond it an image is sampled more finely and averaged; at most
WITHOUT_RANGE_M = 1e3  # taken for color where no range is known at all
MAX_DEPTH_STEP = 0.04  # relative step of depth between neighbors that is an edge
MAX_CORRECTION = 0.01  # relative, of the last step; more is a surface that this direction does not see

# Depth of another camera (partial/test_depth_registration)
DEPTH_CORRECTIONS = 2  # after the warp, which is good to a pixel; the last one only confirms
MAX_SURFACE_STEP = 0.05  # relative difference of neighbors beyond which they are two surfaces

# Semi-global matching, Hirschmueller 2008 (range/test_semi_global)
BLOCK_SIZE = 5  # px, side of the matched block
SGBM = {
    "blockSize": BLOCK_SIZE,
    "P1": 8 * BLOCK_SIZE**2,  # of a step of disparity by 1; both as OpenCV recommends
    "P2": 32 * BLOCK_SIZE**2,  # of a larger one
    "disp12MaxDiff": 1,  # px, disagreement allowed between both directions
    "preFilterCap": 31,
    "uniquenessRatio": 5,  # %, margin of the best smoothed cost over the second
    "speckleWindowSize": 60,  # px: smaller islands of disparity, separated by larger steps, are removed
    "speckleRange": 2,
}
SEAM_COLUMNS = 32  # beyond the seam that the matcher sees, so that it knows no seam
NUM_STRIPS = 2  # of a whole sphere, whatever the number of threads, so that the result does not depend on it
STRIP_COLUMNS = 64  # whose costs are in memory at a time
COST_RADIUS = 4  # px, half side of the block whose cost is compared over all disparities
MIN_COST_RATIO = 1.2  # of the least cost elsewhere to that of the match

# Levels of a matching (range/test_matching, range/test_levels)
MAX_WIDTH = 1280  # columns, of the whole sphere, up to which images are matched as they are; wider ones are halved
MIN_SIDE = 64  # px, of the coarsest level
NUM_SCALES = 3  # levels that are matched at least
BEYOND_PX = 3  # disparities this near to the largest of a level are left to the next coarser one
LEAST_NOISE = 0.7  # grey levels, of a halved image: rounding and interpolation
EDGE_PX = 3  # matches this near to a jump are not trusted
JUMP = (0.6, 0.1)  # px, and by the disparity: least step over that neighborhood that is a jump
UNKNOWN_SIDE, FROM_UNKNOWN = 7, 2  # px: side of an unknown region that counts, and how far one keeps off it
UNKNOWN_PX = 1e4  # stands for an unknown disparity where the largest or least is looked for

# Alignment of small blocks after it (range/test_matching)
REFINE_RADIUS = 3  # px, half side of the blocks
REFINE_STEPS, STEPS_AGAIN = 2, 1  # how often; where a coarser level has aligned them before
STEP_LIMIT, MAX_REFINEMENT = 0.5, 1.6  # px: of one step; a block that goes farther from its match is not trusted
MATCH_PX = 0.3  # standard deviation of a match: holds the refinement where there is little texture
MIN_BLOCK_SHARE = 0.2  # of a block's pixels must have a match
MAX_RESIDUAL = 1.0  # grey-level variance left in a block, by that of noise and contrast
STD_FACTOR = 1.3  # errors of neighbors are not independent: of the deviation that the residual alone gives
UNEVEN_SHARE = 1 / 3  # of what disparity varies by over a block: three deviations of a pixel reach all of it
SMOOTH = np.array([1.0, 0.03], np.float32)  # px, and by the disparity: neighbors that differ more are not averaged
# (range/test_levels)
OWN_RADIUS = 2  # px at half of the finest level, half side of the block in which a pixel has its own surface
OWN_LEVELS = 10.0  # grey levels that pixels of one surface differ by at most
OWN_FLOOR = 1.0  # grey levels^4, of the product of both images' squared steps: nothing beside nothing is no likeness
MIN_OWN_LIKENESS = 0.5  # correlation of the steps of that surface; chosen in town 61 and room 1 of `range_classes`
BORROWED_PX, AROUND_BORROWED = 3, 2  # side of a region below it that counts; px around it that are not trusted, alike

# Range from disparity (range/test_vertical)
FAR_M = 120.0  # what is surely farther is known to be far
MIN_RANGE_SHARE = 0.9  # of the nearest range wanted: what is nearer is not trusted
MAX_SINE = 0.9  # of the largest disparity
BELOW_ZERO_DEG = 0.7  # disparities searched below 0, for what calibration leaves
EXCHANGED = (0.08, 3.0)  # share of pixels that match exchanged, and by that as given: they are (test_semi_global)
ORDER_COLUMNS = 320  # px, at which the order is looked at

# Sweep on the sphere, chosen in towns 61 and 62 and rooms 1 and 2 of `range_classes` (range/test_sweep)
MAX_SWEEP_WIDTH = 640  # columns up to which all hypotheses are compared; wider spheres are halved
SWEEP_RADIUS = 2  # px, half side of the blocks that are smoothed; that of those that are compared is COST_RADIUS
SWEEP_PENALTIES = (60, 600)  # of a step to the next hypothesis, to any other, in eighths of a grey level of a block
SWEEP_COST_RATIO = 1.08  # of the least cost elsewhere to that of the match
SWEEP_FLOOR = 10  # eighths of a grey level added to each difference, so that noise decides nothing
MIN_SWEEP_MARGIN = 1.04  # of the second smoothed cost to the least
MISALIGNED = 0.3  # px^2 that cameras may be misaligned by, beside the noise, where they are compared at the end
MAX_UNLIKE = 30.0  # of what they differ by, to the median of all pixels measured; by 1 + the spread of range there
SPREAD_RADIUS = 4  # px at half of the finest level, within which that spread is taken
COARSE_STEPS = 2  # of alignment at the coarsest level; finer ones start near enough for one
MAX_ROW_STEP = 3  # between the rows that finer levels sample: blocks of neighboring rows tell nearly the same
SWEEP_STEP_PX, START_STD_PX = 0.7, 3.0  # most of one step; standard deviation of where it starts
MIN_SAMPLED_SHARE = 0.4  # of a block's samples must have a range and be seen by two cameras
DEPENDENT_SHARE = 0.1  # of what noise does not explain: common to a block, so that no number of pixels averages it
SMOOTH_BETWEEN, SMOOTH_LAST = 4, 5  # px, half side of what is averaged between levels, and at the end
LEVEL_BLUR_PX = 0.6  # of full-size images: linear interpolation of sharper ones is biased to whole pixels
# (range/test_sweep_tables)
MAX_VIEWS, FAINT_STRETCH = 4, 1.55  # cameras that see a direction; more stretched than this they count if needed
SIGHT_M = 2.0  # range from which on a camera must see what it sees of a direction
ERODED_PX = 2  # kept off borders and masks, at each level
TABLE_SIDE, MAX_HALF_TANGENT = 513, 4.0  # entries of a lens's table a side; tangent of half the angle off the axis
HYPOTHESIS_PX = (0.7, 1.25)  # least and largest step of hypotheses, px of the coarsest level between neighbors

# Fusion (range/test_fusion)
PATCH_PX = 3  # side of the patch that a LiDAR's point covers
STEEP = 0.1  # depth by range, of an RGB-D camera: less is 84 degrees off its axis (stitching/test_stitcher)
AGREEMENT_SIGMAS = 3.0  # sources that differ by more do not see the same: 1 in 370 by chance
CONTRADICTION = (3.0, 0.05)  # times the least deviation, share of range: so sure a source, so far off: unknown
MIN_KNOWN = 0.005  # share with range below which it moves nothing: what is known is right, but far from the most

# Lenses of the images (range/test_lens_check)
INFO_TOLERANCE, MAX_RAYS_DEG = 1e-3, 1.0  # of a focal length, relative; median between rays of one lens's calibrations
RAY_GRID = 12  # pixels a side at which rays are compared
LENS_SIDE, LENS_FEATURES = 800, 1500  # px of the images in which features are found; of a camera
FIT_DEG = 0.75  # of a match from where the other camera may see the same point
CLOSENESS = np.linspace(0.0, 2.0, 48)  # 1/m, places along the ray of a feature
MIN_LENS_MATCHES = 40  # of all cameras, below which nothing is said
OTHER_LENS = (0.4, 1.4)  # share of matches that fit another lens, and by those that fit the rig file: it is that one
OTHER_CAMERAS = (100, 0.3)  # matches of which no larger share fits the rig file: the images are of other cameras
OTHER_DISTORTIONS = {"pinhole": (-0.3, -0.15, 0.0, 0.1), "fisheye": (-0.1, -0.05, -0.02, 0.0, 0.02, 0.05)}  # first ones

# A rig corrected by its images, M15 section 4.3.1 (range/test_rectification)
POLE_DEG = 35.0  # features nearer to a pole of the sphere are drawn too wide to be compared
RECTIFY_SCALES_DEG = (1.0, 0.4, 0.15, 0.06)  # the loss is narrowed: at first half may be wrong matches
RECTIFY_SIFT = {"nfeatures": 5000, "contrastThreshold": 0.015}  # of a camera
MAX_PARALLAX_DEG = 12.0  # largest angle between the directions of a match
FROM_BORDER_DEG = 1.0  # features nearer to the border of an image are left out
CLOUD_REACH_DEG = 0.4  # a LiDAR's point this near to a feature tells its range
MIN_PAIR_MATCHES = 15  # below which a pair of cameras says nothing
TURN_STD = np.radians(0.3)  # of a camera's turn about each axis: what a mount gives way
LENS_STD = (0.003, 0.005, 0.005)  # of the logarithm of the focal length, of the principal point by the focal length
NEAR_EPIPOLE = 0.2  # sine of the angle to the baseline below which a match counts less
RANGE_SHARE = 0.1  # of a range: its deviation, a LiDAR's point not being quite where the feature is

# Rectified pairs (stereo/test_stereo, stereo/test_stereo_pair)
BELOW_ZERO_PX, MIN_DISPARITY_PX = 1.0, 1.0  # searched below 0, for what rectification leaves; trusted from there on
MAX_WIDTH_SHARE = 0.5  # of the image: larger disparities are not looked for
NUM_PAIRS = 10  # whose rows are compared
MAX_TURN_DEG = 45.0  # between the cameras' axes, and between them and the axis of the pair
FROM_BORDER_PX = 3  # nearer to the border of the left image nothing is measured
FAR_WORSE = 1.5  # by which rows agree worse as told than as they are: the images are rectified already

# Rows of a pair (stereo/test_stereo_field)
CORNERS = {"maxCorners": 1200, "qualityLevel": 0.003, "minDistance": 7}  # px
FLOW = {"winSize": (9, 9), "maxLevel": 5, "criteria": (3, 40, 0.001)}  # px (count and size)
BACK_PX = 0.3  # a corner that is not found back this near is lost
MAX_ROWS_APART = 12.0  # px; more is a wrong match
MIN_CORNERS = 60  # of all instants, below which rows are left as they are
ROW_STEPS, ROW_LOSS_PX = 12, 0.3  # of the fit; scale of Cauchy's loss
ROW_FLOOR_PX = 0.03  # standard deviation that no number of corners lowers: patches see more than one row
ROW_PRIOR_PX = 10.0  # standard deviation of each coefficient before anything is seen
ROW_SIGMAS = 4.0  # from which on a correction is made: 6e-5 by chance

# Disparities of a pair, by a drive (stereo/test_corner_tracks, stereo/test_track_fit)
MIN_VIEWS, NUM_VIEWS = 2, 4  # instants that a corner is followed through, as far as it is seen
NEAR_DISPARITY_PX, MAX_OFF_ROW_PX = 2.0, 1.5  # of a corner: least disparity, and distance of its rows
MIN_TRACKS = 40  # in an instant of a window
HALF_PATCH_PX = 4  # of a patch's side
PATCH_STEPS, LAST_STEP_PX = 12, 0.003  # at most; the last one
MAX_SHIFT_PX, MAX_SLOPE = 1.5, 0.7  # from the start, farther away is another thing; disparity by pixels
LEAST_TEXTURE = 1e-2  # squared grey levels by px, added so that bare patches do not move
TRACK_STEPS, TRACK_LOSS_PX = 15, 0.15  # of the fit; scale of Cauchy's loss on a corner's pixels
TRACK_PRIOR_PX = 3.0  # standard deviation of each number before anything is seen
CORRELATED_CORNERS = 9.0  # of one window, that count as one (`estimation/least_squares.py`)
TRACK_FLOOR_PX = np.array([0.02, *[0.04] * 7])  # (8,): no number of corners lowers it: not all patches are planes

# A LiDAR's clouds, and what is said of a rig (range/test_fusion, ros/test_rig_intake, ros/test_node)
FEATURE_WIDTH = 2048  # px, of the sphere in which features are found (range/test_rectification)
CLOUD_STD_M = 0.03  # standard deviation of its range
MAX_CLOUD_AGE_S = 0.06  # between a cloud and an instant that it serves: somewhat more than half a period of 10 Hz
WARN_DEG = 0.5  # turn of a camera against the rig file that is warned of
