"""A town that is built once, a bare world with known answers, and what turns a camera into a question."""

from dataclasses import fields
from functools import cache

import numpy as np
import pytest

from cycab_sim import simulator as simulator_module
from cycab_sim.params import RenderParams, SimCameraParams, SimParams, SphereParams
from cycab_sim.sensors.cameras import OPTICAL
from cycab_sim.world.finishes import ASPHALT, PLASTERS
from cycab_sim.world.mesh import Finish, Mesh, MeshBuilder
from cycab_sim.world.texture import kernels as materials
from cycab_sim.world.town import build_town
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry import SE3

SEED = 5
town_of = cache(build_town)


@pytest.fixture(scope="session", autouse=True)
def shared_worlds():
    """Every simulator of these tests gets the same world of a seed: it is never changed, and a second to build."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cycab_sim.world.worlds.build_town", town_of)
        patch.setattr(simulator_module, "build_world", cache(build_world))
        yield


def describe(*parts):
    """Return one number for each array or mesh's array: its values, weighed by chance, by their root of squares.

    A seed is one world for ever: maps, drives and figures of results are of it. Who changes a world on purpose writes
    the new numbers; anything else that changes them is a fault, however small the thing is.
    """
    found = []
    for part in parts:
        for array in [getattr(part, item.name) for item in fields(part)] if isinstance(part, Mesh) else [part]:
            values = np.asarray(array, np.float64).ravel()
            weights = np.random.default_rng(len(values)).standard_normal(len(values))
            found.append(float(weights @ values / max(np.linalg.norm(values), 1e-9)))
    return found


@pytest.fixture(scope="session")
def fingerprint():
    return describe


@pytest.fixture(scope="session")
def box_mesh():
    """A ground at z = 0 and a box of 2 x 2 x 3 m whose near face is x = 5."""
    mesh = MeshBuilder(np.random.default_rng(1))
    mesh.panels([[[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]]], ASPHALT)
    plaster = Finish(materials.PLASTER, PLASTERS[0], PLASTERS[1], (0.1,))
    mesh.box([5.0, -1.0, 0.0], [2.0, 2.0, 3.0], plaster)
    return mesh.build()


@pytest.fixture(scope="session")
def small_params():
    return SimParams(
        seed=SEED,
        world="corridor",
        camera=SimCameraParams(size="160,120"),
        sphere=SphereParams(width=128),
        render=RenderParams(shadow_texel=0.5),
    )


@pytest.fixture
def looking_along_x():
    return SE3.from_parts(OPTICAL, [0.0, 0.0, 1.5])
