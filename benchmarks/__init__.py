"""Benchmarks: `python -m benchmarks [NAME ...]` prints the rows of docs/results.md as this machine measures them."""

from sphere_nav.ros.shared_files import use_one_thread

use_one_thread()  # as nodes and commands do
