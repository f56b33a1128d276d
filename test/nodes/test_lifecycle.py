"""Lifecycles of every node over real DDS, by an outside manager that takes its time: no handle is left behind."""

import os

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

from config.test_yaml_matches_params import NODES
from path_follower.routes.building import build_network
from path_follower.routes.network_file import write_network
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.live import LiveShell
from worlds.curves import straight_road
from worlds.patience import wait_until
from worlds.rig import vertical_rig

SETTLED = 2  # lifecycles after which the libraries have what they keep
CYCLES = 4


@pytest.fixture(scope="module")
def values(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lives")
    with BagWriter(folder / "bag") as bag:
        bag.write("text", String(data="0"), 0)
    write_rig(folder / "rig.yaml", vertical_rig())
    write_network(folder / "routes.geojson", build_network([straight_road(20.0)]))
    return {
        "route_navigator": {"network": str(folder / "routes.geojson")},
        "bag_player": {"bag": str(folder / "bag"), "wait_for": "text"},
        "bag_recorder": {"topics": "text", "output": str(folder / "recorded")},
        "sphere_mapper": {"map_folder": str(folder / "maps")},
        "sphere_stitcher": {"rig": str(folder / "rig.yaml"), "stitch.width": 128},
        "cycab_sim": {"world": "corridor", "camera.period": 0.0},
    }


def entities(shell):
    return sum(len(list(items)) for items in (shell.subscriptions, shell.publishers, shell.services, shell.timers))


@pytest.mark.dds
@pytest.mark.parametrize("node_class", NODES, ids=lambda node_class: node_class.NAME)
def test_a_node_lives_again_and_again_by_its_manager_and_leaves_nothing_behind(node_class, values, tmp_path):
    """What is latched between configure and activate is kept; open files and entities do not grow."""
    rclpy.init()
    executor = SingleThreadedExecutor()
    overrides = [Parameter(name, value=value) for name, value in values.get(node_class.NAME, {}).items()]
    shell, manager = LiveShell(node_class, parameter_overrides=overrides), Node("manager")
    executor.add_node(shell)
    executor.add_node(manager)
    client = manager.create_client(ChangeState, f"{node_class.NAME}/change_state")

    def until(is_done):
        assert wait_until(is_done, 60.0, lambda: executor.spin_once(timeout_sec=0.05))

    def change(number):
        answer = client.call_async(ChangeState.Request(transition=Transition(id=number)))
        until(answer.done)
        assert answer.result().success

    until(client.service_is_ready)
    publishers, handles, counts = {}, [], []
    for cycle in range(CYCLES):
        if node_class.NAME == "bag_recorder":
            shell.set_parameters([Parameter("output", value=str(tmp_path / str(cycle)))])
        change(Transition.TRANSITION_CONFIGURE)
        latched = [item for item in shell.node.inputs if item.profile.durability == qos.TRANSIENT_LOCAL]
        for item in latched:
            topic = item.handle.topic_name
            if topic not in publishers:
                publishers[topic] = manager.create_publisher(item.kind, topic, qos.LATCHED)
                publishers[topic].publish(item.kind())
        until(lambda latched=latched: all(item.kept for item in latched))
        change(Transition.TRANSITION_ACTIVATE)
        until(lambda latched=latched: shell.is_active and all(item.num_received for item in latched))
        change(Transition.TRANSITION_DEACTIVATE)
        change(Transition.TRANSITION_CLEANUP)
        handles.append(len(os.listdir("/proc/self/fd")))
        counts.append(entities(shell))
    assert len(set(counts)) == 1
    assert max(handles[SETTLED:]) - handles[SETTLED] <= 1  # one: a discovery of that moment
    for node in (shell, manager):
        node.destroy_node()
    executor.shutdown()
    rclpy.shutdown()
