"""Numbers that commands depend on and nobody would set: unit, origin, and the test that pins each group.

Tests are named below test/sphere_nav_tools/cli/. Sizes of what is drawn stand where it is
drawn.
"""

# The page of an operator (operate/test_operate, operate/test_page)
ANSWER_S = 5.0  # to wait for the answer to a call
RECENT_S = 2.0  # to wait for the state that shows that it was done; of pictures: wanted, new, told how many come
STOP_ANSWER_S, LOAD_S = 1.0, 60.0  # the same for an emergency stop; to wait for a path or a map to be read
WITHDRAW_S = 0.5  # from a release of the emergency stop until nobody publishes it any more
PERIOD_S = 0.2  # between two looks at what was heard, and at who hears
ALIVE_S = 0.4  # within which a browser has to answer where the dead-man switch is on
HELD_S, STRIDE_S = 0.25, 0.05  # since a held button was told of, until zero; between two such words, and commands
SILENT_S, SELDOM_S = 1.5, 3.0  # after which what a node said holds no more; a navigator says it less often, as images

# Who is let in to a page (test_gate)
MIN_TOKEN = 8  # characters
MAX_GUESSES, GUESS_S = 10, 1.0  # wrong tokens of one visitor at once; s until one more is looked at
MAX_VISITORS = 1000  # whose guesses are counted; as many wrong tokens are remembered
MAX_OUTSIDE = 64  # connections that are not admitted

# A demonstration, and whether it goes on (demo/test_demo, demo/test_watch)
MAX_LATERAL = 0.25  # m, further is off the path (M15 section 6.4.3 stays within it)
MIN_DRIVEN = 0.95  # share of the path that must be driven
PAUSE_AT = 4.0  # s of simulated time at which it stands until the follower is armed: found after half a second
SILENCE = 600.0  # s in which the car stands that end one: kernels are compiled in two minutes on two quiet cores
LOOK_S = 0.02  # between two looks at what still runs, and whether what was asked for is done

# A recording (test_mcl)
MAX_LEAP_S = 3600.0  # between images of a recording, which may be far apart
