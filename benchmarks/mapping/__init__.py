"""Maps: what their parts measure."""
