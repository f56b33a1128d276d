"""The numbers that mapping depends on and nobody would set: unit, origin, and the test that pins each group.

Tests are named below test/sphere_mapping/graph/. "Chosen" means: by the test named, on simulated drives, where no other
origin is given. A pair is one of m and rad. Those of the way from images to a sphere are in acquisition/constants.py.
"""

from __future__ import annotations

# Expectation of the next sphere (test_motion, test_tracking: a jump that no vehicle makes)
MAX_KNOWN = 2.5  # intervals of the past motion after which it is a guess: one sphere was missed, not two
CONTRADICTED = 2  # spheres in a row that were not where they should be: what was expected is wrong, odometry included;
# the next one is sought in the whole map (test_mapper)
ACCELERATION = (5.0, 10.0)  # m/s^2, rad/s^2: standard deviations of what a vehicle or a hand does
ODOMETRY_SHARE = 0.1  # standard deviation of odometry by the motion: wheels slip by less
EXPECTED_FLOOR = (0.05, 0.03)  # least standard deviations of an expectation
SHARP = (0.2, 0.1)  # standard deviations above which being expected proves nothing

# Rolling shutter (test_tracking)
NUM_PASSES = (
    3  # alignments of one sphere, each leaves half of the error of its velocity; of a drive by ranges (test_joining)
)
STILL = 0.01  # m/s and rad/s, a change of velocity that warps nothing: 0.1 px of 500 px/rad in 20 ms

# Key spheres (test_keyframes); M15 eq. 12 by MAD is a parameter
MIN_INLIER_SHARE = 0.5  # of pixels that agree, below which a reference no longer explains a sphere

# Edges measured both ways (test_both_ways; those of one way: test_tracking)
MAX_PAIR_MAD = 12.75  # grey levels, 5 % of 255, of a true pair (M15 eq. 12)
MIN_PAIR_OVERLAP = 0.3  # share of the reference's own coverage that must be in view
MIN_NCC = 0.3  # correlation of the aligned images below which an alignment is none (test_registration)
MIN_PAIR_NCC = 0.6  # correlation of the aligned images, both ways
MIN_INLIERS = 15  # features that agree on a pose; between other places of a town 4 to 8 do
MAX_FROM_FEATURES = (0.3, 0.05)  # between the motion by features and the dense one
EDGE_FLOOR = (0.002, 0.0005)  # standard deviations that no measured motion falls below
UNCONFIRMED, UNCONFIRMED_SHARE = (0.03, 0.01), 0.03  # deviations of an edge that one way measured; by its length

# Places seen twice (test_loop_closure, test_verification)
NUM_ALIKE = 4  # key spheres whose features are compared with a new one's
SAME_PLACE_M = 1.0  # suggestions farther apart than this are of different places
MIN_LEAD = 1.5  # inliers of the best place by those of the next one; else both could be meant
DRIFT = (0.015, 0.002)  # standard deviations of the graph, by the meters on the way between two spheres
DRIFT_START = (0.075, 0.015)  # the same of no way at all
MAX_AWAY = 1.0  # between views that see the same: by the region of the one, plus a radian
NUM_OLDER = 3  # of them that edges join with each key sphere: the one before it, the second and the third
MIN_DETOUR = 4.0  # way between two spheres by their distance; along a shorter one the chain is the better measure

# Another drive in the map (test_extension)
MIN_JOINS = 2  # places that must agree: one alone may look like another
MAX_SEEDS = 20  # joins whose word is compared with that of all others

# Redundant key spheres (test_merging)
MERGE_REACH = 0.5  # of the radius of a sphere's region: how near it must be to what another one was nearest to
MERGE_SPACING = 0.75  # the same of the distance from that one to the next on its drive: the map keeps its density

# Optimization (test_incremental, test_optimum)
ANCHOR_SIGMA = 1e-6  # m and rad: anchors stay where they are
ROBUST_WIDTH = 2.0  # standard deviations beyond which a robust edge loses weight (Huber)
LARGE = 300  # key spheres from which on iSAM2 pays
RELINEARIZE = 0.003  # m and rad by which a pose moves before it is linearized anew
LOOP_STEPS = 10  # of iSAM2 after a loop; it ends by itself before
DESCENT_TOLERANCE = 1e-8  # of the error, between two steps; GTSAM's 1e-5 stops before a slow descent is done

# Which way is up at the first sphere (../test_level). Gravity by an IMU: a cheap one is off by 0.1 m/s^2, 0.6 deg.
GRAVITY = 9.80665  # m/s^2
GRAVITY_S = 0.5  # s before and after the first sphere, of which samples of the IMU count
MIN_STILL = 10  # samples, to tell rest from motion
STILL_FORCE, STILL_RATE = 0.4, 0.05  # m/s^2 off gravity, and its deviation; rad/s: an engine shakes less
STILL_DRIFT = 0.1  # m/s^2 between the two halves of the samples: who starts to drive does more
MAX_LEAN_RAD = 0.6  # 35 deg: no vehicle stands steeper, an IMU that says so has another frame
# The ground by range: a plane with hardly anything below it.
GROUND_POINTS, GROUND_TRIALS = 3000, 300  # points that are looked at; planes through three of them
GROUND_TOLERANCE = (0.02, 0.01)  # m off the plane; the same by the range
GROUND_SHARE, GROUND_BELOW = 0.15, 0.02  # of the points: on it, at least; below it, at most
GROUND_LEAN_RAD = 0.25  # 15 deg: a mounting that is known is not farther off
GROUND_FLOOR_RAD = 0.0035  # 0.2 deg that ranges bend a floor by
NUM_FITS = 4  # of the plane to the points near it, each by the one before
INDEPENDENT = 100  # points that err together: neighbours on one floor
STEEP = 0.9  # of what points up where a vehicle looks at the sky: its left side says where ahead is
WAIT_S = 1.0  # of stamps: a live node begins a map without /tf_static and IMU, an image goes without its counterpart

# A drive placed in a map (experiences/test_joining)
FALSE_FIT = 0.05  # of places, where ranges tell a motion from a start that is 0.5 m off or more: 2 % in a street
ASIDE = ((0.5, 0.0), (1.0, 0.05), (2.0, 0.05), (3.0, 0.05))  # m that a drive is moved; lead of its agreement, mean
NUM_ASIDE = 8  # directions
GUESS_STEP_RAD = 0.35  # between headings that are tried of partial spheres
NUM_HEADINGS = 4  # that are tried of whole ones, the likeliest

# The same by parts of the images (experiences/test_parts)
NUM_PARTS_SEARCHED = (8, 40, 3)  # key spheres of the drive, of the map, and the likeliest of each, measured whole
MAX_PARTS_CHANCE = 1e-7  # of as many parts agreeing in a wrong place, either way, all motions counted that were tried
MIN_LOCATED_SHARE = 0.8  # of the key spheres of a drive that the localizer placed, below which parts are asked, too
