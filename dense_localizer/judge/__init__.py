"""Whether a pose is accepted, and what speaks against it."""
