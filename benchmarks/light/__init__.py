"""Benchmarks of the group light."""
