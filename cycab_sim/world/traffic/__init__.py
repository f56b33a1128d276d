"""What moves in the streets: figures on closed loops, where they are a function of time alone."""
