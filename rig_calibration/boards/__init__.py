"""Images of boards -> lenses and poses of all cameras of a rig."""
