"""Towns, streets, buildings, traffic and their textures."""
