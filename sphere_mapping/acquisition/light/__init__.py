"""Exposure, vignetting and balance of the cameras of a rig."""
