"""What stands between commands and a base that has no time-out of its own."""
