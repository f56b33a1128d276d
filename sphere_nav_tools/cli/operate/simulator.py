"""A simulated vehicle for the page: it is taught by hand, and drives by its camera once a map is chosen."""

from __future__ import annotations

from pathlib import Path

from path_follower.routes.network_file import network_path
from sphere_nav_tools.cli.processes import Processes, claim_domain

SIMULATION = {
    "has_stamped_command": False,  # the clock waits for nobody
    "camera.period": 0.2,
    "camera.size": "448,336",
    "capture.when": "always",
    "capture.distance": 1.5,
}
CLOCK = {"use_sim_time": True}
SIMULATOR, NAVIGATOR = "cycab_sim", "route_navigator"


class SimulatedVehicle(Processes):
    """The simulator, and the nodes that drive it; they end with this."""

    def __init__(self, folder: Path) -> None:
        """`folder`: where what they say is kept."""
        super().__init__(folder / "simulator_logs", claim_domain())
        self.start(SIMULATOR, SIMULATION)

    @property
    def is_driven(self) -> bool:
        """Whether the nodes that drive run."""
        return len(self.running) > 1

    def use(self, made: Path, taught: Path) -> str:
        """Drive by a map along the path that was taught with it; nothing moves before start is pressed."""
        self.rest()
        self.start("dense_localizer", CLOCK | {"map": str(made)})
        self.start("path_follower", CLOCK | {"trajectory": str(taught)})
        self.guide(made)
        return f"{made.name}: localiser and follower start"

    def guide(self, made: Path) -> None:
        """Start the node that drives to the places of a map, anew after one was named."""
        if NAVIGATOR in self.running:
            self.stop(NAVIGATOR)
        if network_path(made).exists():
            self.start(NAVIGATOR, CLOCK | {"network": str(network_path(made))})

    def rest(self) -> str:
        """End the nodes that drive: until `use` it is driven by hand."""
        for node in [node for node in reversed(self.running) if node != SIMULATOR]:
            self.stop(node)
        return "localiser and follower have ended: drive by hand, then localise again"
