"""A panorama localised in bare geometry (Neubert, Schubert, Protzel 2017).

READ FIRST `filter.py`, the Monte Carlo localisation. The images: `synthesis.py` draws what the map looks like from a
place (`mesh.py` casts its rays), `gradients.py` or `learned.py` compares
it with a photograph that `level_view.py` has resampled. Maps come through
`geometry/files.py`.
"""
