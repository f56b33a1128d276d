"""One cache of compiled kernels for all processes: `kernels.py` is numba as this project uses it."""
