"""The learning phase from a recording."""
