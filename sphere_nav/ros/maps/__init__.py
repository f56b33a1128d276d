"""Maps as bags: read, write, check."""
