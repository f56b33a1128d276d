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
EXPOSED = (10, 245)  # grey levels between which cameras are compared; how bright is what is brighter nobody knows
MAX_GAIN = 3.0  # largest factor of an exposure over the mean of all
MAX_WHITE_BALANCE = 1.15  # largest factor of a color over the mean of its camera's colors
NUM_INSTANTS = 8  # that the falloff is estimated from, or the rows of a pair (stereo/test_stereo_pair)
HIGHLIGHTS = (99.0, 250.0)  # percentile of an image, and the grey level up to which a gain may raise it
MIN_FALLOFF = 0.01  # below which an image is left as it is

# Falloff of lenses, Goldman 2010 (light/test_light); deviations before anything is seen
FALLOFF_STD = 0.4  # of a coefficient: a lens keeps a third of the light at its rim, seldom less
EXPOSURE_STD = 1.0  # of an exposure's logarithm
RATIO_STD = 0.05  # of the logarithm of a ratio: parallax, reflections
NUM_CORRELATED = 10.0  # neighbors, or corners, that count as one (`estimation/least_squares.py`; stereo/test_track_fit)
LOSS_SCALES = (20.0, 2.0, 2.0, 2.0)  # deviations, step by step: at first half of what is seen may disagree

# What cameras see in common (light/test_light)
OVERLAP_GRID = Spherical(512, 256)  # directions that are compared
MAX_SHARED = 600  # of them, of two cameras; evenly chosen of more
OVERLAP_CELL = 0.012  # rad, side of compared pixels, as far apart as the directions: noise and parallax matter less

# Seams (stitching/test_strips)
NUM_BANDS = 4  # of the Laplacian pyramid, Burt and Adelson 1983: the coarsest blends over 32 px
CAP_ROWS = 128  # next to a pole, where seams spread over many columns, make strips of their own
ALONE = 0.999  # share above which a view has a pixel to itself

# Partial spheres (partial/test_partial_sphere, partial/test_window)
WINDOW_LEVELS = 5  # of pyramids, that the sides of a window are aligned to
OUTLINE_RAYS = 64  # a side, by which a view is known: its outline, and what two calibrations say of it
MIN_BLIND_ARC = np.radians(20.0)  # a view whose largest gap in azimuth is smaller is stored as a whole sphere
LEVEL_RAD = 0.1  # a camera that leans less is upright: its spheres have its own axes
MAX_STEEP_RAD = np.radians(70.0)  # rays of a view above the horizon of its sphere: there the image is stretched by 3
MIN_RANGE_M = 0.1  # what is nearer is not trusted
MAX_MAGNIFICATION = 1.5  # beyond it an image is sampled more finely and averaged
MAX_DEPTH_STEP = 0.04  # relative step of depth between neighbors that is an edge (partial/test_depth_registration)
MAX_CORRECTION = 0.01  # relative, of the last step; more is a surface that this direction does not see

# Depth of another camera (partial/test_depth_registration)
DEPTH_CORRECTIONS = 2  # after the warp, which is good to a pixel; the last one only confirms

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
COST_RADIUS = 4  # px, half side of the block whose cost is compared over all disparities, and within which they spread

# Levels of a matching (range/test_matching, range/test_levels)
MAX_WIDTH = 1280  # columns, of the whole sphere, up to which images are matched as they are; wider ones are halved
MIN_SIDE = 64  # px, of the coarsest level
NUM_SCALES = 3  # levels that are matched at least
BEYOND_PX = 3  # disparities this near to the largest of a level are left to the next coarser one
LEAST_NOISE = 0.7  # grey levels, of a halved image: rounding and interpolation
JUMP = (0.6, 0.1)  # px, and by the disparity: least step over that neighborhood that is a jump
UNKNOWN_SIDE = 7  # px, side of an unknown region that counts
UNKNOWN_PX = 1e4  # stands for an unknown disparity where the largest or least is looked for

# Alignment of small blocks after it (range/test_matching)
REFINE_RADIUS = 3  # px, half side of the blocks; matches this near to a jump are not trusted
REFINE_STEPS = 2  # how often; once where a coarser level has aligned them before (range/test_sweep, too)
STEP_LIMIT, MAX_REFINEMENT = 0.5, 1.6  # px: of one step; a block that goes farther from where it starts is not trusted
MATCH_PX = 0.3  # standard deviation of a match: holds the refinement where there is little texture
MIN_BLOCK_SHARE = 0.2  # of a block's pixels must have a match, or a range and be seen by two cameras
MAX_RESIDUAL = 1.0  # grey-level variance left in a block, by that of noise and contrast
UNEVEN_SHARE = 1 / 3  # of what disparity varies by over a block: three deviations of a pixel reach all of it
SMOOTH = np.array([1.0, 0.03], np.float32)  # px, and by the disparity: neighbors that differ more are not averaged
# (range/test_levels)
OWN_RADIUS = 2  # px at half of the finest level, half side of the block in which a pixel has its own surface
OWN_LEVELS = 10.0  # grey levels that pixels of one surface differ by at most
OWN_FLOOR = 1.0  # grey levels^4, of the product of both images' squared steps: nothing beside nothing is no likeness
MIN_OWN_LIKENESS = 0.5  # correlation of the steps of that surface; chosen in town 61 and room 1 of `range_classes`
BORROWED_PX = 3  # side of a region below it that counts, with what is around it

# Range from disparity (range/test_vertical)
FAR_M = 120.0  # what is surely farther is known to be far
MIN_RANGE_SHARE = 0.9  # of the nearest range wanted: what is nearer is not trusted
EXCHANGED = (0.08, 3.0)  # share of pixels that match exchanged, and by that as given: they are (test_semi_global)
ORDER_COLUMNS = 320  # px, at which the order is looked at

