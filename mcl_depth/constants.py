"""The numbers that results depend on and nobody would set: unit, origin, and the test that pins each group.

Tests are named below test/mcl_depth/. "Chosen" means: by the test named, on simulated drives and depth images of
recorded clouds, where no other origin is given. Sizes of batches and what file formats say stand where they are used.
"""

from __future__ import annotations

import numpy as np

# Motion between images (belief/test_motion_model)
MIN_TURN_SIGMA = np.radians(0.5)  # of the heading for each image
MAX_LEAP = 0.5  # m, believed at any speed
BLIND_SPEED, BLIND_TURN_RATE = 0.5, 0.35  # standard deviations of speed, m/s, and turn rate, rad/s, without odometry
MAX_BLIND_STEP = 1.0  # m
MIN_TURN = np.radians(3.0)  # an image turned by this tells something new, wherever it was taken (test_dead_reckoning)
STANDSTILL_NS = 10**9  # images of a standstill that nothing else confirms are compared so often (test_dead_reckoning)
UNMODELED = np.repeat([0.10, np.radians(1.0)], 3)  # (6,) m, rad: errors of map, tilt, height; of an exact start, too

# Particles, N17 section III-C (belief/test_particles)
EFFECTIVE_SHARE = 0.5  # resample when fewer than this share of the particles carry the belief
MIN_PARTICLES = 300  # of a belief in one place
KLD_BIN = np.array([0.25, 0.25, np.radians(10.0)])  # m, m, rad: poses in one bin are one to the belief (Fox 2003)
KLD_ERROR, KLD_Z = 0.03, 2.33  # largest error of the belief, and the normal quantile of its probability: 99 %
EXPONENT = 20.0  # lambda (N17 table I)
CHANCE = 4.0 / np.pi  # similarity of images that have nothing to do with each other: E|c| = 2 / pi, twice (eq. 2)
NUM_YOUNG = 2  # images after which a particle keeps its own heading
HEADING_SPREAD = np.radians(3.0)  # standard deviation left in an assigned heading
NEW_SHARE = 0.3  # of the particles that begin anew while no place is held
NEW_SIGMA = np.array([0.3, 0.3, np.radians(5.0)])  # m, m, rad: of a place of the survey, at least; half a step

# Hypotheses (belief/test_estimate)
CLUSTER = 3  # bins of the belief, either way: particles in boxes of so many that touch are of one place
MAX_HYPOTHESES = 5  # places that are told

# When the pose is trusted (test_status)
MIN_WEIGHT = 0.8  # share of the belief in one place before it is trusted
MAX_SIGMA_M, MAX_SIGMA_RAD = 0.6, float(np.radians(15.0))  # standard deviations of a trusted position and heading
MAX_SIGMA_CELLS = 0.93  # of a pose that leaves, by a cell's edge: 0.33 m in a home, where a metre is another room
EVEN_ODDS = 0.5  # a held place is bad once it is more probably gone than there
LOST_IMAGES = 6  # bad images in a row until the pose is lost

# Evidence of one image for the map, and its maxima (belief/test_evidence, test_joint_evidence)
LOCAL_M = 7.5  # across the neighbourhood whose mean is taken off: along a street all places look alike
PEAK = 2  # cells, and steps of headings, around a maximum that are lower
APART = 3  # steps of headings, and cells, to a rival and to other headings: what is nearer is the same place
NUM_MAXIMA, TAIL = 40, 0.05  # of a map; of those that it has room for
# What a drive elsewhere reaches, in standard deviations of an image: so much with each, 1 less for each metre that they
# are apart, beside a share of what other places reach; e times less often a scale beyond, by edges and learned
CHANCE_LEVEL, CHANCE_SHARE, CHANCE_SCALE = 1.75, 0.5, (2.4, 2.9)  # docs/notes/joint_evidence.md
WIDE_M, ROOM_M = 12.0, 8.0  # that images are apart, at most, and where they have left the room of a rival's twin
RIVAL_SCALE = 0.6  # standard deviations of an image by which a wrong place leads the right one e times less often
OFF_MAP = np.float32(-1.0)  # evidence, in standard deviations, of a place where nobody can have been

