"""Benchmarks: `python -m benchmarks [NAME ...]` prints the rows of docs/results.md as this machine measures them."""
