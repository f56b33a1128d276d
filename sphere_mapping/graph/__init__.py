"""Spheres joined to a graph: registration, key spheres, loops, optimisation (M15 sections 3.4 and 3.5)."""
