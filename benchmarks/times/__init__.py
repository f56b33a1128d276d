"""Benchmarks of the group times."""
