"""The types of a map, known to who writes it and to who reads it.

`sphere.py` is the augmented sphere, `graph.py` key spheres joined by measured motions, `range_codec.py` how range is
stored.
"""