# Evidence of many images along odometry (belief/test_evidence)
FORGETTING = np.float32(0.97)  # of what was known, with every image that counts in full: some thirty of them count
COST = np.float32(2.5)  # of a step to the next cell or heading, in standard deviations of a field
STEP_EVERY = 2  # images that count in full
NEW_TURN = 1.0  # rad, after which an image counts in full: a part of the sphere sees other things

# Watch over a held place (belief/test_watch)
NEAR = 1.5  # cells from the held place, either way, that count as that place
RIGHT_MEAN, RIGHT_SIGMA = 4.0, 1.5  # of how far a right place stands out, in standard deviations
MAX_LOG_RATIO_STEP = 3.0  # no two images end a place at the default rate
NEWS = 0.5  # of an image that counts for a place on trial: images of one way resemble each other
MAX_TRIAL = 12  # images of a trial: a right place takes five to eight

# Odometry against the images (belief/test_image_motion); chosen in towns 61 and 62, `benchmarks bare contradictions`
MAX_REACH = 0.35  # way by the median range, 20 deg of parallax: beyond it images are not aligned, test_image_motion
WHEEL_SIGMA = 0.02  # m, of odometry however short the way: wheels that stand say so, but not at the very stamp
IMAGE_SIGMA = np.array([0.03, 0.03, np.radians(0.3)])  # m, m, rad: of a motion by images, however short
IMAGE_DRIFT = np.array([0.04, 0.04, np.radians(0.3)])  # and by its way: the range is that of the map, not quite there
SHARP_M = 0.1  # standard deviation by images up to which they confirm a standstill: an even wall tells nothing
MIN_NCC = 0.8  # correlation of images that are aligned; unrelated ones reach 0.77, part of the sphere 0.86
MIN_MOUNTING_ERROR = np.radians(20.0)  # between the ways of odometry and images: wheels do not slip so

# Homing, N17 section III-D (ros/test_homing)
NUM_DIRECTIONS, NUM_DISTANCES = 16, 2  # psi around the waypoint (N17 table I); d around it, beside zero
NUM_MEDIAN = 5  # images in the median of the direction
REACH = 0.6  # a waypoint closer than this, by the step of the distances, is passed
NUM_PASSED = 2  # images in a row that must say so
MIN_LEAD = 1.5  # of the best sample over the others for a clear direction, standard deviations

# Features of images and depth images, N17 section III-B (likeness/test_comparison, test_level_view)
LCN_SHARE = 1 / 18  # radius k of the local contrast normalisation by the width of a panorama: 20 degrees
LCN_SHARE_OUTDOORS = 1 / 36  # where the sky is far, what is seen is, too, and small
MIN_CONTRAST_M = 1e-3  # smallest standard deviation that contrast is divided by
FAR_M = 100.0  # range given to what is far
MIN_GRADIENT = 1e-4  # Sobel sums below this are rounding noise
SAMPLES = 2  # a side of a pixel of the panorama; a photograph that is finer by more is halved first

# Learned likeness (likeness/test_learned): what the networks were trained with (train.py of 76c5c3cb)
LCN_COLUMNS = 1 / 36, 1 / 9  # radii of the contrast normalisation by the width of a panorama: 10 and 40 degrees
MIN_CONTRAST_LEVELS = 2.0  # smallest standard deviation that grey levels are divided by
IMAGE_CLIP = np.float32(4.0)  # of the contrast
ENCODED_RANGE_M = np.float32(0.3), np.float32(200.0)  # nearest and farthest range that is told from others
MIN_SEEN = 0.9  # of the panorama that an image must show

