"""The training of the learned likeness of `mcl_depth`."""
