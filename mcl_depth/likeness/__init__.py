"""How well an image fits a depth panorama: features, comparison, compass, and the caches (N17 section III-B)."""
