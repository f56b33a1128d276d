"""The numbers that what nodes share depends on and nobody would set: unit, origin, and the test that pins each group.

Tests are named below test/sphere_nav/ros/. Times are of what a machine or a network does: chosen well above what a busy
one was seen to take. Sizes of buffers and bounds of files stand where they are read.
"""

from __future__ import annotations

# Stamps and clocks (test_clocks)
MAX_AHEAD_NS = 100_000_000  # of stamps: /clock may come later than what it stamps; map -> odom saves look-ups a wait
CLOCK_PATIENCE_S = 0.4  # of steady time without an advance of the node's clock: the ramp to zero begins
MAX_PATIENCE_S, FORGET = 3.0, 0.1  # s of patience with a slow simulator; share of the time by which it shrinks again
MAX_LOOK_S = 0.1  # between two looks at the clock
MAX_CAUGHT_UP_NS = 10_000_000_000  # of simulated time; all silence has been judged after so long

# Images of an instant (camera/test_synchronizer, camera/test_intake)
DEPTH_SLACK_S = 0.01  # depth of one instant differs by less: a third of a period at 30 Hz (camera/test_intake)
MAX_MISSES = 3  # instants in a row without an image, after which a camera is not waited for (without a deadline)
BACK_NS = 1_000_000_000  # stamps so far before the last instant, or before now, are of another time, as of a recording
SILENCE_NS = 500_000_000  # without any instant, until what is refused of one camera is the answer

# Odometry and transforms (camera/test_odometry_input, test_tf, localizer/test_pose_outputs)
MAX_ODOMETRY_AGE_NS = 200_000_000  # for which odometry is carried on by its own speed
PARENT_HOLD_NS = 1_000_000_000  # by which the stamps of a frame's parent must have ended before another takes over
SAME_POSE = 1e-3  # m and rad: a frame that stands still and is told again may be off by so much
TRANSFORM_PERIOD_S = 0.05  # between two of them while no image comes
ODOMETRY_PATIENCE_NS = 500_000_000  # for odometry on /tf to come up to the stamp of an image

# A localiser's node (localizer/test_node)
WATCH_PERIOD_S = 0.25  # between two looks at a silent camera
STANDSTILL_S = 1.0  # without an advance of /clock, and without its publisher, before the status says so
FIRST_IMAGE_S = 2.0  # without any image before it is said
NUM_COUNTED, MAX_LOST_SHARE = 20, 0.2  # images over which losses are counted; share of them, before it is said
OFFER_PERIOD_NS = 1_000_000_000  # between two poses of a peer that start a search

# Topics (test_subscription, test_compositions, test_site_file)
ABSOLUTE = ("/tf", "/tf_static", "/clock")  # would be shared by all vehicles of a domain, and are renamed for all nodes
SHARED_S = 3.0  # within which the numbers of a topic turn back twice: two publish it, at 1 Hz or faster

# Failures (test_executor)
RECENT_S = 10.0  # for which a failure shows in the diagnostics
MAX_WAITS, PAUSE_S = 50, 0.02  # failed attempts to wait, in a row, before the process ends; between two of them
MAX_REFUSED = 4  # messages in a row that are refused without an alarm
LOG_PERIOD_S = (
    5.0  # between two equal lines of the log, explanations too, and two of requests that failed alike (test_node)
)

# Bags that are played and recorded (bags/test_player_node, bags/test_player, bags/test_writer)
PLAY_TICK = 0.005  # s between two looks at what is due
PLAY_BUSY = 0.05  # s that one tick may publish before others get a turn
ACKNOWLEDGED_SIZE = 1 << 16  # B; smaller messages are acknowledged by the next heartbeat, seconds later
ACKNOWLEDGE_S = 5.0  # s to wait for listeners when playing as fast as they take it
SETTLE = 0.5  # s from the last awaited listener to the first message: the others need as long to be discovered
CLOCK_PERIOD = 0.025  # s of wall time between two /clock messages
TOPICS_PERIOD = 0.2  # s; what is published before its topic is found is not recorded
RECORDER_QUEUE = 100  # messages of a topic that may wait while the disk is slow
FLUSH_PERIOD = 5.0  # s of wall time: what a killed process can lose; the index of each chunk stays in memory

# Compositions (test_compositions)
END_PATIENCE_S = 30.0  # s for a node to end after SIGINT: a recorder completes its bag first
MAX_RESTARTS = 5  # of one node; more would hide that something is broken

# Diagnostics and the log (test_qos, test_service)
HEALTH_PERIOD = 1.0  # s between two diagnostics, or two equal words of one node
