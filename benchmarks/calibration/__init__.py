"""Benchmarks of the group calibration."""
