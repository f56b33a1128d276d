"""Numbers that a drive depends on, with unit, origin and the test that notices a change; what a user sets: params.py.

Where no other origin is named, a number was chosen for a car of walking speed to 2 m/s and a camera of 10 Hz.
"""

import math

# Trajectory
SPACING = 0.1  # m between its points; test_smoothing
MIN_SPACING = 0.2  # m; given points closer than this are averaged; test_smoothing
MAX_BEND = 0.6  # rad between chords; points that bend more are corners, not samples of a smooth curve; test_smoothing
MAX_POINTS = 1_000_000  # of a given path; test_taught
MIN_LENGTH, MAX_LENGTH = 0.2, 1e5  # m of a path; test_taught
MAX_GAP = 1e3  # m between two points; more is a slip of a decimal, and would be filled every 0.1 m; test_taught
CUSP_HYSTERESIS = 0.15  # m of way backwards that make a change of direction: more than poses scatter; test_taught
MIN_TAUGHT = 0.3  # m/s; slower taught speeds are raised to it: the teacher stood; test_taught
MAX_SIDEWAYS = math.radians(60.0)  # a car does not move across its heading; test_taught
SAME_PLACE = 0.25  # m: passes of the path that are this much further than the closest are as good at a start; test_path
SEARCH_WINDOW = 2.0  # m ahead of the last place on the path within which the next one is looked for; test_safety

# Control law
EPSILON = 0.1  # m/s, keeps the longitudinal gain alive where U* is 0 (M15 eq. 25); test_speed
GOAL_TOLERANCE = 0.05  # m before its end a segment is finished; test_speed
MAX_BANDWIDTH = 1.6  # rad/s; the natural frequency in time is kept below it at high speed; test_steering
MAX_HEADING_ERROR = 1.0  # rad; errors beyond are cut, where tan grows without bound; test_steering
MAX_ANGLE = 1.2  # rad between heading and direction beyond which a direction cannot be driven; test_homing

# Car
STANDING = 0.03  # m/s of the predicted speed; test_vehicle
TURNED = 0.1  # rad between wheel and wish within which a start may speed up; test_vehicle
PREDICTION_STEP = 0.02  # s; test_vehicle
HISTORY_NS = 3_000_000_000  # of the commands that a prediction goes back to; test_vehicle
MAX_RUN_NS = 10_000_000_000  # that the model of the car goes through at once: by then all lags are over; test_vehicle
MAX_POSE_AGE = 0.5  # s that a pose is predicted to the present: somewhat more than max_pose_silence; test_vehicle
MAX_STEP_NS = 200_000_000  # time between commands that counts for their limits: two images of 10 Hz; test_vehicle

# Stops
REACTION = 0.3  # s until the brakes act: dead time, lag and an image; test_obstacles
SWEEP_STEP = 0.2  # m between the footprints that are checked: half the smallest thing to stop for; test_obstacles
MIN_POINTS = 2  # points of a scan that make an obstacle: a single one is noise; test_safety
STEADY_NS = 2_000_000_000  # of TRACKING without a pause, after which a standing vehicle may go on; test_resume
