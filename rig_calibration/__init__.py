"""Images of boards -> lenses and poses of all cameras of a rig (M15 section 4.3.1). READ FIRST `calibrate.py`."""
