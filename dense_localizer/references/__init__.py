"""Key spheres as references: choice, preparation, prefetch, what is known of their errors."""
