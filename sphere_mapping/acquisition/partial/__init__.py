"""Partial spheres from one camera with range."""
