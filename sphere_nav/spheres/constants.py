"""Numbers that motions between key spheres depend on, with unit, origin and the test that notices a change."""

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
