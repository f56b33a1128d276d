"""Numbers that alignments and their checks depend on, with unit, origin and the test that notices a change.

What a user may set is in `params.py`; what compiled code uses is beside it, in its `kernels.py`, as the cache of
compiled kernels goes by their text.
"""

import numpy as np

# Alignment
MIN_SIGMA = 1.0  # grey level, smallest standard deviation assumed for a residual; align/test_problem
STUCK = 25.0  # times `min_step`: an increment as large at the end is no convergence; test_esm
EXPECTED_SIGMAS = 2.0  # beyond so many standard deviations an expectation pulls no harder; align/test_problem
TURN_PIXELS = 400  # of a level, compared after a turn; test_problem
MIN_VIEW_PIXELS = 50  # fewest of a view, or of such a level, to be used; test_occlusion, test_problem
MAX_SHIFT = 0.1  # of the image's width: a selection is used again while the image has moved less; test_reference
OVERLAP_CELL = 3  # pixels of the coarsest level: so wide that a covered cell holds a reference pixel; test_problem
SHARPER_LEVELS, MIN_LEVELS = 0.35, 2  # an image of 0.8 to 1.6 times the pixels of the map; levels kept; test_pyramid
CONE_GRID = 33  # rows and columns of pixels that show what a camera sees; test_reference
CONE_MARGIN = np.radians(3.0)  # of the cone: rays bend between two of those pixels; test_reference
SQUARE_MARGIN = 1e-4  # rad, of the cone of a square: float32; pixels/test_kernels
MAX_VIEWS, MIN_SQUARES = 1.25, 512  # squares kept: by those of one view, and in any case; test_reference

# Behind the edge of a nearer surface: one pixel of the image and one of the gradient; share of the nearer inverse range
EDGE_PIXELS, EDGE_SHARE = 2, 0.05  # test_reference, test_esm

# Checks of the residuals: a few thousand pixels, all references together, and fewest of a view
NUM_SAMPLES = 2048  # test_samples
NUM_REWEIGHTINGS = 2  # times that robust weights are found; one is too few (test_structure), a third changes little
BIAS_STEPS = 6  # at most, to a pose without a bias; test_occlusion

# Local contrast (pixels/test_contrast, docs/notes/contrast.md)
CONTRAST_ANGLE, CONTRAST_PIXELS = 0.04, 8.0  # rad: standard deviation of the window; px of a sphere, at least
CONTRAST_FLOOR = 6.0  # grey levels, added to the deviation of a window: noise of a camera is a third of it
CONTRAST_MEAN, CONTRAST_SCALE = 128.0, 40.0  # of the bytes: three deviations either way
CONTRAST_STEPS = 2.0  # standard deviation of the window, in the blocks by which it is found

# Occlusion
CELLS = (8, 6)  # columns and rows of an image, wherever it is cut; test_occlusion, rig_calibration/boards/test_quality
MIN_CELL_PIXELS = 12  # of a cell, to be used, or asked; test_occlusion, parts/test_registration
TYPICAL_QUANTILE = 0.75  # of the cells' cosines: what counts as agreement; test_occlusion
MIN_COSINE_RATIO = 0.5  # of the typical cosine, below which a cell shows something else; test_occlusion
CELL_SIGMAS = 3.0  # by which a cell must be below: by chance one in 700 that is just there; test_occlusion
MIN_VISIBLE_SHARE = 0.3  # of the pixels, below which nothing can be said without the occluded ones; test_occlusion
OCCLUSION_SHARE = 0.1  # of the texture, below which nothing is occluded; test_occlusion
LAST_OCCLUSION_STEP_RAD = 1e-3  # median motion, below which a step is the last; test_occlusion

# The lens: level above the finest one, fits with new weights, fewest cells of all views; test_lens
LENS_LEVEL, LENS_REWEIGHTINGS, MIN_LENS_CELLS = 2, 4, 16
# A longer one: by steps, at most by so much an image, each where the stretch is so many deviations; share of the
# residuals' deviation that it must leave: 0.94 at least for 19 right lenses, 0.9 at most for 9 wrong ones; test_lens
LENS_STEP, MAX_LENS_STEP, LENS_DOUBT, LENS_LEFT = 1.02, 0.1, 2.0, 0.91

# Parts of the view that show the map (parts/)
PARTS = (12, 8)  # columns and rows of an image, wherever it is cut; parts/test_registration
REACH, NEAR_SHIFT = 8, 1  # px, by which cells are shifted, and that counts as none; parts/test_registration
FITTED_CELLS = 3  # that a fit of six numbers can bring to agree; parts/test_registration
STRENGTH_QUANTILE = 0.9  # of gradients, above which they count alike; parts/test_registration
NUM_TRIED_MOTIONS = 300  # sets of cells that motions are fitted to; where a third agrees, 11 of them are of such
MIN_SHIFT_SIGMA_PX = 0.3  # standard deviation of a shift, at least; parts/test_registration
MIN_PARTS_SIDE, PART_ROUNDS = 44, 2  # px of the coarsest level that is used; fits at each; parts/test_registration
SURE_CHANCE = 1e-12  # of an alignment by parts, beyond which no other one is begun; parts/test_registration

# Where they speak for the pose of an alignment
MAX_CHANCE, MAX_PREDICTED_CHANCE = 1e-5, 1e-7  # of as many cells in a wrong place; of a prediction; test_support
SURE_AGREEMENT, SURE_NCC = 0.3, 0.65  # below either the parts are asked; wrong rooms reach 0.63; test_support
