"""Bags of sqlite3, compressed bags and bags of ROS 1, written by another library."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import CameraInfo, Image

from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
START_NS, STEP_NS, NUM = 5_000_000_000, 100_000_000, 6


def messages(store, has_seq):
    """Yield topic, type, stamp and message of a small recording."""
    kinds = store.types
    for number in range(NUM):
        stamp_ns = START_NS + number * STEP_NS
        time = kinds["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
        header = kinds["std_msgs/msg/Header"](*((7,) if has_seq else ()), time, "camera")
        pixels = np.full(12, number, np.uint8)
        yield "/a/image", IMAGE, stamp_ns, kinds[IMAGE](header, 3, 4, "mono8", 0, 4, pixels)
        matrix = np.array([100.0, 0, 1.5, 0, 100, 1, 0, 0, 1])
        roi = kinds["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        empty, projection = np.zeros(5), np.zeros(12)
        info = kinds[INFO](header, 3, 4, "plumb_bob", empty, matrix, np.eye(3).ravel(), projection, 0, 0, roi)
        yield "/a/camera_info", INFO, stamp_ns, info


def write_all(writer, store, serialize, *, has_seq):
    with writer:
        connections = {}
        for topic, kind, stamp_ns, message in messages(store, has_seq):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], stamp_ns, serialize(message, kind))


def write_ros2(path, storage, compression=None):
    store, writer = get_typestore(Stores.ROS2_JAZZY), Writer(path, version=9, storage_plugin=storage)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    write_all(writer, store, store.serialize_cdr, has_seq=False)
    return path


def write_ros1(path):
    store = get_typestore(Stores.ROS1_NOETIC)
    write_all(Ros1Writer(path), store, store.serialize_ros1, has_seq=True)
    return path


@pytest.fixture
def bag(request, tmp_path):
    kind = request.param
    if kind == "ros1":
        return write_ros1(tmp_path / "drive.bag")
    if kind == "lone":
        return next(write_ros2(tmp_path / "drive", StoragePlugin.SQLITE3).glob("*.db3"))
    storage = StoragePlugin.MCAP if kind.startswith("mcap") else StoragePlugin.SQLITE3
    compression = {"file": CompressionMode.FILE, "message": CompressionMode.MESSAGE}.get(kind.split()[-1])
    return write_ros2(tmp_path / "drive", storage, compression)


KINDS = ["sqlite", "lone", "sqlite file", "sqlite message", "mcap file", "mcap message", "ros1"]


@pytest.mark.parametrize("bag", KINDS, indirect=True)
def test_every_storage_gives_the_same_messages_and_those_of_a_span_of_time(bag):
    with BagReader(bag) as reader:
        counts = {"/a/image": (IMAGE, NUM), "/a/camera_info": (INFO, NUM)}
        assert {name: (info.type, info.count) for name, info in reader.topics.items()} == counts
        assert reader.time_range == (START_NS, START_NS + (NUM - 1) * STEP_NS)
        assert reader.num_messages == 2 * NUM
        for number, (topic, stamp_ns, data) in enumerate(reader.raw(["/a/image"])):
            message = deserialize_message(data, Image)
            assert (topic, stamp_ns) == ("/a/image", START_NS + number * STEP_NS)
            assert (message.header.frame_id, message.height, message.width) == ("camera", 3, 4)
            assert bytes(message.data) == bytes([number]) * 12
        info = next(reader.messages(["a/camera_info"])).message
        assert isinstance(info, CameraInfo)
        assert (info.k[0], info.k[2], info.r[0], info.distortion_model) == (100.0, 1.5, 1.0, "plumb_bob")
        stamps = [item.stamp_ns for item in reader.raw(["/a/image"], START_NS + STEP_NS, START_NS + 3 * STEP_NS)]
    assert stamps == [START_NS + n * STEP_NS for n in (1, 2, 3)]


@pytest.mark.parametrize("bag", ["lone", "ros1"], indirect=True)
@pytest.mark.parametrize("size", [0, 10, 100, 2000])
def test_what_is_cut_off_is_refused_in_one_line(bag, size):
    data = bag.read_bytes()[:size]
    bag.write_bytes(data)
    with pytest.raises(BagError) as caught, BagReader(bag) as reader:
        list(reader.raw())
    assert "\n" not in str(caught.value)
    assert bag.name in str(caught.value)


def test_a_path_that_means_something_in_an_address_is_read(tmp_path, monkeypatch):
    """SQLite is asked by address: of these the wrong database would be opened, or none."""
    (links := tmp_path / "links").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(links))
    written = write_ros2(tmp_path / "drive", StoragePlugin.SQLITE3)
    for folder in ("day%202", "site #4", "what?", "day 2"):
        path = Path(shutil.copytree(written, tmp_path / folder / "drive"))
        odd = Path(shutil.copy(path / "drive.db3", tmp_path / folder / "a#b.db3"))
        for source in (path, path / "drive.db3", odd):
            with BagReader(source) as bag:
                assert len([*bag.messages()]) == 2 * NUM
    assert not list(links.iterdir())
    (written / "drive.db3").rename(written / "site#5.db3")
    metadata = written / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("drive.db3", "'site#5.db3'"))
    with BagReader(written) as bag:
        assert len([*bag.messages()]) == 2 * NUM


def test_a_database_with_a_log_beside_it_a_pipe_and_a_name_that_a_terminal_obeys_are_refused(tmp_path):
    (bag,) = write_ros2(tmp_path / "drive", StoragePlugin.SQLITE3).glob("*.db3")
    bag.with_name(f"{bag.name}-wal").write_bytes(b"what a crash leaves")
    for path in (bag, bag.parent):
        with pytest.raises(BagError, match=r"db3: expected a whole database, found .*db3-wal .* merges it$"):
            BagReader(path)
    for name in ("drive.db3", "drive.bag"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(BagError, match="expected a bag, found a FIFO"):
            BagReader(tmp_path / name)
    (bag,) = write_ros2(tmp_path / "other", StoragePlugin.SQLITE3).glob("*.db3")
    with closing(sqlite3.connect(bag)) as database:
        database.executescript("UPDATE topics SET name = '/a\x1b[2J' WHERE id = 1")
    with pytest.raises(BagError, match="topic: expected a printable name and type") as caught:
        BagReader(bag)
    assert str(caught.value).isprintable()


TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms"


@pytest.mark.parametrize("kind", ["tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"])
def test_frames_and_types_of_others_come_out_of_a_ros1_bag(kind, tmp_path):
    """No library of ROS 1's types knows TFMessage: the bag itself defines it, and what a maker adds."""
    store = get_typestore(Stores.ROS1_NOETIC)
    own = "acme_msgs/msg/Battery"
    for name, text in ((kind, TF_DEFINITION), (own, "std_msgs/Header header\nfloat32 volts")):
        store.register(get_types_from_msg(text, name))
    kinds = store.types
    head = kinds["std_msgs/msg/Header"](7, kinds["builtin_interfaces/msg/Time"](5, 6), "base_link")
    place, turn = kinds["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0), kinds["geometry_msgs/msg/Quaternion"](0, 0, 0, 1)
    pose = kinds["geometry_msgs/msg/Transform"](place, turn)
    message = kinds[kind]([kinds["geometry_msgs/msg/TransformStamped"](head, "camera", pose)])
    with Ros1Writer(tmp_path / "drive.bag") as writer:
        for topic, name, sent in (("/tf_static", kind, message), ("/battery", own, kinds[own](head, 12.5))):
            writer.write(writer.add_connection(topic, name, typestore=store), 9, store.serialize_ros1(sent, name))
    with BagReader(tmp_path / "drive.bag") as bag:
        assert bag.topics["/tf_static"].type == "tf2_msgs/msg/TFMessage"
        (found,) = next(bag.messages(["/tf_static"])).message.transforms
        assert (found.header.frame_id, found.child_frame_id) == ("base_link", "camera")
        assert found.transform.translation.z == 3
        assert bag.topics["/battery"].count == 1
        assert struct.unpack("<f", next(bag.raw(["/battery"])).message[-4:]) == (12.5,)


@pytest.mark.dds
def test_readers_of_other_bags_and_what_they_need_are_not_loaded_before_there_is_one():
    heavy = "sqlite3", "sphere_nav.ros.bags.foreign", "scipy.special"
    hide = "sys.modules['coverage'] = None"  # with it numba loads sqlite3, whatever we do
    code = f"import sys; {hide}; import dense_localizer.ros.node; print([one for one in {heavy} if one in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "[]"
