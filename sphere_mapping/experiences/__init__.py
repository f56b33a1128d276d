"""A drive in another light joined to a map, what of it is kept, and what leaves when there is too much."""
