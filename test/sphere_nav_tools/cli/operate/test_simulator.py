"""The simulated vehicle: its nodes start when a map is chosen, anew for another one, and end with it."""

from pathlib import Path

from sphere_nav_tools.cli.operate import simulator
from sphere_nav_tools.cli.operate.simulator import SimulatedVehicle


class Nodes:
    def __init__(self, folder, domain):
        self.environment, self.done = {"ROS_DOMAIN_ID": str(domain)}, []

    def start(self, node, values):
        self.done.append(f"+{node} {values.get('map', '')}".strip())

    def stop(self, node):
        self.done.append(f"-{node}")

    def __exit__(self, *_):
        self.done.append("end")


def test_another_map_starts_the_drivers_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(simulator, "Processes", Nodes)
    vehicle = SimulatedVehicle(tmp_path)
    for name in ("a", "b"):
        vehicle.use(Path(name), Path(f"{name}.tum"))
    vehicle.close()
    first = ["+cycab_sim", "+dense_localizer a", "+path_follower"]
    assert vehicle._processes.done == [
        *first,
        "-path_follower",
        "-dense_localizer",
        "+dense_localizer b",
        "+path_follower",
        "end",
    ]
