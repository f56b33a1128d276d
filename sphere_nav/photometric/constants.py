"""Numbers that alignments and their checks depend on, with unit, origin and the test that notices a change.

What a user may set is in `params.py`; what compiled code uses is beside it, in its `kernels.py`, as the cache of
compiled kernels goes by their text.
"""

# Alignment
STUCK = 25.0  # times `min_step`: an increment as large at the end is no convergence; test_judgement
ROTATION_ITERATIONS = 10  # of a pure rotation, M15 section 6.1; test_rotation
TURN_PIXELS, MIN_TURN_PIXELS = 400, 50  # of a level, compared after a turn, and fewest of them; test_rotation
MAX_SHIFT = 0.1  # of the image's width: a selection is used again while the image has moved less; test_selection
LATE_SHIFT = 0.2  # the same, while another thread selects; test_selection

# Checks of the residuals: a few thousand pixels, all references together, and fewest of a view
NUM_SAMPLES, MIN_SAMPLES = 2048, 100  # test_samples, test_structure
NUM_REWEIGHTINGS = 2  # times that robust weights are found; one is too few (test_bias), a third changes little
LENS_PIECES = 24  # of the pixels in scan order, whose scatter is the deviation of the stretch; test_structure

# Illumination gradient
GRADIENT_ORDER = 2  # half periods of the gain across the image, both axes together; test_illumination
GRADIENT_SHARE = 0.2  # of the squared residuals that it explains; noise explains 0.03 at most; test_illumination
GRADIENT_STEPS, LAST_GRADIENT_STEP = 6, 0.1  # steps at most, and share of the bias that is the last; test_illumination

# Occlusion
COLUMNS, ROWS = 8, 6  # cells of an image; test_occlusion
MIN_CELL_PIXELS, MIN_VIEW_PIXELS = 12, 50  # of a cell, of a view, to be used; test_occlusion
TYPICAL_QUANTILE = 0.75  # of the cells' cosines: what counts as agreement; test_occlusion
MIN_COSINE_RATIO = 0.5  # of the typical cosine, below which a cell shows something else; test_occlusion
CELL_SIGMAS = 3.0  # by which a cell must be below: by chance one in 700 that is just there; test_occlusion
MIN_VISIBLE_SHARE = 0.3  # of the pixels, below which nothing can be said without the occluded ones; test_occlusion
OCCLUSION_SHARE = 0.1  # of the texture, below which nothing is occluded; test_occlusion
OCCLUSION_STEPS, LAST_OCCLUSION_STEP_RAD = 6, 1e-3  # steps at most, and median motion that is the last; test_occlusion
