"""Where the camera may be: particles, weights, hypotheses, evidence (N17 section III-C, algorithm 2)."""