# One image against every cell (likeness/test_gradients)
NUM_FREQUENCIES = 37  # over azimuth: structure down to ten degrees
NUM_ENERGY_FREQUENCIES = 16  # of the energy in view: a view is wide
FINENESS = 5  # curves have so many times the headings: the best counts
ROOT = 0.5  # power of an image's gradients: windows and furniture have the strongest (mcl_homes)
MIN_VIEW_SHARE = 0.1  # of the depth gradients that are expected in view: one of next to nothing has these

# Depth images of clouds (geometry/test_synthesis)
NEAREST_M = 0.2  # below which nothing is drawn
SPLAT = 1.5  # width and height of a single point by the spacing of the points, so that surfaces close
MIN_DENSE_SHARE = 0.5  # of the voxels that must be pieces of surfaces for triangles to show what splats show
NUM_NEIGHBORS = 9  # nearest voxels whose plane is that of a voxel, itself among them
NEAR_VOXELS = 2.0  # sizes of a voxel within which half of them are, on a surface; not on a line
INRADIUS = 0.75  # of the triangle of a voxel, by its size: gaps close, edges hardly grow

# Where the vehicle may be (geometry/test_area, test_floor_plan)
GROUND_STEP, GROUND_REACH = 0.5, 1.5  # m: side of a square of ground or floor; how far one lends its height
MAX_BLIND_M = 8.0  # around a scanner that saw no ground beneath it: 1.8 m up, from 13 degrees below the horizon on
MIN_FLOOR_SHARE = 0.5  # of a room's squares that have a floor
MIN_HEIGHT_M = 0.05  # of a camera above the ground; less is a mounting that nobody told (test_filter)
MESH_STEP = 0.15  # of the points that stand for a mesh in ground and area, m
MAX_OFF_WALL = 0.15  # m from an opening to its wall
MIN_PIECE, SAME_CORNER = 1e-3, 0.02  # m of a wall; between ends of walls that meet, a door and the foot of its wall

# Untrusted maps (geometry/test_files): what a file says is refused beyond these
MAX_HEADER = 1 << 16  # bytes of a file
MAX_LZF_RATIO = 300  # LZF cannot pack tighter
MAX_FACE = 255  # corners
MAX_SURFACES = 20_000  # of a floor plan: a hundred buildings; doors are compared with the walls of their room
MAX_ELEMENTS = 50_000_000  # squares of a grid, or samples of a surface
INDEX_BITS = 20  # of a voxel along an axis; three of them make one int64
LARGE_EXTENT_M, MIN_POINTS, MAX_LONELY = 1_000.0, 100, 0.5  # a wider cloud of more points; share alone in a cubic metre
# Surveys larger than memory (geometry/test_tiles)
MAX_KEPT = 6_000_000  # points, 150 MB: a square kilometre of ground and walls at half a metre
FINEST_SHARE = 2.0**-15  # of the extent: the first cubes are three centimetres of a kilometre
GROWTH = 2.0**0.5  # of cubes: half as many have a piece of a surface
# The frame of a survey (geometry/test_survey_frame)
SURVEY_SAMPLES = 400_000  # points by which axes are found
UP_RATIO = 1.5  # by which the floor must be larger than along the other axis
LEAST_STANDING = 0.003  # of the squares that must have something standing: a street of 100 m with one house
STRAY_SHARE, STRAY_RATIO = 0.001, 100.0  # of points; times the half width of the place that all the others are in
SMALL_EXTENT = 1.0  # of a place to drive, in its unit: less is kilometres
ORIGIN_STEP_M = 100.0  # of an origin: easy to read
MAX_COORDINATE_M, FAR_FROM_ORIGIN_M = 1e7, 1e5  # the size of the Earth; beyond, float32 is coarser than a centimetre

# What is compared, and where one can be (geometry/test_synthesis, geometry/test_area)
ELEVATIONS_DEG = (-42.5, 42.5)  # lowest and highest elevation of a panorama (N17)
CLEARANCE = 0.3  # m of free space around the camera, above and below it; and to a point of a floor
