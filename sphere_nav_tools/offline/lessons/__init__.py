"""New versions of a map, made of the drives that a vehicle has kept beside it."""
