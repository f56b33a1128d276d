"""Images with range -> spheres -> key-sphere graph -> map. READ FIRST `mapper.py`.

`acquisition/` makes spheres of images: of a rig, of an RGB-D or of a stereo camera. `graph/` aligns spheres, finds
loops and optimizes. `constants.py` holds the numbers that mapping depends on; `ros/` is the node `sphere_mapper`.
"""
