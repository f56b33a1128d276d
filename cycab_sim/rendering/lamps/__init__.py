"""What lamps reach, as a kernel."""
