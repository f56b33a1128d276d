"""Hashed noise and periodic patterns, filtered by a footprint."""
