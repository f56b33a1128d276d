"""Spheres joined to a graph: registration, key spheres, loops, optimization (M15 sections 3.4 and 3.5)."""
