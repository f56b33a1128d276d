"""The numbers that offline results depend on and nobody would set: unit, origin, and the tests that pin each group.

Tests are named below test/sphere_nav_tools/offline/; "cli/" are those of the commands. "Chosen": by the test named.
"""

from __future__ import annotations

import numpy as np

# Recordings (test_topics, cli/test_localize, cli/test_import)
EPOCHS_S = 1e8  # stamps, and names of files, before it, in 1973, are of no calendar (cli/maps/test_map)
SLACK_S = (0.005, 0.02)  # least and largest difference of the stamps of one instant: what a moving camera can bear
NUM_PAIRED = 40  # messages of each of two cameras, within which two of one instant are looked for
SILENT_PERIODS = 4.0  # of a camera, that are a silence; recordings drop images
NUM_TF_MESSAGES = 1000  # that are looked at for the frames there are
DEFAULT_HZ = 10.0  # of images without stamps; KITTI's scanner turns so fast
MAX_PAIR_GAP_NS = 20_000_000  # between the stamps of one instant in a TUM recording

# A drive of a rig (mapping/test_workers)
AHEAD = 2  # pieces a worker under way: one at work, one that waits; instants stitched before the mapper has theirs:
# always as many; odometry is kept for 2 s

# A rectified pair by its drive (mapping/test_drive)
MAX_WINDOWS = 16  # of consecutive instants in which corners are followed, spread over the drive
MAX_PAIRS = 400  # of the drive's beginning

# A driving camera by its drive in a map (cli/test_refine_camera)
MAX_PAUSE_S = 0.3  # between two images that tell a velocity
MAX_POSE_GAP_NS = 200_000_000  # between two poses that tell one between them
REFINE_ROUNDS = 3  # of localizing with the lens found so far and refining it
SETTLED_PX = 2.0  # rms change of the lens that moves no image out of the reach of its alignment

# A survey against what was aligned (mapping/test_drive)
SURVEY_SIGMA = np.repeat([0.01, np.radians(0.3)], 3)  # (6,) m, rad: standard deviations that are granted to a survey
EDGE_FACTOR = 2.0  # of those of the edges: on real recordings with good truth edges err about twice as much as they say

# A drive that is mapped or localised (mapping/test_drive, mapping/test_extension)
MOST = 0.5  # share of the spheres, lost, above which a drive was not mapped; of the edges, above which no survey holds
MIN_EXPLAINED_SHARE = 0.8  # of the images of a key sphere, above which it adds nothing to the map
PATIENCE_S = 10.0  # of recording time: between spheres, which motion bridges; for images, late as they were written
IMU_NS = 1_000_000_000  # of the bag's beginning: its first image may come before the IMU

# Lessons of a drive (cli/maps/test_map_learn)
NUM_DRAWN = 6  # key spheres whose range is drawn: those that placed the image, and the nearest ones beside them
TEACH_REACH, TEACH_TURN = 0.35, 0.35  # between key spheres of a lesson: share of the radius of a region; rad
MIN_MEASURED = 0.2  # of the pixels, for a key sphere
KEY_FLOOR = np.repeat([0.005, 0.002], 3) ** 2  # (6,) m^2, rad^2: added to the covariance of a key image
MAX_OFF = 6.0  # standard deviations of both places from which an image is not where it was, and at least MIN_OFF_M
MIN_OFF_M = 0.1  # the same, however sure
MAX_EXAMINED, MAX_JUDGES = 40, 5  # key images of a drive, spread over it; latest other drives

# Places on a network of routes (cli/test_route)
NETWORK_REACH = 2.0  # m from the network within which a place can be named
