"""Benchmarks: `python -m benchmarks [NAME ...]` prints the tables of docs/results.md as this machine measures them."""
