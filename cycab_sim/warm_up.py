"""Compile the kernels of the simulator on images too small to cost anything."""

from __future__ import annotations

from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.params import build

SMALL = {
    "camera.size": "32,24",
    "sphere.width": 64,
    "render.shadow_texel": 2.0,
    "traffic.density": "usual",
}


def warm_up() -> None:
    """Draw a camera and a sphere in traffic; half a minute, or seconds where the cache has the kernels."""
    simulator = Simulator(build(SimParams, SMALL))
    for name in ("camera", "sphere"):
        simulator.capture(name)
