"""The rig of the simulated car, and what its six cameras see along the path of a world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.geometry import Rig
from sphere_nav.params import build

BEGIN_M = 5.0  # along the path


def rig_in_world(seed: int, width: int, values: Mapping[str, Any]) -> tuple[Simulator, Rig]:
    """Return the simulator of a seed and the rig of its car, for spheres so many px wide; `values`: more parameters."""
    side = width * 17 // 32
    given = {"seed": seed, "rig.kind": "vertical", "rig.size": f"{side},{side}"}
    simulator = Simulator(build(SimParams, given | dict(values)))
    assert simulator.rig is not None
    return simulator, simulator.rig


def images_of(simulator: Simulator) -> dict[str, NDArray[np.uint8]]:
    """Return what the cameras see now, by name."""
    return {name: frame.image for name, frame in simulator.capture_rig().items()}


def images_along(simulator: Simulator, number: int, spacing_m: float) -> Iterator[dict[str, NDArray[np.uint8]]]:
    """Yield what the cameras see at so many places along the path."""
    for index in range(number):
        simulator.teleport(*simulator.path.at(BEGIN_M + spacing_m * index).tolist()[:3])
        yield images_of(simulator)
