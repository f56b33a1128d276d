"""Pose graphs of anybody's: the best optimum with a certificate, and false loops found by graduated non-convexity."""
