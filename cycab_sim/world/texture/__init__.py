"""Solid procedural detail: materials and the sky, as means over the footprint of a ray."""
