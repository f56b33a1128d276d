"""Instants of a rig: what waits for a cloud, what is told of every camera, where a LiDAR is."""

import numpy as np

from sphere_mapping.acquisition.params import SphereStitcherParams
from sphere_mapping.acquisition.ros.rig_intake import Clouds, RigIntake
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import array_to_image, cloud_to_message
from sphere_nav.ros.node import ERROR, OK, WARN, ManagedNode
from sphere_nav.ros.tf import TransformTree
from worlds.rig import RIG_NAMES, vertical_rig

MS = 1_000_000


class Keeper(ManagedNode):
    NAME = "keeper"
    PARAMS = SphereStitcherParams

    def configure(self):
        self.instants = []
        lookup = TransformTree().lookup
        self.intake = RigIntake(vertical_rig(), self.params, self.now_ns, lookup, self.instants.extend)
        self.intake.subscribe(self.endpoints)
        self.add_timer(0.05, self.intake.close_late)


def send(bus, topic, message):
    bus.publish(topic, message)
    for _ in bus.settle():
        pass


def shoot(bus, stamp, level=0, names=RIG_NAMES):
    for number, name in enumerate(names):
        image = np.full((160, 160), 10 + number + level, np.uint8)
        send(bus, f"/cameras/{name}/image_raw", array_to_image(image, stamp, name, "mono8"))


def wait(bus, stamp):
    for _ in bus.advance(stamp):
        pass


def test_an_instant_waits_for_a_cloud_that_is_not_older_but_not_for_ever():
    bus = OfflineBus()
    node = bus.add(Keeper, {"has_cloud": True, "sync.deadline_s": 0.2})
    wait(bus, 1000 * MS)
    send(bus, "/points", cloud_to_message(np.ones((1, 3), np.float32), 960 * MS, "rig_link"))
    shoot(bus, 1000 * MS)
    assert node.instants == []
    send(bus, "/points", cloud_to_message(np.full((1, 3), 2, np.float32), 1010 * MS, "rig_link"))
    assert node.instants[0].points[0, 0] == 2.0
    shoot(bus, 1100 * MS, level=50)
    wait(bus, 1600 * MS)
    assert len(node.instants) == 2
    assert node.instants[1].points is None
    assert {what: level for what, level, *_ in node.intake.health()}["points"] == WARN


def test_every_camera_is_reported():
    bus = OfflineBus()
    node = bus.add(Keeper)
    for number in range(5):
        stamp = (1000 + 100 * number) * MS
        wait(bus, stamp)
        shoot(bus, stamp, level=20 * number, names=RIG_NAMES[2:])
        shoot(bus, stamp, names=RIG_NAMES[:1])  # always the same; the second one is missing
    wait(bus, 2000 * MS)
    found = {what: level for what, level, *_ in node.intake.health()}
    levels = [found[f"camera {name}"] for name in RIG_NAMES[:3]]
    assert levels == [ERROR, WARN, OK]
    assert len(node.instants) == 5
    assert set(node.instants[-1].images) == set(RIG_NAMES[2:])


def test_what_is_open_at_the_end_is_handed_out():
    bus = OfflineBus()
    node = bus.add(Keeper)
    shoot(bus, 1000 * MS, names=RIG_NAMES[:2])
    assert node.instants == []
    node.intake.finish()
    assert set(node.instants[0].images) == set(RIG_NAMES[:2])


def test_the_first_instants_come_together_when_they_are_to_correct_the_rig():
    bus = OfflineBus()
    node = bus.add(Keeper, {"rectify.num_instants": 3})
    for number in range(4):
        assert len(node.instants) == (0 if number < 3 else 3)
        shoot(bus, (1000 + 100 * number) * MS, level=20 * number)
    assert [instant.sync.stamp_ns for instant in node.instants] == [1000 * MS, 1100 * MS, 1200 * MS, 1300 * MS]


def cloud(value):
    return np.full((1, 3), value, np.float32)


def test_the_nearest_in_time_is_taken_within_the_limit():
    clouds = Clouds()
    assert clouds.at(0) is None
    clouds.add(100 * MS, cloud(1))
    clouds.add(200 * MS, cloud(2))
    assert clouds.at(120 * MS)[0, 0] == 1
    assert clouds.at(170 * MS)[0, 0] == 2
    assert clouds.at(261 * MS) is None
    assert clouds.has_since(200 * MS)
    assert not clouds.has_since(201 * MS)
    clouds.clear()
    assert clouds.at(100 * MS) is None
