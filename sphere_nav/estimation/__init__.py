"""Least squares on robust weights: scales, weights, elimination, covariances."""
