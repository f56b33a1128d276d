"""A simulated vehicle for the page: it is taught by hand, and drives by its camera once a map is chosen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from path_follower.routes.network_file import network_path
from sphere_nav_tools.cli.demo.domains import claim_domain
from sphere_nav_tools.cli.processes import Processes

SIMULATION = {
    "has_stamped_command": False,  # the clock waits for nobody
    "camera.period": 0.2,
    "camera.size": "448,336",
    "capture.when": "always",
    "capture.distance": 1.5,
}
CLOCK = {"use_sim_time": True}
NAVIGATOR = "route_navigator"


class SimulatedVehicle:
    """The simulator, and the nodes that drive it; they end with this."""

    def __init__(self, folder: Path) -> None:
        """`folder`: where what they say is kept."""
        logs = folder / "simulator_logs"
        logs.mkdir(exist_ok=True)
        self._processes = Processes(logs, claim_domain())
        self._drivers: list[str] = []
        self._processes.start("cycab_sim", SIMULATION)

    @property
    def environment(self) -> dict[str, str]:
        """In which others meet it."""
        return self._processes.environment

    @property
    def is_driven(self) -> bool:
        """Whether the nodes that drive run."""
        return bool(self._drivers)

    def use(self, made: Path, taught: Path) -> str:
        """Drive by a map along the path that was taught with it; nothing moves before start is pressed."""
        self.rest()
        self._drive("dense_localizer", {"map": str(made)})
        self._drive("path_follower", {"trajectory": str(taught)})
        self.guide(made)
        return f"{made.name}: localiser and follower start"

    def guide(self, made: Path) -> None:
        """Start the node that drives to the places of a map, anew after one was named."""
        if NAVIGATOR in self._drivers:
            self._drivers.remove(NAVIGATOR)
            self._processes.stop(NAVIGATOR)
        if network_path(made).exists():
            self._drive(NAVIGATOR, {"network": str(network_path(made))})

    def _drive(self, node: str, values: dict[str, Any]) -> None:
        self._processes.start(node, CLOCK | values)
        self._drivers.append(node)

    def rest(self) -> str:
        """End the nodes that drive: until `use` it is driven by hand."""
        while self._drivers:
            self._processes.stop(self._drivers.pop())
        return "localiser and follower have ended: drive by hand, then localise again"

    def close(self) -> None:
        """End all."""
        self._processes.__exit__(None, None, None)
