"""A drive -> lens, mounting and depth camera."""
