"""Where the camera may be: particles, weights, hypotheses, recovery (N17 section III-C, algorithm 2)."""
