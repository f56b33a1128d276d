"""The numbers that results depend on and nobody would set: unit, origin, and the test that pins each group.

Tests are named below test/dense_localizer/. "Chosen" means: by the test named, on simulated drives, where no other
origin is given. A level in standard deviations is stated with how often chance exceeds it.
"""

from __future__ import annotations

import numpy as np

# Weight of earlier images or intervals, from one to the next: about ten count
# (references/test_map_error, judge/test_odometry_check, track/test_visual_odometry).
IMAGE_FORGETTING = 0.9

# Registration: image motion of an increment below which a level is done, px. Fine enough at the rate of a camera
# (test_localizer: errors of a drive).
MIN_STEP_PX = 0.04
MAX_MAD = 40.0  # grey levels: an alignment that leaves more is refused (photometric/align/test_esm)

# Prediction (test_motion_prior)
GAP_S, GAP_PERIODS = 0.3, 2.0  # a longer pause is a gap, s, that no last image spans; of a slower camera, in periods
NUM_PERIODS = 5  # latest periods, whose median is the camera's
MAX_POSITION_SIGMA_M = 0.5  # of a pose that one may go on from (judge/test_candidate)
MOVING_SPEED = 0.05  # m/s, from which a repeated image is a fault (test_inputs)
START_SPEED, START_TURN_RATE = 5.0, 1.0  # m/s, rad/s: standard deviations after a start

# The ground: height, roll and pitch of a vehicle where another one was taught (test_motion_prior)
GROUND_SIGMA = np.array([0.03, 0.01, 0.01])  # (3,) m, rad: a laden car on its springs, how well cameras are mounted

# Rotation between images, M15 eq. 20 (test_motion_prior). A mismatch is one minus a correlation.
MAX_MISMATCH_RATIO, MISMATCH_FLOOR = 3.0, 0.02  # of a supported prediction: factor of the usual one, and beyond it
MAX_ROTATION_MISMATCH = 0.7  # of a measured rotation, as share of that of the prediction

# Choice of references, M15 eq. 17 (references/test_reference)
MAX_REACH_M = 10.0  # from the nearest key sphere: beyond it nobody knows the ground, and a pose is another place
LOOK_AHEAD = 0.2  # of the range that a view shows, by which key spheres ahead are taken for nearer; one town, 30 deg
NUM_CANDIDATES, MIN_CANDIDATES = 12, 4  # key spheres considered, nearest or likest; of each experience, at least
NUM_KEPT = 16  # latest images, or parts of the map, that are kept as they were made: memory and time, no result
RELATIVE_SHARE = 0.6  # covered by a reference: of what the best one covers; and `GOOD_OVERLAP` of the image
NUM_COARSE_LEVELS = 2  # of the small spheres that stay in memory

# Choice of an experience (references/test_coarse_reference)
MIN_LIKENESS_LEAD = 0.05  # of the likeness of edges, of correlation: below it two experiences look alike

# Prefetch (references/test_reference)
PREFETCH_S = (0.0, 0.5, 1.0)  # s from now, when the camera will be where key spheres are prepared
PREFETCH_STEP_M = 0.2  # motion between two prefetches, at least
LEAD_S = 0.05  # s ahead, where pixels are chosen: between the next image and the one after it; between two prefetches
MIN_SPHERES = 3  # prepared whatever they take: two in use, and the next

# Errors of the map (references/test_map_error, test_motion_prior). The factors of mean squares were chosen on the first
# half of real hand-held images, so that NEES is 1 on the second.
MAP_ERROR_RATIOS = np.geomspace(1e-4, 1e4, 49)  # variances thought possible, by the assumed one
SHARED_ERROR = 2.0  # factor of what key spheres disagree by, and edges say: they err together, too
MAX_OBSERVED_SIGMAS = 3.0  # that one observation counts at most; 1 in 370 by chance
REFUSED_FADING = 0.8  # weight that observations keep with each refused image (references/test_map_error)
EDGE_HOPS = 5  # edges around a key sphere that count
MIN_EDGE_M = 0.1  # shorter edges say nothing of a meter

