"""The zoo: recordings of small drives through one room as anybody might have made them, good and bad."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from numpy.typing import NDArray

from benchmarks.abuse.zoo_writers import OLD_TF, TF, Item, Messages, Write, mcap, ros1, ros2
from benchmarks.room import HALF_SIDES_M, render
from sphere_nav.geometry import SE3, Fisheye, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.cameras.camera import Camera, pixel_rays
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

SIZE, FOCAL = (240, 180), 180.0
CAMERA = Pinhole(*SIZE, FOCAL, FOCAL, SIZE[0] / 2 - 0.5, SIZE[1] / 2 - 0.5)
PANORAMA = Spherical(256, 128)
SECOND, PERIOD, HOUR = 10**9, 10**8, 3600 * 10**9
EPOCH = 1_700_000_000 * SECOND
HEIGHT = 1.2  # m of the camera above the floor, on which base_link moves
T_BASE_CAMERA = SE3.from_parts(np.eye(3), [0.2, 0.0, HEIGHT])
T_ROOM_MAP = SE3.from_parts(np.eye(3), [0.0, 0.0, -HALF_SIDES_M[2]])  # the room's origin is its middle
FIRST, STEP = SE3.from_planar(-1.0, 0.5, 0.3), SE3.exp([0.04, 0.0, 0.0, 0.0, 0.0, 0.015])
BASELINE = 0.5
RIG_LENS = Fisheye(160, 160, 48.0, 48.0, 79.5, 79.5)
RIG_NAMES = ("front", "left", "right", "low_front", "low_left", "low_right")
IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
ODOMETRY = "nav_msgs/msg/Odometry"
ALL = ("map", "localize", "mcl")
Instant = Callable[[int], int]  # number of an image -> ns


def base_pose(number: int) -> SE3:
    """Return T_map_base at an instant; the map's origin is on the floor."""
    return FIRST @ SE3.exp(STEP.log() * number)


@lru_cache(maxsize=256)
def see(camera: Camera, number: int, shift: float = 0.0) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return grey levels and depth along z (H, W) in m of a camera `shift` m to the right; range of a panorama."""
    T_map_body = base_pose(number) @ T_BASE_CAMERA
    if isinstance(camera, Spherical):
        return render(camera, T_ROOM_MAP @ T_map_body)
    T_camera = T_ROOM_MAP @ T_map_body @ T_BODY_OPTICAL @ SE3.from_parts(np.eye(3), [shift, 0.0, 0.0])
    gray, range_m = render(camera, T_camera)
    return gray, (range_m * pixel_rays(camera)[..., 2]).astype(np.float32)


@lru_cache(maxsize=1)
def rig() -> Rig:
    """Return three pairs of fisheye cameras, one above the other."""
    parts = []
    for name, azimuth, z in zip(RIG_NAMES, (0.0, 2.1, -2.1) * 2, (0.15,) * 3 + (-0.15,) * 3, strict=True):
        pose = SE3.from_planar(0.0, 0.0, azimuth) @ SE3.from_parts(T_BODY_OPTICAL.rotation, [0.02, 0.0, z])
        group = name.removeprefix("low_")
        parts.append(RigCamera(name, RIG_LENS, pose, exposure_group=group, level="bottom" if "low" in name else "top"))
    return Rig(tuple(parts))


@lru_cache(maxsize=64)
def see_rig(name: str, number: int) -> NDArray[np.uint8]:
    """Return the grey levels of a camera of the rig."""
    T_camera = T_ROOM_MAP @ base_pose(number) @ T_BASE_CAMERA @ rig().camera(name).T_rig_camera
    return render(RIG_LENS, T_camera)[0]


def write_room(path: Path) -> Path:
    """Write the room as an ascii .ply, its floor at 0."""
    a, b, c = HALF_SIDES_M
    corners = [f"{x} {y} {z}" for x in (-a, a) for y in (-b, b) for z in (0.0, 2 * c)]
    faces = [f"4 {' '.join(map(str, quad))}" for quad in FACES]
    head = ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {axis}" for axis in "xyz")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*head, *corners, *faces]) + "\n")
    return path


FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def values_of(T: SE3) -> NDArray[np.float64]:
    """Return x, y, z and quaternion (7,)."""
    return np.concatenate([T.translation, T.quaternion])


# --- how pixels become messages
def color(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return RGB (H, W, 3) of grey levels."""
    return np.dstack([gray, (0.9 * gray).astype(np.uint8), (0.8 * gray).astype(np.uint8)])


