"""Range panoramas of dense clouds: voxels in columns over a grid, walked through outwards along every azimuth.

`voxel_map.py` makes the columns of a cloud, `walker.py` draws with them; the loops are in `kernels.py`.
"""
