"""The zoo: recordings of small drives through one room, good and bad, in containers written by rosbags and mcap."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import CompressedImage
from tf2_msgs.msg import TFMessage

from benchmarks.room import HALF_SIDES_M, look, make_room
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import Camera, pixel_rays
from sphere_nav.ros import conversions
from sphere_nav.ros.interfaces import schema_text, type_name
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.rig import vertical_rig

CAMERA = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
PANORAMA, ROOM = Spherical(256, 128), make_room(0)
SECOND, PERIOD, HOUR = 10**9, 10**8, 3600 * 10**9
EPOCH = 1_700_000_000 * SECOND
HEIGHT = 1.2  # m of the camera above the floor, on which base_link moves
T_BASE_CAMERA = SE3.from_parts(np.eye(3), [0.2, 0.0, HEIGHT])
T_BASE_OPTICAL = T_BASE_CAMERA @ T_BODY_OPTICAL
T_ROOM_MAP = SE3.from_parts(np.eye(3), [0.0, 0.0, -HALF_SIDES_M[2]])  # the room's origin is its middle
FIRST, STEP = SE3.from_planar(-1.0, 0.5, 0.3), SE3.exp([0.04, 0.0, 0.0, 0.0, 0.0, 0.015])
BASELINE = 0.5
RIG = vertical_rig()
VIDEO = b"\x00\x00\x00\x01\x67\x42\x00\x1e" + bytes(range(200))
ALL = ("map", "localize", "mcl")
NO_MAP, NO_MCL = ("localize", "mcl"), ("map", "localize")  # odometry is optional: a map of one camera needs depth
Item = tuple[str, int, Any]  # topic, time of recording in ns, message
Write = Callable[[Path, Iterable[Item]], Path]  # a path without ending -> the bag that was written there
Instant = Callable[[int], int]  # number of an image -> ns
TF = "tf2_msgs/msg/TFMessage"
STORE, OLD_STORE = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
for _store in (STORE, OLD_STORE):
    _store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))


# --- containers
def _write_all(writer: Any, store: Any, items: Iterable[Item], pack: Callable[[bytes, str], Any]) -> None:
    """Write messages by a writer of rosbags, each topic with a connection of its own."""
    known: dict[str, Any] = {}
    for topic, ns, message in items:
        kind = type_name(type(message))
        if topic not in known:
            known[topic] = writer.add_connection(topic, kind, typestore=store)
        writer.write(known[topic], ns, pack(serialize_message(message), kind))


def ros2(storage: str = "mcap", mode: str = "", *, is_lone: bool = False) -> Write:
    """Return a writer of rosbag2 folders by rosbags; `mode`: file or message, that is compressed."""

    def write(path: Path, items: Iterable[Item]) -> Path:
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(path, version=9, storage_plugin=plugin)
        if mode:
            writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
        with writer:
            _write_all(writer, STORE, items, lambda data, kind: data)
        return next(file for file in path.iterdir() if file.suffix in (".db3", ".mcap")) if is_lone else path

    return write


def ros1(compression: str = "") -> Write:
    """Return a writer of ROS 1 bags by rosbags."""

    def write(path: Path, items: Iterable[Item]) -> Path:
        path = path.with_suffix(".bag")
        writer = Ros1Writer(path)
        if compression:
            writer.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
        with writer:
            _write_all(writer, OLD_STORE, items, STORE.cdr_to_ros1)
        return path

    return write


def mcap(compression: CompressionType = CompressionType.ZSTD, **options: Any) -> Write:
    """Return a writer of .mcap files by mcap."""

    def write(path: Path, items: Iterable[Item]) -> Path:
        channels: dict[str, int] = {}
        with path.with_suffix(".mcap").open("wb") as stream:
            writer = McapWriter(stream, compression=compression, **options)
            writer.start(profile="ros2", library="zoo")
            for topic, ns, message in items:
                if topic not in channels:
                    kind = type_name(type(message))
                    schema = writer.register_schema(kind, "ros2msg", schema_text(kind).encode())
                    channels[topic] = writer.register_channel(topic, "cdr", schema)
                writer.add_message(channels[topic], ns, serialize_message(message), ns)
            writer.finish()
        return path.with_suffix(".mcap")

    return write


# --- what is seen
def base_pose(number: int) -> SE3:
    """Return T_map_base at an instant; the map's origin is on the floor."""
    return FIRST @ SE3.exp(STEP.log() * number)


