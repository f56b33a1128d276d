"""A sphere in less than half of its bytes, for maps with a budget: grey, its range as fine as stereo tells it at best.

Grey levels are rounded, no more: where JPEG blurs weak edges, starts in another light take longer
(docs/notes/experiences.md). Colour is gone; the deviation of the range is kept coarsely.
"""

from __future__ import annotations

from sphere_nav.spheres import range_codec
from sphere_nav.spheres.constants import CONDENSED_DEVIATION, CONDENSED_RANGE
from sphere_nav.spheres.sphere import Sphere, to_gray_bytes


def condensed_sphere(sphere: Sphere) -> Sphere:
    """Return the sphere in grey, its range and the deviation of it rounded to multiples of their codes."""
    codes = range_codec.coarse_ranges(range_codec.encode_ranges(sphere.range_m), CONDENSED_RANGE)
    range_m, range_std_m = range_codec.decode_ranges(codes), None
    if sphere.range_std_m is not None:
        ratios = range_codec.encode_deviation(sphere.range_std_m, range_m)
        ratios = range_codec.coarse_deviation(ratios, CONDENSED_DEVIATION)
        range_std_m = range_codec.decode_deviation(ratios, range_m)
    return Sphere(to_gray_bytes(sphere.image), range_m, sphere.camera, sphere.stamp_ns, range_std_m)
