"""Numbers that states and refusals depend on, with unit, origin and the test that notices a change.

Tests are named below test/sphere_nav/localization/, or test/sphere_nav/ros/ for those of several cameras.
"""

# What is refused of an image (test_input_check; ros/camera/test_synchronizer)
SAMPLE_STEP = 4  # every fourth pixel of every fourth row is enough for brightness, contrast and equality
DARK_LEVEL, BRIGHT_LEVEL = 6.0, 250.0  # grey levels up to, and from, which a pixel counts as clipped
MAX_CLIPPED_SHARE = 0.9  # of the pixels, above which an image shows nothing
MIN_CONTRAST = 3.0  # grey levels, standard deviation of an image that shows anything: above the noise of a sensor
FROZEN_IMAGES = 3  # repeats in a row: with noise not even two images are the same
CLOCK_JUMP_IMAGES = 3  # in a row make a leap of the stamps a new time

# States (test_status)
RECOVERY_IMAGES = 2  # good images in a row from DEGRADED to TRACKING
MAX_PROBATION_FACTOR = 16  # bound of the doubling of the probation by losses
PROVEN_IMAGES = 2  # that a good image counts for on probation whose place is proven: by its parts, or by all images
FORGIVE_NS = 60_000_000_000  # of tracking, after which one loss is forgotten
