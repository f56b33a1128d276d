"""Numbers that a drive depends on, with unit, origin and the test that notices a change; what a user sets: params.py.

Where no other origin is named, a number was chosen for a car of walking speed to 2 m/s and a camera of 10 Hz.
"""

import math
from typing import NamedTuple

# Trajectory
SPACING = 0.1  # m between its points, and those of a network; test_taught, routes/test_planning
MIN_SPACING = 0.2  # m; given points closer than this are averaged; test_taught
MAX_BEND = 0.6  # rad between chords; points that bend more are corners, not samples of a smooth curve; test_taught
MAX_POINTS = 1_000_000  # of a given path; test_taught
MIN_LENGTH, MAX_LENGTH = 0.2, 1e5  # m of a path; test_taught
MAX_GAP = 1e3  # m between two points; more is a slip of a decimal, and would be filled every 0.1 m; test_taught
CUSP_HYSTERESIS = 0.15  # m of way backwards that make a change of direction: more than poses scatter; test_taught
MIN_TAUGHT = 0.3  # m/s; slower taught speeds are raised to it: the teacher stood; test_taught
MAX_SIDEWAYS = math.radians(60.0)  # a car does not move across its heading; test_taught
SAME_PLACE = 0.25  # m: passes of the path that are this much further than the closest are as good at a start; test_path
SAME_DIRECTION = 0.3  # rad: passes of the path turned this much more than the best head elsewhere; test_path
SEARCH_WINDOW = 2.0  # m ahead of the last place on the path within which the next one is looked for; test_safety

# Control law
K_X = 0.8  # 1/m, gain of the longitudinal error (M15 eq. 25); test_law
EPSILON = 0.1  # m/s, keeps the longitudinal gain alive where U* is 0 (M15 eq. 25); test_law
GOAL_TOLERANCE = 0.05  # m before its end a segment is finished; test_law
MAX_BANDWIDTH = 2.5  # rad/s; of the loop in time at most: docs/notes/control_loop.md, chosen on S-curves; test_law
MAX_ANGLE = 1.2  # rad between heading and direction beyond which a direction cannot be driven; test_homing

# Car
CREEP = 0.1  # m/s of the last steps, and while the wheels turn at a start; test_law
STANDING = 0.03  # m/s of the predicted speed; test_vehicle
TURNED = 0.1  # rad between wheel and wish within which a start may speed up; test_vehicle
PREDICTION_STEP = 0.02  # s; test_vehicle
HISTORY_NS = 10_000_000_000  # of commands that the model goes through: by then all lags are over; test_vehicle
MAX_POSE_AGE = 0.5  # s that a pose is predicted to the present: somewhat more than max_pose_silence; test_vehicle
MAX_STEP_NS = 200_000_000  # time between commands that counts for their limits: two images of 10 Hz; test_vehicle

# Stops
MAX_DEGRADED_TIME = 10.0  # s of driving in DEGRADED, or by an uncertain pose; test_safety, test_consistency
MAX_OFF_HEADING = 1.0  # rad off the path, beyond which it was left; the law cuts what is more; test_safety, test_law
SENSOR_SILENCE = 0.4  # s of scans, once there was one, and of odometry, which is carried on so long; test_safety
MAX_YAW_DEVIATION = 0.25  # rad of standard deviation: drives slowly above it, stops above twice; test_consistency
REACTION = 0.3  # s until the brakes act: dead time, lag and an image; test_obstacles
SWEEP_STEP = 0.2  # m between the footprints that are checked: half the smallest thing to stop for; test_obstacles
ACROSS = 7  # places across the way that beams must have measured: 0.25 m apart; test_obstacles
MIN_MEASURED = 0.5  # share of these places, and of the beams that lately measured; test_intake
MIN_POINTS = 2  # points of a scan that make an obstacle: a single one is noise; test_safety
MAX_CLOCK_PAUSE = 10.0  # s of wall time that /clock may stand without a publisher; test_control
STEADY_NS = 2_000_000_000  # of TRACKING without a pause, after which a standing vehicle may go on; test_stops

# Motion consistency (docs/notes/motion_consistency.md: chosen on drives of seeds 0 to 9); test_consistency


class MotionErrors(NamedTuple):
    """What dead reckoning may be wrong by without any doubt of the pose."""

    along: float  # share of the way: slip, wheel radius, a drive that does not hold its speed
    across: float  # share of the way, rad: the pose's heading is not the direction of the wheels
    yaw_per_meter: float  # rad/m: a wheel that is not straight
    turn: float  # share of the turn: wheelbase, track
    timing: float  # s: dead time, lag and stamps, times the change of speed and yaw rate


COMMAND_ERRORS = MotionErrors(0.2, 0.06, 0.03, 0.1, 0.15)  # along and turn: twice and once a standard deviation of 10 %
WHEEL_ERRORS = MotionErrors(0.07, 0.03, 0.02, 0.1, 0.03)  # a lag of 0.14 and a drift aside of 0.07 must show
RELEVANT = (0.25, 0.25, 0.12)  # m, m, rad: less does not stop: a quarter of the way to leaving the path
STOP_SIGMAS, SLOW_SIGMAS = 6.0, 4.5  # of two poses as they state it: 1e-9 and 3e-6 of one side
NOISE_STEPS = 20  # latest steps, by whose scatter poses may be surer than they state
LEAST_SCATTER = 0.48  # of what they state: what so many steps show in 999 of 1,000 cases, if it is true
STILL = 0.3  # share of the expected way: less is no motion
STILL_WAY = 0.2  # m of expected way, the last of it, by which a motion is called still
MAX_GAP_NS = 2_500_000_000  # between two poses, else it begins anew: what dead reckoning says of more is worth little

# Times of the loop and of who else commands (ros/test_control, test_peers, test_loop_process)
TICK = 0.025  # s of steady time between two looks at the clocks
REPEAT_NS = 50_000_000  # without a command, until the last one is sent again; not where time is simulated
SILENCE = 0.12  # s without an answer before the ticks command: never between the images of a 10 Hz camera
CYCLE_LOOKS = 400  # the last ones, ten seconds, of which the worst cycle is told
ACKNOWLEDGE = 0.5  # s to wait for all that receive commands to have the last one
LOOK_PERIOD = 0.1  # s between two looks at who publishes
HEARD_BEFORE_NS = 300_000_000  # a message may come this much earlier than its publisher is seen
GUARD_SILENCE_NS = 500_000_000  # five times the period of the guard's status; until it has said what a start changed
GUARD_PERIOD = 0.02  # s between two commands to the base
PAIRED = 16  # stamps of poses and statuses that are kept for the other one, milliseconds later; ros/test_intake
BEAM_FORGETTING = 0.99  # of the share of beams that measured, a scan: 7 s at 10 Hz until half of it is usual
