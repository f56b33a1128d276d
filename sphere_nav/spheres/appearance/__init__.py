"""Which key sphere looks like an image: local features, words, an index that does not care for heading."""
