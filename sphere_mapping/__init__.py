"""Images with range -> spheres -> key-sphere graph -> map. READ FIRST `mapper.py`.

`sphere.py` is what is mapped, `partial.py` and `stereo.py` make it from one RGB-D or stereo camera, `graph.py` is the
map, `range_codec.py` is how it stores range.
"""