@lru_cache(maxsize=256)
def see(camera: Camera, number: int, T_base_camera: SE3) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return grey levels and range (H, W) in m."""
    return look(ROOM, camera, T_ROOM_MAP @ base_pose(number) @ T_base_camera)


def write_room(path: Path) -> Path:
    """Write the room as a mesh, its floor at 0."""
    a, b, c = HALF_SIDES_M
    trimesh.creation.box(bounds=[(-a, -b, 0.0), (a, b, 2 * c)]).export(path)
    return path


def color(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return RGB (H, W, 3) of grey levels."""
    return np.dstack([gray, (0.9 * gray).astype(np.uint8), (0.8 * gray).astype(np.uint8)])


RAW: dict[str, Callable[[NDArray[np.uint8]], NDArray[Any]]] = {
    "rgb8": color,
    "bgr8": lambda gray: np.ascontiguousarray(color(gray)[..., ::-1]),
    "mono8": lambda gray: gray,
    "mono16": lambda gray: gray.astype(np.uint16) << 8,
    "bayer_rggb8": lambda gray: gray,
}


def encode(gray: NDArray[np.uint8], encoding: str, ns: int, frame: str) -> Any:
    """Return the message of an image by the name of its encoding."""
    if encoding in RAW:
        return conversions.array_to_image(RAW[encoding](gray), ns, frame, encoding)
    data = VIDEO if encoding == "h264" else cv2.imencode(f".{encoding}", color(gray)[..., ::-1])[1].tobytes()
    name = {"jpeg": "rgb8; jpeg compressed bgr8"}.get(encoding, encoding)
    return CompressedImage(header=conversions.header(ns, frame), format=name, data=data)


def encode_depth(meters: NDArray[np.float32], encoding: str, ns: int, frame: str) -> Any:
    """Return the message of depth by the name of its encoding."""
    if encoding == "32FC1":
        return conversions.array_to_image(meters, ns, frame, encoding)
    millimeters = np.rint(meters * 1e3).astype(np.uint16)
    if encoding in ("16UC1", "mono16"):
        return conversions.array_to_image(millimeters, ns, frame, encoding)
    data = cv2.imencode(".png", millimeters)[1].tobytes()
    is_packed = encoding == "16UC1; compressedDepth"  # of its own transport, with a head of 12 bytes
    return CompressedImage(header=conversions.header(ns, frame), format=encoding, data=bytes(12 * is_packed) + data)


def transforms(edges: Iterable[tuple[SE3, str, str]], ns: int) -> TFMessage:
    """Return a TFMessage of places, parents and children."""
    return TFMessage(transforms=[conversions.se3_to_transform(T, ns, *names) for T, *names in edges])


def odometry(number: int, ns: int) -> Any:
    """Return the odometry at an instant."""
    pose, frames = base_pose(number), ("odom", "base_link")
    return conversions.se3_to_odometry(pose, 1e-4 * np.eye(6), ns, frames, np.zeros(6))


# --- drives
def steady(number: int) -> int:
    """Return the time of an instant of an ordinary recording."""
    return EPOCH + number * PERIOD


@dataclass(frozen=True)
class Drive:
    """One camera with depth, on a vehicle with odometry; empty names are not recorded."""

    image: str = "/camera/camera/color/image_raw"
    info: str = "/camera/camera/color/camera_info"
    depth: str = "/camera/camera/aligned_depth_to_color/image_raw"
    odom: str = "/wheel/odometry"
    encoding: str = "rgb8"
    depth_encoding: str = "16UC1"
    frame: str = "camera_optical"
    info_frame: str | None = None
    mount: str = "/tf_static"
    moving: tuple[tuple[str, str], ...] = ()  # edges on /tf; all but the last stand still
    stamp: Instant = steady
    log: Instant = steady
    depth_ns: int = 2_000_000  # by which depth is later
    change: Callable[[Any], None] = lambda info: None  # of the calibration
    odom_stamp: Instant | None = None
    num: int = 6

    def items(self) -> list[Item]:
        """Return the messages in the order in which they were recorded."""
        found: list[Item] = []
        edges = [(T_BASE_CAMERA, "base_link", "camera_link"), (T_BODY_OPTICAL, "camera_link", self.frame)]
        for number in range(self.num if self.mount == "/tf" else bool(self.mount)):
            found.append((self.mount, self.log(number) - 10**6, transforms(edges, self.stamp(number))))
        for number in range(self.num):
            found += self._instant(number)
        return sorted((item for item in found if item[0]), key=lambda item: item[1])

    def _instant(self, number: int) -> Iterable[Item]:
        ns, log = self.stamp(number), self.log(number)
        gray, range_m = see(CAMERA, number, T_BASE_OPTICAL)
        meters = (range_m * pixel_rays(CAMERA)[..., 2]).astype(np.float32)
        yield self.odom, log, odometry(number, (self.odom_stamp or self.stamp)(number))
        for place, names in enumerate(self.moving):
            T = base_pose(number) if place == len(self.moving) - 1 else SE3.identity()
            yield "/tf", log, transforms([(T, *names)], ns)
        info = conversions.camera_to_info(CAMERA, ns, self.frame if self.info_frame is None else self.info_frame)
        self.change(info)
        yield self.info, log + 10**6, info
        yield self.image, log + 2 * 10**6, encode(gray, self.encoding, ns, self.frame)
        yield self.depth, log + 3 * 10**6, encode_depth(meters, self.depth_encoding, ns + self.depth_ns, self.frame)


