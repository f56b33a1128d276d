"""The images of a rig at one instant -> an augmented sphere (M15 section 4.3). READ FIRST `stitching/stitcher.py`.

`stitching/` says which pixel of which camera a pixel of the sphere is, and blends; `light/` makes exposures equal;
`range/` measures between two levels (`vertical.py`) or by a sweep (`sweep.py`) and joins sources by their variance
(`fusion.py`). `partial/` and `stereo/` make spheres of one RGB-D or stereo camera; `ros/` is `sphere_stitcher`.
"""
