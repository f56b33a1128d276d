"""A simulated vehicle for the page: it is taught by hand, and drives by its camera once a map is chosen."""

from __future__ import annotations

from pathlib import Path

from sphere_nav_tools.cli.demo.domains import claim_domain
from sphere_nav_tools.cli.processes import Processes

SIMULATION = {
    "has_stamped_command": False,  # the clock waits for nobody
    "camera.period": 0.2,
    "camera.size": "448,336",
    "capture.when": "always",
    "capture.distance": 1.5,
}
DRIVERS = ("path_follower", "dense_localizer")
CLOCK = {"use_sim_time": True}


class SimulatedVehicle:
    """The simulator, and the nodes that drive it; they end with this."""

    def __init__(self, folder: Path) -> None:
        """`folder`: where what they say is kept."""
        logs = folder / "simulator_logs"
        logs.mkdir(exist_ok=True)
        self._processes = Processes(logs, claim_domain())
        self.is_driven = False
        self._processes.start("cycab_sim", SIMULATION)

    @property
    def environment(self) -> dict[str, str]:
        """In which others meet it."""
        return self._processes.environment

    def use(self, made: Path, taught: Path) -> str:
        """Drive by a map along the path that was taught with it; nothing moves before start is pressed."""
        self.rest()
        self._processes.start("dense_localizer", CLOCK | {"map": str(made)})
        self._processes.start("path_follower", CLOCK | {"trajectory": str(taught)})
        self.is_driven = True
        return f"{made.name}: localiser and follower start"

    def rest(self) -> str:
        """End the nodes that drive: until `use` it is driven by hand."""
        for node in DRIVERS if self.is_driven else ():
            self._processes.stop(node)
        self.is_driven = False
        return "localiser and follower have ended: drive by hand, then localise again"

    def close(self) -> None:
        """End all."""
        self._processes.__exit__(None, None, None)
