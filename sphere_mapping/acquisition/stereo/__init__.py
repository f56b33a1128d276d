"""Range from one stereo pair, and what its lenses leave in the disparity."""
