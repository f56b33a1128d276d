"""Least squares: robust weights, scaled solves, elimination, covariances of dependent errors, gates.

The nearest rotation is where rotations are: `geometry/so3.py`.
"""
