"""A drive -> lens and mounting."""
