"""Small data sets in the formats of the importers, made of a scene with a closed form."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.cli.main import main
from worlds.box_and_wall import depth_of_box_and_wall


@pytest.fixture
def box_and_wall() -> Callable[[Pinhole, SE3], np.ndarray]:
    return depth_of_box_and_wall


@pytest.fixture
def seven_scenes(tmp_path: Path, rng: np.random.Generator) -> Path:
    """Three frames of a camera that moves to the right, depth of the depth camera."""
    folder = tmp_path / "scene"
    folder.mkdir()
    camera = Pinhole(640, 480, 585.0, 585.0, 320.0, 240.0)
    for number in range(3):
        T_world_depth = SE3.exp([0.1 * number, 0.0, 0.0, 0.0, 0.0, 0.0])
        depth = np.rint(depth_of_box_and_wall(camera, T_world_depth) * 1000).astype(np.uint16)
        depth[:10], depth[10:20] = 0, 65535
        color = cv2.resize(rng.integers(0, 255, (12, 16, 3), np.uint8), (640, 480))
        cv2.imwrite(str(folder / f"frame-{number:06d}.color.png"), color)
        cv2.imwrite(str(folder / f"frame-{number:06d}.depth.png"), depth)
        np.savetxt(folder / f"frame-{number:06d}.pose.txt", T_world_depth.matrix)
    return folder


@pytest.fixture
def tum(tmp_path: Path) -> Path:
    """A sequence of four images, one without depth, one without truth."""
    folder = tmp_path / "sequence"
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    rgb, depth, truth = ["# color images"], ["# depth maps"], ["# ground truth"]
    for number in range(4):
        stamp = 100.0 + number * 0.1
        cv2.imwrite(str(folder / f"rgb/{number}.png"), np.full((480, 640, 3), 10 * number + 5, np.uint8))
        rgb.append(f"{stamp:.6f} rgb/{number}.png")
        if number != 2:
            cv2.imwrite(str(folder / f"depth/{number}.png"), np.full((480, 640), 5000 * (number + 1), np.uint16))
            depth.append(f"{stamp + 0.011:.6f} depth/{number}.png")
        for early in (-0.005, 0.005):
            if number != 3:
                truth.append(f"{stamp + early:.6f} {number + early:.6f} 0 1 0 0 0 1")
    for name, lines in (("rgb", rgb), ("depth", depth), ("groundtruth", truth)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture
def kitti(tmp_path: Path, rng: np.random.Generator) -> Path:
    """Three stereo pairs of a car that drives 1.2 m a frame."""
    folder = tmp_path / "06"
    numbers = "700.0 0 60.0 {} 0 700.0 20.0 0 0 0 1 0"
    for side, name in enumerate(("image_0", "image_1")):
        (folder / name).mkdir(parents=True)
        for number in range(3):
            cv2.imwrite(
                str(folder / name / f"{number:06d}.png"), rng.integers(0, 255, (40, 120), np.uint8) // (1 + side)
            )
    (folder / "calib.txt").write_text(f"P0: {numbers.format(0)}\nP1: {numbers.format(-378.0)}\n")
    (folder / "times.txt").write_text("".join(f"{0.1 * number:e}\n" for number in range(3)))
    poses = [np.hstack([np.eye(3), [[0.1 * number], [0.0], [1.2 * number]]]) for number in range(3)]
    (folder / "poses.txt").write_text("".join(" ".join(map(str, pose.ravel())) + "\n" for pose in poses))
    return folder


@pytest.fixture
def imported(tmp_path: Path) -> Callable[..., tuple[dict[str, list[Any]], TransformTree]]:
    """Import a data set; return its messages by topic, and its frames."""
    bags = list[Path]()

    def run(*words: object) -> tuple[dict[str, list[Any]], TransformTree]:
        bags.append(tmp_path / f"bag{len(bags)}")
        assert main(["import", *map(str, words), "-o", str(bags[-1])]) == 0
        with BagReader(bags[-1]) as bag:
            topics = {name: [item.message for item in bag.messages([name])] for name in bag.topics}
            assert all(item.stamp_ns == stamp_ns(item.message) for item in bag.messages() if item.topic != "/tf_static")
        frames = TransformTree()
        for transform in topics["/tf_static"][0].transforms:
            frames.add(transform, is_static=True)
        return topics, frames

    return run
