"""The map as one browser shows it from above: what is on it, and a view that follows without a jump."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sphere_nav.geometry.arrays import Array, arc_lengths
from sphere_nav_tools.cli.gate import browser_pose
from sphere_nav_tools.cli.operate.words import Heard, ellipse, pieces, round_length

COLORS = {
    "path": (120, 140, 170),
    "ahead": (30, 110, 230),  # and the vehicle; red is left to what is wrong
    "trail": (220, 120, 30),
    "spheres": (150, 150, 150),  # and a vehicle whose pose is old
    "place": (20, 130, 60),
    "mark": (200, 30, 160),
}
BODY_M = (1.9, 1.2, 0.6)  # of the box that stands for the vehicle, as the Cycab
BEGIN = (0.0, -0.5, 25.0)  # of the view at first, m: from above, y up
SHOWN = {"path": "path", "ahead": "vehicle, way ahead", "trail": "driven", "place": "place", "mark": "clicked"}
LEGEND = " ".join(f'<span><b style="color:rgb{COLORS[name]}">&#9644;</b>{text}</span>' for name, text in SHOWN.items())
CALM, GLIDE = 0.02, 0.3  # share of the height that a step has at least; of the way back to the vehicle in a step


class Chart:
    """What one browser's map shows."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self._drawn: dict[str, Any] = {}
        with client.atomic():  # a browser that comes while the vehicle drives tells of another view than the first
            client.camera.position, client.camera.look_at = BEGIN, (0.0, 0.0, 0.0)
        client.scene.configure_default_lights(cast_shadow=False)

    def show(self, seen: Heard, is_followed: bool) -> None:
        """Draw what is new, and let the view follow the vehicle, where that is wished."""
        path, driven = seen.told("path")[0], seen.told(f"way by {seen.placed}")[0]
        self.draw("path", path, COLORS["path"], 0.02)
        self.draw("ahead", way_ahead(path, seen.told("follower")[0]), COLORS["ahead"], 0.06, 6.0)
        self.draw("driven", driven, COLORS["trail"], 0.2)  # well above: from far away depths of a browser are coarse
        self._show_spheres(seen.told("spheres")[0])
        self._show_places(seen)
        self._show_car(*seen.told(seen.placed))
        if driven and is_followed:
            self._glide_to(driven[-1])

    def draw(self, name: str, points: Any, color: tuple[int, ...], height: float, width: float = 3.0) -> None:
        """Draw a line, where it is another one than the last time, by half metres."""
        if points is not None and len(points) > 1:
            ends = np.round(2.0 * np.array([points[0], points[-1]])).tolist()
            if self._is_new(name, ends):
                self._lines(name, pieces(points, height), color, width)

    def _lines(self, name: str, points: Any, color: tuple[int, ...], width: float) -> Any:
        return self.client.scene.add_line_segments(
            f"/{name}", points=points, colors=color, thickness=width, thickness_units="screen"
        )

    def mark(self, name: str, begin: Array, *end: Array) -> None:
        """Show where the map was clicked, or dragged from and to."""
        self.client.scene.add_icosphere(f"/{name}", radius=0.4, color=COLORS["mark"], position=(*begin, 0.7))
        if end:
            self._lines(f"{name}_to", pieces([begin, *end], 0.7), COLORS["mark"], 4.0)

    def scale(self) -> str:
        """Return the scale of what is seen, where y of the map points, and a legend, as HTML."""
        camera = self.client.camera
        height = max(float(np.linalg.norm(np.subtract(camera.position, camera.look_at))), 0.1)
        metres_a_pixel = 2.0 * height * math.tan(0.5 * camera.fov) / max(camera.image_height, 1.0)
        length = round_length(120.0 * metres_a_pixel)
        right, down = browser_pose(camera).rotation[1, :2]  # y of the map in the view
        turn = math.degrees(math.atan2(right, -down))
        arrow = f'<svg width="26" height="26" viewBox="-13 -13 26 26"><g transform="rotate({turn:.0f})">'
        arrow += '<path d="M0-12 L6 8 L0 4 L-6 8Z" fill="currentColor"/></g></svg>'
        bar = f'<i style="width:{length / metres_a_pixel:.0f}px"></i>{length:g} m {arrow}y'
        return f'<div class="sn-scale">{bar}<div>{LEGEND}</div></div>'

    def _glide_to(self, goal: Array) -> None:
        """Move the view a little towards the vehicle where that leaves its middle; how it is turned, the mouse says."""
        camera = self.client.camera
        position = np.array(camera.position)
        middle = ground_point(position, browser_pose(camera).rotation[:, 2])  # `look_at` may be of another moment
        if middle is None:
            return
        step = GLIDE * (goal - middle)
        if np.hypot(*step) > CALM * position[2]:
            with self.client.atomic():
                camera.position, camera.look_at = (*(position[:2] + step), position[2]), (*(middle + step), 0.0)

    def _show_spheres(self, points: Any) -> None:
        if points is not None and len(points) and self._is_new("spheres", len(points)):
            solid = np.column_stack([points, np.zeros(len(points))]).astype(np.float32)
            self.client.scene.add_point_cloud("/spheres", points=solid, colors=COLORS["spheres"], point_size=0.25)

    def _show_places(self, seen: Heard) -> None:
        if self._is_new("places", seen.places):
            self.client.scene.remove_by_name("/places")
            self.client.scene.add_frame("/places", show_axes=False)
            for i, place in enumerate(seen.places):
                spot = (place.x, place.y, 0.0)
                self.client.scene.add_icosphere(f"/places/{i}", radius=0.4, color=COLORS["place"], position=spot)
                self.client.scene.add_label(f"/places/{i}/name", place.name)

    def _show_car(self, pose: Any, age: float) -> None:
        if pose is None:
            return
        x, y, yaw, covariance = pose
        color, scene = COLORS["ahead" if age < 1.0 else "spheres"], self.client.scene
        if self._is_new("car", color):
            front = (0.6, 0.0, 0.5 * BODY_M[2])  # the base is the rear axle
            self._car = scene.add_frame("/car", show_axes=False)
            scene.add_box("/car/body", color=color, dimensions=BODY_M, position=front, opacity=0.8)
            nose = pieces([(0.6, 0.4), (1.8, 0.0), (0.6, -0.4)], BODY_M[2] + 0.05)
            self._lines("car/nose", nose, (255, 255, 255), 3.0)
        if self._is_new("covariance", [color, np.round(np.log(np.abs(covariance) + 1e-6), 1).tolist()]):
            self._doubt = self._lines("covariance", pieces(ellipse(covariance), BODY_M[2] + 0.05), color, 2.0)
        self._car.position, self._car.wxyz = (x, y, 0.0), (math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
        self._doubt.position = (x, y, 0.0)

    def _is_new(self, name: str, mark: Any) -> bool:
        """Whether what is to be drawn is another one than the last time."""
        is_new, self._drawn[name] = self._drawn.get(name) != mark, mark
        return is_new


def way_ahead(path: Any, status: Any) -> Any:
    """Return the points of a path that are still to be driven; None without one."""
    if path is None or status is None or len(path) < 2:
        return None
    arc = arc_lengths(path)
    return path[min(int(np.searchsorted(arc, status.progress)), len(path) - 2) :]


def ground_point(origin: Any, direction: Any) -> Array | None:
    """Return where a ray meets the ground (2,); None where it does not."""
    if direction[2] > -1e-6:
        return None
    point: Array = np.asarray(origin, float) - np.asarray(direction, float) * (origin[2] / direction[2])
    return point[:2]