def stereo(*, baseline: float = BASELINE) -> list[Item]:
    """Return the drive of a rectified pair; `baseline` as its calibration has it."""
    found: list[Item] = [("/tf_static", EPOCH, transforms([(T_BASE_OPTICAL, "base_link", "left_optical")], EPOCH))]
    for number in range(6):
        ns = steady(number)
        for side, shift in (("left", 0.0), ("right", BASELINE)):
            gray, _ = see(CAMERA, number, T_BASE_OPTICAL @ SE3.from_parts(np.eye(3), [shift, 0.0, 0.0]))
            topic, frame = f"/zed/zed_node/{side}", f"{side}_optical"
            info = conversions.camera_to_info(CAMERA, ns, frame, baseline=baseline * (shift > 0))
            found.append((f"{topic}/camera_info", ns, info))
            found.append((f"{topic}/image_rect_color", ns + 1, encode(gray, "mono8", ns, frame)))
    return found


def six_cameras(*, topic: str = "/{}/image_raw", encoding: str = "mono8", num: int = 5) -> list[Item]:
    """Return the drive of the rig."""
    edges = [(T_BASE_CAMERA, "base_link", "rig_link")]
    edges += [(part.T_rig_camera, "rig_link", f"{part.name}_optical") for part in RIG.cameras]
    found: list[Item] = [("/tf_static", EPOCH, transforms(edges, EPOCH))]
    for number in range(num):
        for part in RIG.cameras:
            gray, _ = see(part.camera, number, T_BASE_CAMERA @ part.T_rig_camera)
            ns = steady(number)
            found.append((topic.format(part.name), ns, encode(gray, encoding, ns, f"{part.name}_optical")))
    return found


def panorama() -> list[Item]:
    """Return the drive of a panoramic camera."""
    found: list[Item] = [("/tf_static", EPOCH, transforms([(T_BASE_CAMERA, "base_link", "theta")], EPOCH))]
    for number in range(6):
        ns = steady(number)
        found.append(("/odom", ns, odometry(number, ns)))
        gray, _ = see(PANORAMA, number, T_BASE_CAMERA)
        found.append(("/theta/image_raw", ns + 1, encode(gray, "mono8", ns, "theta")))
    return found


# --- the list
MCAP = ros2()


@dataclass(frozen=True)
class Exhibit:
    """A recording: its name, what is in it, who writes it, the jobs it is good for, what is said where it is not."""

    name: str
    items: Callable[[], Iterable[Item]]
    write: Write = MCAP
    jobs: tuple[str, ...] = ALL
    words: str = ""

    def build(self, folder: Path) -> Path:
        """Write it below a folder; return its path."""
        return self.write(folder / self.name, self.items())


def of(name: str, write: Write | None = None, jobs: tuple[str, ...] = ALL, words: str = "", **changes: Any) -> Exhibit:
    """Return a drive, changed in some fields, as an exhibit."""
    return Exhibit(name, Drive(**changes).items, write or MCAP, jobs, words)


def _set(**values: Any) -> Callable[[Any], None]:
    """Return a change of a calibration."""

    def change(info: Any) -> None:
        for name, value in values.items():
            setattr(info, name, value)

    return change


def _step(back: int) -> Instant:
    """Return times of a clock that is set by so many ns before the seventh image."""
    return lambda number: steady(number) + back * (number >= 6)


