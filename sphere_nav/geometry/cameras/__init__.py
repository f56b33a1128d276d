"""Camera models, rigs of cameras, rolling shutters."""
