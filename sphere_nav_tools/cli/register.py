"""`sphere_nav register`: the motion between two spheres, RGB-D images or stereo pairs, as JSON."""

from __future__ import annotations

import argparse
import json
import sys

from sphere_nav.geometry import SE3
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.mapping.sphere_source import read_sphere
from sphere_nav_tools.offline.registering import describe_refusal, register_spheres
from sphere_nav_tools.offline.settings import add, floats, read_pose, read_positive

HELP = """\
Align B with A and print the pose of B in A as JSON: T_a_b, covariance of (v, omega) in T_a_b @ exp(xi), residual.

A and B are PATH:NUMBER, an instant of a bag (spheres, RGB-D or stereo; counted from 0) or a key sphere of a map; or
two files IMAGE,DEPTH (16 bit, or .npy in m) or LEFT,RIGHT (rectified, with --baseline). Axes of the result: x forward,
y left, z up. The motion may be large: features with range give the first guess, and aligning A with B must agree with
aligning B with A. Exit status 1 where the alignment is refused; the JSON and one line say why and what would help.

examples:
  sphere_nav register kitchen:0 kitchen:10
  sphere_nav register recording:0 recording:10 --driver realsense
  sphere_nav register color0.png,depth0.png color9.png,depth9.png --camera 525,525,319.5,239.5 --depth-units 5000
  sphere_nav register l0.png,r0.png l1.png,r1.png --camera 707.09,707.09,601.89,183.11 --baseline 0.537
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "a", "A", "reference, with range")
    add(parser, "b", "B", "what is aligned with it")
    add(parser, "--camera", "FX,FY,CX,CY", "px, of image files", floats("FX,FY,CX,CY", 4))
    add(parser, "--baseline", "M", "m; the files are rectified stereo pairs", read_positive)
    add(parser, "--depth-units", "N", "depth units per m (%(default)s)", float, default=1000.0)
    add(parser, "--guess", "x,y,z,qx,qy,qz,qw", "first guess of T_a_b (identity)", read_pose, default=SE3.identity())
    topics.add_options(parser, has_cameras=False)


def run(arguments: argparse.Namespace) -> int:
    """Read both, align, print."""
    a, b = (read_sphere(word, arguments) for word in (arguments.a, arguments.b))
    found = register_spheres(a, b, arguments.guess)
    print(json.dumps(found.values(), indent=2))
    if not found.is_converged:
        print(f"sphere_nav register: {arguments.b}: {describe_refusal(found.reason)}", file=sys.stderr)
    return 0 if found.is_converged else 1
