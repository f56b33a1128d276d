"""Benchmarks: `python -m benchmarks [NAME ...]` prints the rows of docs/results.md as this machine measures them."""

import sys
from pathlib import Path

from sphere_nav.ros.shared_files import use_one_thread

sys.path.append(str(Path(__file__).resolve().parents[1] / "test"))  # its worlds
use_one_thread()  # as nodes and commands do
