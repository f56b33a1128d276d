"""Bounded reading of text files, rig files and foreign calibrations."""
