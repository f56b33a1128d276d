"""Benchmarks of the group drive."""
