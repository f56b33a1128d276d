"""After the warm-up no image of the simulator waits for a kernel."""

import pytest

from cycab_sim.params import SimParams
from cycab_sim.rendering import kernels
from cycab_sim.simulator import Simulator
from cycab_sim.warm_up import warm_up
from cycab_sim.world.noise import kernels as noise
from cycab_sim.world.texture import kernels as texture
from sphere_nav.params import build

pytestmark = pytest.mark.slow


def test_cameras_of_every_kind_use_what_is_compiled():
    warm_up()
    every = [*vars(kernels).values(), *vars(noise).values(), *vars(texture).values()]
    compiled = {kernel: len(kernel.signatures) for kernel in every if hasattr(kernel, "signatures")}
    assert compiled
    small = {"size": "32,24"}
    rig = {f"rig.{name}": value for name, value in (small | {"kind": "ring"}).items()}
    camera = {f"camera.{name}": value for name, value in (small | {"model": "fisheye"}).items()}
    fast = {"sphere.width": 32, "render.shadow_texel": 2.0, "traffic.density": "usual"}
    Simulator(build(SimParams, rig | camera | fast)).capture_rig()
    assert {kernel: len(kernel.signatures) for kernel in compiled} == compiled