# Acceptance (judge/test_candidate): a first value refuses, a second one means care: DEGRADED.
MIN_OVERLAP, GOOD_OVERLAP = 0.15, 0.25  # share of the chosen pixels that the image sees
GOOD_NCC_LEAD = 0.1  # of the correlation of a good alignment over the least one
ACCEPTED_INLIER_SHARE, GOOD_INLIER_SHARE = 0.4, 0.5  # of the pixels compared
# Mean cosine of gradients: 0.12 at most in 21 wrong places that had converged, 0.31 at least in 550 right ones, real
# hand-held images and saturated ones among them.
MIN_GRADIENT_AGREEMENT, GOOD_AGREEMENT_LEAD = 0.2, 0.05
MAX_INNOVATION = 5.6  # standard deviations of six numbers from the prediction, or from odometry; 2e-5 by chance
NUM_INNOVATIONS, INNOVATION_RATE = 10, 1e-6  # latest images that together are no nearer to their predictions; by chance
GOOD_SIGMA = 0.5  # of the largest standard deviation, or a bias: three sigma of a good pose are within 0.3 m
MAX_ATTITUDE_SIGMA_RAD = 0.05  # largest standard deviation of the attitude; between key spheres more is no ground
NOTABLE_GAIN, NOTABLE_OFFSET = 2.0, 50.0  # of the light, either way; grey levels: the likely cause of outliers

# Integrity checks (judge/test_integrity): each is due once in so many images in TRACKING, no two in the same one
INTEGRITY_PERIOD = 10
FIT_PHASE, OCCLUSION_PHASE = 0, 3  # which image of INTEGRITY_PERIOD
MAP_PHASE = 5  # counted after the image
FULL_CHECK_NCC = 0.97  # of the usual correlation: all checks are due below it
CORRELATED_CELLS = 2.0  # factor of a covariance by parts of the view: a lamp shifts neighbours alike
CONTRAST_COVARIANCE = 3.0  # by how much that of an alignment by local contrast is larger: other light errs alike
REMAINING_BIAS = 0.2  # standard deviation of what is left of a bias that was removed, as share of it; no more was left

# Cells of an image that never show the map (judge/test_lens_watch). Of cells that did show it, other cars by day among
# them, 0.07 of the images spoke against one in town 4311; of those behind a bonnet 0.9, behind dirt 0.73.
MASK_CELLS = (16, 12)  # columns and rows of an image
MASK_STEP_RAD = 0.09  # by which the view moves between two images that are asked: a cell of a view of 80 degrees
MIN_MASK_PIXELS, MASK_COSINE = 4, 0.5  # of a cell, to be asked; of gradients: what shows the same has more
LOG_ODDS_HIDDEN, LOG_ODDS_SEEN = -2.4, 1.5  # of one image: ln(0.8 / 0.07), ln(0.93 / 0.2)
HIDDEN_LOG_ODDS, LOG_ODDS_RANGE = -9.0, (-12.0, 6.0)  # four images; of a cell that shows the map 2e-5 by chance

# The lens (judge/test_lens_watch): a share by which the image is larger about its centre. Of 550 images of right
# lenses none alone was 2.8 deviations off; 4 of the mean of all are 6e-5 by chance.
MAX_SHARE, LENS_SIGMAS = 0.01, 4.0  # beyond both a lens is wrong
LENS_PIXELS = 2.2  # of the map, a radian from the centre, if that is more: 1.0 off in a map of 768 columns, ideal else
LENS_NOISE = 0.005  # standard deviation of what a key sphere's errors look like: simulated streets, by day and night
LENS_FAR = 8  # steps of 2 % by which one is tried to be longer, or shorter, where nothing is told
LENS_SPHERES = 64  # latest key spheres that count; one of INTEGRITY_PERIOD images is asked

