"""One image -> pose in the graph of key spheres, with an honest covariance and status. READ FIRST `localizer.py`.

`input_check.py` looks at the image alone, `motion_prior.py` predicts, `reference.py` chooses and prepares key spheres,
`acceptance.py` judges, `status.py` says how far to trust, `startup.py` finds the first pose, `reasons.py` is the
vocabulary.
"""
