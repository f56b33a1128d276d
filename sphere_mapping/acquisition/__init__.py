"""The images of a rig at one instant -> an augmented sphere (M15 section 4.3). READ FIRST `stitcher.py`.

`views.py` says which pixel of which camera a pixel of the sphere is, `exposure.py` and `blending.py` make one image
of them, `matching.py` and `epipolar.py` find range between two spheres with a baseline, `pairs.py` does it for cameras
side by side, `fusion.py` joins ranges by their variance.
"""
