"""Rays into the world -> images."""
