"""Range of a sphere: matching, triangulation, fusion, plausibility."""
