"""Commands for bags."""