# Odometry against images (judge/test_odometry_check)
DELAY_SIGMAS, MIN_DELAY_S = 5.0, 0.05  # a delay surely above it is reported; by chance once in 3 million intervals
DISPUTE_S = 10.0  # a place that contradicts odometry must hold so long before it is trusted
MOTION_INTERVAL_S, MOTION_SHIFT_S = 0.5, 0.1  # over which motions, and their changes, are compared
COMPARISON_SIGMA = np.repeat([0.005, 0.002], 3)  # (6,) m, rad: of any comparison of two motions

# The last image as a reference, M15 section 5.3 (track/test_visual_odometry)
VO_DRIFT = np.repeat([0.02, 0.004], 3)  # (6,) m, rad: standard deviation of what drifts in a meter
VO_MAX_S = 60.0  # without the map
VO_MAX_SIGMA_M = 0.02  # of an alignment with the last image
MAX_LEVEL_PIXELS = 2.0  # of the pixels aligned: to make a reference of more takes longer than to align it

# Search, M15 section 5.4 (start/test_startup, start/test_guesses)
NUM_MATCHED, MIN_POSE_INLIERS = 6, 6  # of the likest spheres, by features; features
PARTIAL_STEP_DEG = 15.0  # above and below, and beside the heading of a partial sphere
ROLL_STEP_DEG = 45.0  # about the axis of a camera that nobody has found upright; alignment reaches half of it
MAX_PITCH_RAD = 1.2  # 70 deg: steeper, a mounting is of optical axes
FORWARD_STEP = 0.2  # before and behind a center, as share of the range
NUM_COMPARED_POINTS, MIN_COMPARED_POINTS = 600, 20  # of a sphere with the image; visible, below which nothing is said
NUM_SEEN_POINTS = 100  # within the cone of a view, at least; 600 of a sphere are as many in a view of 80 degrees
MIN_COARSE_PIXELS = 60  # of an alignment that only ranks guesses: a view of 30 degrees has 200 of a small sphere
NUM_ALIGNED, NUM_VERIFIED = 3, 2  # best guesses that are aligned coarsely, and at full resolution
CLEAR_LEAD = 0.25  # of coarse correlation, by which the best guess leaves others behind: twice the margin of a start
NUM_LAID_OUT, NUM_HEADINGS = 48, 2  # spheres compared by edges; headings of each
NUM_TURNED = 4  # spheres in which an image is compared at all turns about its axis, where no features place it
SAME_POSE_M, SAME_POSE_DEG = 0.3, 10.0  # candidates closer than this are one
SEARCH_PERIOD_S, SEARCH_NEAR_S = 0.2, 2.0  # between two searches of the whole map; that a given or lost pose is tried

# What else may explain an image (test_localizer)
NUM_OTHER_EXPERIENCES = 3  # that are asked for an image which the one in use does not explain well
SURE_GRAY_NCC = 0.9  # correlation of grey levels below which local contrast is asked, too: other cars, another light

# Drives that are kept to learn from (test_key_images)
MIN_EXPLAINED_NCC = 0.8  # correlation of an image with the map that explains it, or with the last image
MIN_EXPLAINED_SHARE = 0.8  # of the key images, below which a drive is a lesson
KEY_REACH, KEY_TURN = 0.1, 0.1  # between key images: share of the radius of a region; rad
MIN_KEY_IMAGES, KEY_MEMORY = 6, 500  # of a drive that is kept; latest ones that the next is compared with
MAX_KEY_SIGMA_M = 0.05  # standard deviation of the place of a key image

# Geometry where grey levels do not do (track/test_range_support)
GOOD_RANGE_OVERLAP, GOOD_RANGE_AGREEMENT = 0.4, 0.8  # shares; the least are those of any motion by ranges
