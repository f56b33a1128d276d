"""`sphere_nav view`: look around in a map, in a web browser."""

from __future__ import annotations

import argparse
import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.params import build
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.graph import Experience
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav_tools.cli import gate
from sphere_nav_tools.cli.view.server import NUM_FILLING, Page, encoded, shown
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.recorded_camera import RecordedCamera
from sphere_nav_tools.offline.settings import (
    add_overwrite,
    add_settings,
    check_ending,
    check_free,
    floats,
    read_positive,
    read_size,
)

HELP = """\
Show a map in a web browser: its graph, its key spheres, and what a camera would see from anywhere near them. The mouse
turns and zooms, W A S D Q E move, a click on a key sphere flies there. With --bag a drive is localised in the map,
image by image: camera, residual and status are shown as it goes. A map of many days is shown in the experience that
is chosen on the page, or by --experience.

With --screenshot a single view is written, without a browser. Poses are those of the vehicle's axes: x ahead, z up.

examples:
  sphere_nav view kitchen
  sphere_nav view kitchen --bag drive2
  sphere_nav view kitchen --screenshot view.png --pose 1.0,0.2,1.5,90
  sphere_nav view day_and_night --experience night --screenshot night.png
  sphere_nav view kitchen --host 0.0.0.0 --port 9000
"""
ENDINGS = (".png", ".jpg")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="map made by `sphere_nav map`")
    gate.add_options(parser, port=8080)
    parser.add_argument(
        "--memory", type=read_positive, default=500.0, metavar="MB", help="of kept spheres (%(default)g)"
    )
    expected = "x,y,z,yaw[,pitch,roll]"
    parser.add_argument("--pose", type=floats(expected, 4, 6), metavar=expected, help="where to begin, m and degrees")
    parser.add_argument("--sphere", type=int, metavar="ID", help="begin at a key sphere (the first one)")
    parser.add_argument("--experience", metavar="NAME", help="begin with this look of the map, as map-info names it")
    parser.add_argument("--screenshot", type=Path, metavar="F", help="write the first view (.png, .jpg) and end")
    parser.add_argument("--size", type=read_size, default="800x600", metavar="WxH", help="of that view (%(default)s)")
    parser.add_argument("--fov", type=float, default=75.0, metavar="DEG", help="its width (%(default)g)")
    add_overwrite(parser)
    parser.add_argument("--bag", type=Path, metavar="BAG", help="drive to localise and show")
    topics.add_options(parser, has_cameras=False)
    add_settings(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Write one view, or serve until interrupted."""
    with open_map(arguments.map) as reader:
        start = first_pose(reader, arguments)
        scene = Scene(reader, arguments.memory)
        try:
            find_experience(scene, arguments.experience)  # refused before anything is shown
            if arguments.screenshot:
                return write_view(scene, start, arguments)
            return serve(reader, scene, start, arguments)
        finally:
            scene.close()


def first_pose(reader: MapReader, arguments: argparse.Namespace) -> SE3:
    """Return the pose of the camera to begin with, optical axes; ValueError for words that are none."""
    if arguments.pose and arguments.sphere is not None:
        raise ValueError("--pose, --sphere: expected one of them, found both")
    if not arguments.pose:
        sphere_id = arguments.sphere if arguments.sphere is not None else min(reader.graph.nodes)
        return reader.graph[sphere_id].T_map_sphere @ T_BODY_OPTICAL
    yaw, pitch, roll = np.radians([*arguments.pose[3:], 0.0, 0.0][:3])
    return SE3.from_angles(roll, pitch, yaw, arguments.pose[:3]) @ T_BODY_OPTICAL


def find_experience(scene: Scene, name: str | None) -> Experience | None:
    """Return the experience of a name or drive; None for none. ValueError where the map has no such one."""
    if not name:
        return None
    known = {str(one): one for one in reversed(scene.experiences)}
    if name not in known:
        raise ValueError(f"--experience: expected one of {', '.join(map(repr, reversed(known)))}, found {name!r}")
    return known[name]


def camera_for(size: tuple[int, int], fov_deg: float) -> Pinhole:
    """Return a pinhole camera of a size and a horizontal field of view; ValueError for others."""
    width, height = size
    if not 1.0 <= fov_deg <= 150.0:
        raise ValueError(f"--fov: expected 1 to 150 degrees, found {fov_deg:g}")
    focal = 0.5 * width / np.tan(0.5 * np.radians(fov_deg))
    return Pinhole(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))


def write_view(scene: Scene, T_map_camera: SE3, arguments: argparse.Namespace) -> int:
    """Write the view from a pose as a picture."""
    output: Path = arguments.screenshot
    check_ending(output, ENDINGS)
    check_free(arguments, output)
    experience = find_experience(scene, arguments.experience)
    view = scene.render(T_map_camera, camera_for(arguments.size, arguments.fov), experience, count=NUM_FILLING)
    output.write_bytes(encoded(shown(view), output.suffix))
    print(f"{output}: {view.image.shape[1]} x {view.image.shape[0]}, {100 * view.is_known.mean():.1f} % seen")
    return 0


def serve(reader: MapReader, scene: Scene, start: SE3, arguments: argparse.Namespace) -> int:
    """Show the page until interrupted; with a drive, localise and show it."""
    gate.import_viser("view")
    token = gate.token_for(arguments.token)
    recorded = RecordedCamera(arguments.bag, arguments) if arguments.bag else None
    shown_first = find_experience(scene, arguments.experience)
    page = Page(reader.graph, scene, start, shown_first, place=(arguments.host, arguments.port), token=token)
    print(f"{page.url}  (Ctrl-C ends it)", flush=True)
    try:
        if recorded is not None:
            params = build(LocalizerParams, recorded.patience | arguments.settings)
            localizer = Localizer(params, reader)
            with closing(localizer.references):
                replay_drive(recorded, localizer, page)
        threading.Event().wait()
    finally:
        page.close()
    return 0


def replay_drive(recorded: RecordedCamera, localizer: Localizer, page: Page) -> None:
    """Show a drive at its own pace, or as fast as it can be localised."""
    begin, first_ns = time.monotonic(), 0
    for stamp_ns, image, estimate in recorded.localized(localizer, recorded.camera):
        first_ns = first_ns or stamp_ns
        time.sleep(max(0.0, 1e-9 * (stamp_ns - first_ns) - (time.monotonic() - begin)))
        page.show(stamp_ns, image, estimate, recorded.camera)