def exhibits() -> list[Exhibit]:
    """Return the whole zoo: containers, names, encodings, clocks and faults."""
    containers = {
        "mcap_plain": mcap(CompressionType.NONE),
        "mcap_lz4": mcap(CompressionType.LZ4),
        "mcap_no_chunks": mcap(use_chunking=False),
        "mcap_no_statistics": mcap(use_statistics=False, use_summary_offsets=False),
        "mcap_no_crc": mcap(enable_crcs=False),
        "sqlite_alone": ros2("sqlite", is_lone=True),
        "ros1": ros1(),
        "ros1_bz2": ros1("bz2"),
        "ros1_lz4": ros1("lz4"),
    }
    modes = [(storage, mode) for storage in ("mcap", "sqlite") for mode in ("", "file", "message")]
    containers |= {f"rosbags_{storage}_{mode}".strip("_"): ros2(storage, mode) for storage, mode in modes}
    packed = partial(six_cameras, topic="/{}/image_raw/compressed", encoding="jpeg")
    depth, jpeg = Drive.depth, f"{Drive.image}/compressed"
    boot, height, tf = SECOND - EPOCH, "height by --mounting", (("odom", "base_link"),)
    own: dict[str, Any] = {"image": "/image_raw", "info": "/camera_info", "depth": "/depth/image_raw", "odom": "/odom"}
    kinect: dict[str, Any] = {"image": "/camera/rgb/image_color", "info": "/camera/rgb/camera_info"}
    return [
        *(of(name, write) for name, write in containers.items()),
        of("own_names", **own),
        of("kinect_names", depth="/camera/depth_registered/image_raw", **kinect),
        of("mono", depth="", jobs=NO_MAP, words="expected depth images"),
        of("no_odometry", odom=""),
        of("no_camera_info", info="", jobs=(), words="expected one topic with camera_info"),
        of("no_images", image="", depth="", jobs=(), words="expected images (--image)"),
        Exhibit("stereo", stereo),
        Exhibit("stereo_no_baseline", partial(stereo, baseline=0.0), jobs=NO_MAP, words="expected -fx * baseline"),
        Exhibit("rig", six_cameras, jobs=NO_MCL, words="choose by --image"),
        Exhibit("rig_deep_names", partial(six_cameras, topic="/car/cam_{}/raw/image"), jobs=NO_MCL),
        Exhibit("rig_jpeg", packed, jobs=NO_MCL),
        Exhibit("panorama", panorama, jobs=NO_MAP),
        *(of(f"image_{name}", encoding=name) for name in RAW if name != "rgb8"),
        *(of(f"image_{name}", image=jpeg, encoding=name) for name in ("jpeg", "png")),
        *(of(f"depth_{name}", depth_encoding=name) for name in ("32FC1", "mono16")),
        of("depth_compressed", depth=f"{depth}/compressedDepth", depth_encoding="16UC1; compressedDepth"),
        of("depth_16UC1_png_compressed", depth=f"{depth}/compressed", depth_encoding="16UC1; png compressed"),
        of("bad_h264", image=jpeg, encoding="h264", jobs=(), words="expected PNG or JPEG"),
        of("k_is_0", change=_set(k=np.zeros(9)), jobs=(), words="found focal length 0"),
        of("unknown_lens", change=_set(distortion_model="mei"), jobs=(), words="distortion_model: expected"),
        of("other_size", change=_set(width=640, height=480), jobs=(), words="camera_info (640 x 480); choose it"),
        of("stamps_0", stamp=lambda number: 0, depth_ns=0, jobs=(), words="header.stamp: expected a time, found 0"),
        of("stamps_frozen", stamp=lambda number: EPOCH, jobs=(), words="header.stamp: expected one that grows"),
        of("odometry_stamps_0", odom_stamp=lambda number: 0),
        of("depth_late", depth_ns=45_000_000, jobs=NO_MAP, words="expected stamps within 20 ms"),
        of("no_frames", mount="", jobs=NO_MCL, words=height),
        of("empty_frames", frame="", mount="", jobs=NO_MCL, words=height),
        of("mount_on_tf", mount="/tf"),
        of("other_info_frame", info_frame="camera"),
        of("since_boot", stamp=lambda number: steady(number) + boot),
        of("recorder_since_boot", log=lambda number: steady(number) + boot),
        of("recorder_behind", log=lambda number: steady(number) - 3 * SECOND),
        of("slow", stamp=lambda n: EPOCH + 3 * n * SECOND, log=lambda n: EPOCH + 3 * n * SECOND),
        of("clock_set_back", num=12, stamp=_step(-HOUR)),
        of("clock_set_forward", num=12, stamp=_step(HOUR)),
        of("both_clocks_set_back", num=12, stamp=_step(-HOUR), log=_step(-HOUR)),
        of("one_stamp_0", num=12, stamp=lambda number: steady(number) * (number != 3)),
        of("odometry_on_tf", odom="", moving=tf),
        of("odometry_on_tf_in_a_map", odom="", moving=(("map", "odom"), *tf)),
        of("pose_on_tf", odom="", moving=(("map", "base_link"),)),
    ]
