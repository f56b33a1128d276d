"""Benchmarks of the group abuse."""
