"""The map without colour: files, clouds, meshes, columns of voxels -> depth panoramas (N17 section III-A)."""
