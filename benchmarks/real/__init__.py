"""Benchmarks of the group real."""
