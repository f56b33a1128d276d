"""The first pose, and the one after a loss."""
