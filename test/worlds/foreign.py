"""A rig of another program's files, as `rig-convert` makes it."""

from sphere_nav.geometry import Rig
from sphere_nav.geometry.files.foreign_rig import place, read_foreign_cameras


def read_foreign(paths, *, frame="camera", **options) -> Rig:
    """Return the rig of files; options as of `read_foreign_cameras`."""
    return place(read_foreign_cameras(paths, **options), frame, paths[0])