# Sweep on the sphere, chosen in towns 61 and 62 and rooms 1 and 2 of `range_classes` (range/test_sweep)
MAX_SWEEP_WIDTH = 640  # columns up to which all hypotheses are compared; wider spheres are halved
SWEEP_RADIUS = 2  # px, half side of the blocks that are smoothed; that of those that are compared is COST_RADIUS
SWEEP_PENALTIES = (60, 600)  # of a step to the next hypothesis, to any other, in eighths of a grey level of a block
MIN_COST_RATIO = 1.1  # of the least cost elsewhere to that of the match (range/test_semi_global, too)
SWEEP_FLOOR = 10  # eighths of a grey level added to each difference, so that noise decides nothing
MISALIGNED = 0.3  # px^2 that cameras may be misaligned by, beside the noise, where they are compared at the end
MAX_UNLIKE = 30.0  # of what they differ by, to the median of all pixels measured; by 1 + the spread of range there
MAX_ROW_STEP = 3  # between the rows that finer levels sample: blocks of neighboring rows tell nearly the same
DEPENDENT_SHARE = 0.1  # of what noise does not explain: common to a block, so that no number of pixels averages it
SMOOTH_RADIUS = 5  # px, half side of what is averaged between levels, and at the end
LEVEL_BLUR_PX = 0.6  # of full-size images: linear interpolation of sharper ones is biased to whole pixels
# (range/test_sweep_tables)
MAX_VIEWS, FAINT_STRETCH = 4, 1.55  # cameras that see a direction; more stretched than this they count if needed
SIGHT_M = 2.0  # range from which on a camera must see what it sees of a direction
ERODED_PX = (
    2  # kept off borders, masks, unknown regions and what is borrowed (range/test_levels, stereo/test_stereo_pair)
)
TABLE_SIDE, MAX_HALF_TANGENT = 513, 4.0  # entries of a lens's table a side; tangent of half the angle off the axis
HYPOTHESIS_PX = (0.7, 1.25)  # least and largest step of hypotheses, px of the coarsest level between neighbors

# Fusion (range/test_fusion)
PATCH_PX = 3  # side of the patch that a LiDAR's point covers
STEEP = 0.1  # depth by range, of an RGB-D camera: less is 84 degrees off its axis (stitching/test_stitcher)
CONTRADICTION = (3.0, 0.05)  # times the least deviation, share of range: so sure a source, so far off: unknown
MIN_KNOWN = 0.005  # share with range below which it moves nothing: what is known is right, but far from the most

# Lenses of the images (range/test_lens_check)
INFO_TOLERANCE, MAX_RAYS_DEG = 1e-3, 1.0  # of a focal length, relative; median between rays of one lens's calibrations
LENS_SIDE, LENS_FEATURES = 800, 1500  # px of the images in which features are found; of a camera
FIT_DEG = 0.75  # of a match from where the other camera may see the same point
CLOSENESS = np.linspace(0.0, 2.0, 48)  # 1/m, places along the ray of a feature
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
RECTIFIED_PX = 1.0  # that calibration leaves: searched so far below 0, of a pair trusted from so far above
MAX_WIDTH_SHARE = 0.5  # of the image: larger disparities are not looked for
MAX_TURN_DEG = 45.0  # between the cameras' axes, and between them and the axis of the pair
FAR_WORSE = 1.5  # by which rows agree worse as told than as they are: the images are rectified already

# Rows of a pair (stereo/test_stereo_field)
CORNERS = {"maxCorners": 1200, "qualityLevel": 0.003, "minDistance": 7}  # px
FLOW = {"winSize": (9, 9), "maxLevel": 5, "criteria": (3, 40, 0.001)}  # px (count and size)
MAX_ROWS_APART = 12.0  # px; more is a wrong match
MIN_MATCHES = 40  # corners, features, directions: of fewer nothing is said (range/test_lens_check, light/test_light)
FIT_STEPS = 15  # at most, of this fit, of those below
CORNER_PX = 0.3  # of a corner: not found back this near it is lost; scale of Cauchy's loss
FIELD_PRIOR_PX = 3.0  # standard deviation of each coefficient, of rows and of disparity, before anything is seen
FIELD_FLOOR_PX = 0.03  # that no number of corners lowers: patches see more than one row, and not all are planes

# Disparities of a pair, by a drive (stereo/test_corner_tracks, stereo/test_track_fit)
NUM_VIEWS = 4  # instants that a corner is followed through, as far as it is seen
NEAR_DISPARITY_PX = 2.0  # of a corner, the least
HALF_PATCH_PX = 4  # of a patch's side
LAST_STEP_PX = 0.003  # of a patch
MAX_SHIFT_PX, MAX_SLOPE = 1.5, 0.7  # from the start or the row, farther away is another thing; disparity by pixels
LEAST_TEXTURE = 1e-2  # squared grey levels by px, added so that bare patches do not move
TRACK_LOSS_PX = 0.15  # scale of Cauchy's loss on a corner's pixels

# A LiDAR's clouds, and what is said of a rig (range/test_fusion, ros/test_rig_intake, ros/test_node)
FEATURE_WIDTH = 2048  # px, of the sphere in which features are found (range/test_rectification)
CLOUD_STD_M = 0.03  # standard deviation of its range
MAX_CLOUD_AGE_S = 0.06  # between a cloud and an instant that it serves: somewhat more than half a period of 10 Hz
WARN_DEG = 0.5  # turn of a camera against the rig file that is warned of
