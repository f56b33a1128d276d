"""Numbers that networks and ways depend on, with unit, origin and the test that notices a change."""

import math

# Network (test_building): of streets with lanes of 3 m, and drives that repeat within a few decimetres
LANE = 0.6  # m: drives closer than this, heading alike, are on the same lane
SAME_HEADING = math.radians(15.0)  # between drives on the same lane
MIN_SHARED = 5.0  # m alongside that make a shared edge: a crossing at a flat angle of 15 deg is alongside for 4 m
MAX_APART = 3.0  # m beside each other and back that are the same lane still
BLEND = 8.0  # m before and behind a branch over which a drive goes over to the curve of the other
PAST = 10.0  # m that a drive goes on before it can meet itself
ALIKE = 0.1  # m, rad / 3, 1/m / 4: points that are this much less alike than the best are as good for a branch
TURN_SCALE = 2.0  # m of distance that a chord of headings counts: 15 deg count as 0.5 m
STUB = 3.0  # m that a drive begins before, or goes on behind, what it shares: less is left out
SNAP = 3  # points from the end of a curve that are its end

# Ways (test_network)
REVERSE_COST, CUSP_COST = 3.0, 5.0  # times the time driven backwards; s for a change of direction
AT_PLACE = 0.5  # m before or behind a place within which a vehicle is there

# Missions (test_mission)
TICK = 0.2  # s
MAX_SILENCE = 2.0  # s without pose, status of the localiser or of the follower
MAX_TURN = 0.35  # rad, 20 deg, between the vehicle, or a goal, and the heading of the network
CALL_PATIENCE = 5.0  # s for an answer of the follower
STEADY = 1.0  # s of TRACKING before a start
LATE = 1.0  # s that a status of the follower may be under way, and until it is asked again to stop for a pause
RETRY = 3.0  # s between two starts before something that is in the way
BEHIND_FRONT = 0.7  # m before the front within which an obstacle stands: margin and braking way
SMOOTHED = 0.005  # share of its length that smoothing may take from a path
ADVANCED = 0.3  # m of progress that make an obstacle another one

MAX_NAME = 64  # characters of a place
MAX_ITEMS = 100_000  # nodes, or edges

# Files (test_network_file)
MAX_CURVE_GAP = 1.0  # m between two points of a curve, and between its end and its node
