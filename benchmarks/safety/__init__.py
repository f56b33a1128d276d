"""Benchmarks of the group safety."""
