"""Small valid files of every kind, to be made wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import laspy
import numpy as np
from std_msgs.msg import Header, String

from benchmarks.abuse.zoo_bags import mcap, ros1, ros2
from benchmarks.room import motions
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Curve
from path_follower.routes.network_file import write_network
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.geometry.trajectory import Trajectory, write_tum
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.maps.reader import MapDetails, save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

SECOND = 1_000_000_000
CAMERA = Pinhole(32, 24, 30.0, 31.0, 15.5, 11.5, (0.1, -0.05, 0.001, 0.002, 0.01))
K = [[400.0, 0.0, 320.0], [0.0, 410.0, 240.0], [0.0, 0.0, 1.0]]
KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [461.6, 460.3, 362.7, 246.8]
  distortion_model: equidistant
  distortion_coeffs: [-0.27, 0.19, 0.001, 0.002]
  resolution: [752, 480]
cam1:
  camera_model: ds
  intrinsics: [-0.2, 0.6, 461.6, 460.3, 362.7, 246.8]
  distortion_model: none
  distortion_coeffs: []
  resolution: [752, 480]
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
"""
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 400., 0., 320., 0., 410., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.05, 0.001, 0.002, 0.01 ]
"""
PLY = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
PLAN = """kind,complete_room,x0_m,y0_m,x1_m,y1_m,z_bottom_m,z_top_m
wall,a,0,0,4,0,0,2.5
wall,a,4,0,4,3,0,2.5
wall,a,4,3,0,3,0,2.5
wall,a,0,3,0,0,0,2.5
door,a,1,0,2,0,0,2
"""


class Samples:
    """Files in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.rng = folder, np.random.default_rng(3)
        self.path_csv = self._text("path.csv", "x,y,yaw,speed\n" + "".join(f"{i},0.1,0,1\n" for i in range(12)))
        self.kalibr, self.opencv = self._text("kalibr.yaml", KALIBR), self._text("opencv.yml", OPENCV)
        self.table = self._text("table.txt", "1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n")
        self.rig, self.tum = folder / "rig.yaml", folder / "drive.tum"
        write_rig(self.rig, Rig((RigCamera("front", CAMERA, SE3.identity()),)))
        poses = SE3.exp(np.array([[0.5 * i, 0.0, 0.0, 0.0, 0.0, 0.02 * i] for i in range(12)]))
        write_tum(self.tum, Trajectory(np.arange(12) * SECOND, poses))
        self.picture = self.rng.integers(1, 255, (24, 32, 3), dtype=np.uint8)
        self.png, self.jpg = self._picture("a.png", self.picture), self._picture("a.jpg", self.picture)
        self.depth = self._picture("depth.png", self.rng.integers(0, 5000, (24, 32)).astype(np.uint16))
        self.geometry = self._geometry()
        self.mounting = self._text("mounting.yaml", "{x: 1.0, y: 0.1, z: 1.5, roll: 0.0, pitch: 0.1, yaw: 0.0}\n")
        x = np.linspace(0.0, 6.0, 13)
        self.routes = folder / "routes.geojson"
        network = build_network([TaughtDrive(Curve(x, 0 * x, 0 * x, 0 * x + 1.0))], "yard")
        write_network(self.routes, network)
        self.spheres: dict[int, Sphere] = {}
        self.map = self._map()
        self.bag, self.plain_bag = self._bag()
        self.foreign_bags = self._foreign_bags()

    def _text(self, name: str, text: str) -> Path:
        (self.folder / name).write_text(text)
        return self.folder / name

    def _picture(self, name: str, pixels: np.ndarray) -> Path:
        cv2.imwrite(str(self.folder / name), pixels)
        return self.folder / name

    def _geometry(self) -> list[Path]:
        points = self.rng.uniform(-3.0, 3.0, (40, 3)).astype(np.float32)
        np.save(self.folder / "points.npy", points)
        rows = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
        faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
        binary = PLY.replace("ascii", "binary_little_endian").replace("vertex 4", "vertex 40") + "end_header\n"
        (self.folder / "binary.ply").write_bytes(binary.encode() + points.tobytes())
        head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40\nHEIGHT 1\nPOINTS 40\nDATA "
        (self.folder / "binary.pcd").write_bytes(f"{head}binary\n".encode() + points.tobytes())
        text = "\n".join(" ".join(f"{value:.3f}" for value in row) for row in points)
        tile, tiles = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2")), []
        tile.x, tile.y, tile.z = points.T
        for name in ("points.las", "tile.laz"):
            tile.write(str(self.folder / name))
            tiles.append(self.folder / name)
        return [
            self.folder / "points.npy",
            self.folder / "binary.ply",
            self.folder / "binary.pcd",
            self._text("faces.ply", PLY + faces + rows + "3 0 1 2\n3 0 1 3\n"),
            self._text("ascii.pcd", f"{head}ascii\n{text}\n"),
            self._text("plan.csv", PLAN),
            *tiles,
        ]

    def _map(self) -> Path:
        nodes = []
        for number in range(3):
            image = self.rng.integers(1, 255, (10, 24, 3), dtype=np.uint8)
            range_m = self.rng.uniform(1.0, 30.0, (10, 24)).astype(np.float32)
            sphere = Sphere(image, range_m, Spherical(24, 10, 64.0, 20.0, 8.0), (number + 1) * SECOND)
            self.spheres[number] = sphere
            nodes.append(KeySphere(number, (number + 1) * SECOND, SE3.from_planar(number, 0.0, 0.1), sphere))
        return save_map(
            self.folder / "map", SphereGraph(nodes, motions(nodes)), MapDetails("yard", parameters={"a.b": 1})
        )

    def _bag(self) -> tuple[Path, Path]:
        with BagWriter(self.folder / "bag") as bag:
            for number in range(30):
                bag.write("text", String(data=self.rng.bytes(40).hex()), number * SECOND)
                bag.write("stamp", Header(frame_id=str(number)), number * SECOND + 1)
                if number % 10 == 9:
                    bag.flush()
        plain = [("/text", number, String(data=str(number))) for number in range(20)]
        return self.folder / "bag" / "bag_0.mcap", mcap(use_chunking=False)(self.folder / "plain", plain)

    def _foreign_bags(self) -> list[Path]:
        """Return files that another library wrote: sqlite3, ROS 1 in chunks."""
        items = [("/text", k, String(data=self.rng.bytes(20).hex())) for k in range(20)]
        folder = ros2("sqlite")(self.folder / "sqlite", items)
        found = [next(f for f in folder.iterdir() if f.suffix != ".yaml")]
        return found + [ros1(method)(self.folder / f"one{method}", items) for method in ("", "bz2", "lz4")]
