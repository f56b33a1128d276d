"""A panorama localised in bare geometry (Neubert, Schubert, Protzel 2017).

READ FIRST `filter.py`, the Monte Carlo localisation. The images: `synthesis.py` draws what the map looks like from a
place (from a cloud, `splats.py`, or from surfaces, `mesh.py`), `gradients.py` or `learned.py` compares
it with a photograph that `level_view.py` has resampled. Maps come through
`geometry/files.py`.
"""
