"""Passes until the pose stands still, and the comparison that judges it."""
