"""Ray casting: rays in packets of eight through the C interface of Embree."""
