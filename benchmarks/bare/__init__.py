"""Benchmarks of the group bare."""