def _bayer(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    rgb, mosaic = color(gray), gray.copy()
    mosaic[0::2, 0::2], mosaic[1::2, 1::2] = rgb[0::2, 0::2, 0], rgb[1::2, 1::2, 2]
    mosaic[0::2, 1::2], mosaic[1::2, 0::2] = rgb[0::2, 1::2, 1], rgb[1::2, 0::2, 1]
    return mosaic


RAW: dict[str, Callable[[NDArray[np.uint8]], NDArray[Any]]] = {
    "rgb8": color,
    "bgr8": lambda gray: color(gray)[..., ::-1],
    "mono8": lambda gray: gray,
    "mono16": lambda gray: gray.astype(np.uint16) << 8,
    "bayer_rggb8": _bayer,
}
VIDEO = b"\x00\x00\x00\x01\x67\x42\x00\x1e" + bytes(range(200))


def encode(make: Messages, gray: NDArray[np.uint8], encoding: str, ns: int, frame: str) -> tuple[str, Any]:
    """Return type and message of an image by the name of its encoding."""
    if encoding in RAW:
        return IMAGE, make.image(RAW[encoding](gray), ns, frame, encoding)
    if encoding == "padded":
        return IMAGE, make.image(color(gray), ns, frame, "rgb8", padding=16)
    if encoding == "h264":
        return COMPRESSED, make.compressed(VIDEO, ns, frame, "h264")
    data = cv2.imencode(f".{encoding}", color(gray)[..., ::-1])[1].tobytes()
    return COMPRESSED, make.compressed(data, ns, frame, {"jpeg": "rgb8; jpeg compressed bgr8"}.get(encoding, encoding))


def encode_depth(make: Messages, meters: NDArray[np.float32], encoding: str, ns: int, frame: str) -> tuple[str, Any]:
    """Return type and message of depth by the name of its encoding."""
    millimeters = np.rint(meters * 1e3).astype(np.uint16)
    png = partial(cv2.imencode, ".png")
    if encoding in ("16UC1", "mono16"):
        return IMAGE, make.image(millimeters, ns, frame, encoding)
    if encoding == "32FC1":
        return IMAGE, make.image(meters, ns, frame, encoding)
    data = png(millimeters)[1].tobytes()
    if encoding == "compressedDepth":
        data = struct.pack("<iff", 0, 0.0, 0.0) + data
        return COMPRESSED, make.compressed(data, ns, frame, "16UC1; compressedDepth")
    return COMPRESSED, make.compressed(data, ns, frame, encoding)  # of the transport `compressed`


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
    depth_info: str = ""
    odom: str = "/wheel/odometry"
    encoding: str = "rgb8"
    depth_encoding: str = "16UC1"
    frame: str = "camera_optical"
    info_frame: str | None = None
    depth_frame: str | None = None
    mount: str = "/tf_static"
    moving: tuple[tuple[str, str], ...] = ()  # edges on /tf; all but the last stand still
    stamp: Instant = steady
    log: Instant = steady
    depth_ns: int = 2_000_000  # by which depth is later
    info_size: tuple[int, int] = SIZE
    has_k: bool = True
    model: str = "plumb_bob"
    odom_stamp: Instant | None = None
    tf: str = TF
    num: int = 6
    others: Callable[[Messages, int, int], Iterable[Item]] = lambda make, number, ns: ()

    def items(self, make: Messages) -> list[Item]:
        """Return the messages in the order in which they were recorded."""
        found: list[Item] = []
        if self.mount:
            edges = [(values_of(T_BASE_CAMERA), "base_link", "camera_link")]
            edges += [(values_of(T_BODY_OPTICAL), "camera_link", self.frame)]
            if self.depth_frame:
                edges += [(values_of(SE3.from_parts(np.eye(3), [-0.02, 0, 0])), self.frame, self.depth_frame)]
            for number in range(self.num if self.mount == "/tf" else 1):
                message = make.transforms(edges, self.stamp(number), self.tf)
                found.append((self.mount, self.tf, self.log(number) - 10**6, message))
        for number in range(self.num):
            found += self._instant(make, number)
        return sorted(found, key=lambda item: item[2])

    def _instant(self, make: Messages, number: int) -> Iterable[Item]:
        ns, log = self.stamp(number), self.log(number)
        gray, meters = see(CAMERA, number)
        frame = self.frame if self.info_frame is None else self.info_frame
        if self.odom:
            values, when = values_of(base_pose(number)), (self.odom_stamp or self.stamp)(number)
            yield self.odom, ODOMETRY, log, make.odometry(values, when)
        for place, (parent, child) in enumerate(self.moving):
            T = base_pose(number) if place == len(self.moving) - 1 else SE3.identity()
            yield "/tf", self.tf, log, make.transforms([(values_of(T), parent, child)], ns, self.tf)
        if self.info:
            options: dict[str, Any] = {"has_k": self.has_k, "model": self.model}
            yield self.info, INFO, log + 10**6, make.info(self.info_size, FOCAL, ns, frame, **options)
        if self.image:
            yield self.image, *_timed(encode(make, gray, self.encoding, ns, self.frame), log + 2 * 10**6)
        late = ns + self.depth_ns
        if self.depth_info:
            yield self.depth_info, INFO, log + 10**6, make.info(SIZE, FOCAL, late, self.depth_frame or self.frame)
        if self.depth:
            if self.depth_frame:
                meters = see(CAMERA, number, -0.02)[1]
            kind, message = encode_depth(make, meters, self.depth_encoding, late, self.depth_frame or self.frame)
            yield self.depth, kind, log + 3 * 10**6, message
        yield from self.others(make, number, ns)


def _timed(found: tuple[str, Any], log: int) -> tuple[str, int, Any]:
    return found[0], log, found[1]


def stereo(make: Messages, *, baseline: float = BASELINE) -> list[Item]:
    """Return the drive of a rectified pair; `baseline` as its calibration has it."""
    edge = (values_of(T_BASE_CAMERA @ T_BODY_OPTICAL), "base_link", "left_optical")
    found: list[Item] = [("/tf_static", TF, EPOCH, make.transforms([edge], EPOCH))]
    for number in range(6):
        ns = steady(number)
        for side, shift in (("left", 0.0), ("right", BASELINE)):
            gray, _ = see(CAMERA, number, shift)
            topic, frame = f"/zed/zed_node/{side}", f"{side}_optical"
            info = make.info(SIZE, FOCAL, ns, frame, baseline=baseline * (shift > 0))
            found.append((f"{topic}/camera_info", INFO, ns, info))
            found.append((f"{topic}/image_rect_color", IMAGE, ns + 1, make.image(gray, ns, frame, "mono8")))
    return found


def six_cameras(make: Messages, *, topic: str = "/{}/image_raw", encoding: str = "mono8", num: int = 5) -> list[Item]:
    """Return the drive of the rig."""
    edges = [(values_of(T_BASE_CAMERA), "base_link", "rig_link")]
    edges += [(values_of(rig().camera(name).T_rig_camera), "rig_link", f"{name}_optical") for name in RIG_NAMES]
    found: list[Item] = [("/tf_static", TF, EPOCH, make.transforms(edges, EPOCH))]
    for number in range(num):
        ns = steady(number)
        for name in RIG_NAMES:
            kind, message = encode(make, see_rig(name, number), encoding, ns, f"{name}_optical")
            found.append((topic.format(name), kind, ns, message))
    return found


def panorama(make: Messages) -> list[Item]:
    """Return the drive of a panoramic camera."""
    edge = (values_of(T_BASE_CAMERA), "base_link", "theta")
    found: list[Item] = [("/tf_static", TF, EPOCH, make.transforms([edge], EPOCH))]
    for number in range(6):
        ns = steady(number)
        found.append(("/odom", ODOMETRY, ns, make.odometry(values_of(base_pose(number)), ns)))
        image = make.image(see(PANORAMA, number)[0], ns, "theta", "mono8")
        found.append(("/theta/image_raw", IMAGE, ns + 1, image))
    return found


# --- the list
@dataclass(frozen=True)
class Exhibit:
    """A recording: its name, what is in it, who writes it, the jobs it is good for, what is said where it is not."""

    name: str
    items: Callable[[Messages], Iterable[Item]]
    write: Write
    jobs: tuple[str, ...] = ALL
    words: str = ""
    is_ros1: bool = False

    def build(self, folder: Path) -> Path:
        """Write it below a folder; return its path."""
        make = Messages(self.is_ros1)
        return self.write(folder / self.name, make, self.items(make))


def _battery(make: Messages, number: int, ns: int) -> Iterable[Item]:
    cells = [make.make("acme_msgs/msg/Cell", 3.7)]
    kind = "acme_msgs/msg/Battery"
    yield "/battery", kind, ns, make.make(kind, make.header(ns, ""), 12.0, cells)


def _step(back: int, number_of_first: int = 6) -> Instant:
    """Return times of a clock that is set by so many ns before an image."""
    return lambda number: steady(number) + back * (number >= number_of_first)


D = Drive()
OWN = Drive("/image_raw", "/camera_info", "/depth/image_raw", odom="/odom")
KINECT = Drive("/camera/rgb/image_color", "/camera/rgb/camera_info", "/camera/depth_registered/image_raw")
APART = replace(D, depth="/camera/camera/depth/image_rect_raw", depth_info="/camera/camera/depth/camera_info")
APART = replace(APART, depth_frame="depth_optical")
PACKED = f"{D.image}/compressed"
NO_MAP, NO_ODOMETRY, ONLY = ("localize", "mcl"), ("map", "localize"), ("localize",)
NO_WAY = "on /tf_static, found no way"


def of(
    name: str,
    drive: Drive = D,
    write: Write | None = None,
    jobs: tuple[str, ...] = ALL,
    words: str = "",
    *,
    is_ros1: bool = False,
    **changes: Any,
) -> Exhibit:
    """Return a drive, changed in some fields, as an exhibit."""
    return Exhibit(name, replace(drive, **changes).items, write or ros2(), jobs, words, is_ros1=is_ros1)


def _storages() -> list[Exhibit]:
    direct = {
        "mcap_plain": mcap(CompressionType.NONE),
        "mcap_lz4": mcap(CompressionType.LZ4),
        "mcap_no_chunks": mcap(use_chunking=False),
        "mcap_no_statistics": mcap(use_statistics=False, use_summary_offsets=False),
        "mcap_no_crc": mcap(enable_crcs=False),
        "sqlite_alone": ros2("sqlite", is_lone=True),
    }
    modes = [(storage, mode) for storage in ("mcap", "sqlite") for mode in ("", "file", "message")]
    old = {"ros1": ros1(), "ros1_bz2": ros1("bz2"), "ros1_lz4": ros1("lz4")}
    return [
        *(of(name, write=write) for name, write in direct.items()),
        *(of(f"rosbags_{storage}_{mode}".strip("_"), write=ros2(storage, mode)) for storage, mode in modes),
        *(of(name, write=write, is_ros1=True, others=_battery) for name, write in old.items()),
        of("ros1_old_tf", write=ros1(), is_ros1=True, tf=OLD_TF),
    ]


def _names() -> list[Exhibit]:
    deep = partial(six_cameras, topic="/car/cam_{}/raw/image")
    packed = partial(six_cameras, topic="/{}/image_raw/compressed", encoding="jpeg")
    return [
        of("own_names", OWN),
        of("kinect_names", KINECT),
        of("depth_apart", APART),
        of("mono", depth="", jobs=NO_MAP, words="expected depth images"),
        of("no_odometry", odom="", jobs=NO_ODOMETRY, words="expected odometry"),
        of("no_camera_info", info="", jobs=(), words="expected one topic with camera_info"),
        of("no_images", image="", depth="", jobs=(), words="expected images (--image)"),
        Exhibit("stereo", stereo, ros2(), NO_ODOMETRY),
        Exhibit("stereo_no_baseline", partial(stereo, baseline=0.0), ros2(), ONLY, "expected -fx * baseline"),
        Exhibit("rig", six_cameras, ros2(), NO_ODOMETRY, "choose by --image"),
        Exhibit("rig_deep_names", deep, ros2(), NO_ODOMETRY),
        Exhibit("rig_jpeg", packed, ros2(), NO_ODOMETRY),
        Exhibit("panorama", panorama, ros2(), NO_MAP),
    ]


def _encodings() -> list[Exhibit]:
    raw = [*(name for name in RAW if name != "rgb8"), "padded"]
    depths = {"compressedDepth": "compressedDepth", "16UC1; png compressed": "compressed", "png": "compressed"}
    return [
        *(of(f"image_{name}", encoding=name) for name in raw),
        *(of(f"image_{name}", image=PACKED, encoding=name) for name in ("jpeg", "png")),
        *(of(f"depth_{name}", depth_encoding=name) for name in ("32FC1", "mono16")),
        *(
            of("depth_" + name.replace("; ", "_").replace(" ", "_"), depth=f"{D.depth}/{end}", depth_encoding=name)
            for name, end in depths.items()
        ),
        of("bad_h264", image=PACKED, encoding="h264", jobs=(), words="expected PNG or JPEG"),
    ]


def _faults() -> list[Exhibit]:
    long, boot = replace(D, num=12), SECOND - EPOCH
    none, height = "header.stamp: expected", "height by --mounting"
    tf = (("odom", "base_link"),)
    return [
        of("k_is_0", has_k=False, jobs=(), words="found focal length 0"),
        of("unknown_lens", model="mei", jobs=(), words="distortion_model: expected"),
        of("other_size", info_size=(640, 480), jobs=(), words="image size: expected 640 x 480"),
        of("stamps_0", stamp=lambda number: 0, depth_ns=0, jobs=(), words=f"{none} a time, found 0"),
        of("stamps_frozen", stamp=lambda number: EPOCH, jobs=(), words=f"{none} one that grows"),
        of("odometry_stamps_0", odom_stamp=lambda number: 0, jobs=NO_ODOMETRY, words="expected odometry"),
        of("depth_late", depth_ns=45_000_000, jobs=NO_MAP, words="expected stamps within 20 ms"),
        of("depth_without_frames", APART, mount="", jobs=ONLY, words=NO_WAY),
        of("no_frames", mount="", jobs=NO_ODOMETRY, words=height),
        of("empty_frames", frame="", mount="", jobs=NO_ODOMETRY, words=height),
        of("mount_on_tf", mount="/tf"),
        of("other_info_frame", info_frame="camera"),
        of("since_boot", stamp=lambda number: steady(number) + boot),
        of("recorder_since_boot", log=lambda number: steady(number) + boot),
        of("recorder_behind", log=lambda number: steady(number) - 3 * SECOND),
        of("slow", stamp=lambda n: EPOCH + 3 * n * SECOND, log=lambda n: EPOCH + 3 * n * SECOND),
        of("clock_set_back", long, stamp=_step(-HOUR)),
        of("clock_set_forward", long, stamp=_step(HOUR)),
        of("both_clocks_set_back", long, stamp=_step(-HOUR), log=_step(-HOUR)),
        of("one_stamp_0", long, stamp=lambda number: steady(number) * (number != 3)),
        of("odometry_on_tf", odom="", moving=tf),
        of("odometry_on_tf_in_a_map", odom="", moving=(("map", "odom"), *tf)),
        of("pose_on_tf", odom="", moving=(("map", "base_link"),), jobs=NO_ODOMETRY, words="expected odometry"),
    ]


def exhibits() -> list[Exhibit]:
    """Return the whole zoo."""
    return [*_storages(), *_names(), *_encodings(), *_faults()]
