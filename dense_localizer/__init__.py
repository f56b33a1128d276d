"""One image -> pose in the graph of key spheres, with an honest covariance and status. READ FIRST `localizer.py`.

`inputs.py` checks the images alone, `motion_prior.py` predicts, `references/` chooses and prepares key spheres,
`track/` aligns to them and to the last image, `judge/` accepts or refuses, `start/` finds the first pose,
`constants.py` holds the numbers that results depend on.
"""
