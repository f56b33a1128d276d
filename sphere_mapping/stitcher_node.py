"""The node `sphere_stitcher`: the images of a rig in, augmented spheres out."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from sphere_nav_msgs.msg import AugmentedSphere
from tf2_msgs.msg import TFMessage

from node_kit import conversions, qos
from node_kit.node import ERROR, OK, WARN, ManagedNode
from node_kit.run import run
from sphere_geometry import Rig
from sphere_geometry.rig_file import read_rig
from sphere_mapping.stitching import kernels
from sphere_mapping.stitching.params import SphereStitcherParams
from sphere_mapping.stitching.stitcher import Stitcher
from sphere_mapping.stitching.synchroniser import Instant, Synchroniser

INFO_TOLERANCE = 1e-3  # relative; a camera_info that differs more is of another camera


class SphereStitcher(ManagedNode):
    """Converts, waits for the cameras of an instant, asks the stitcher, converts back."""

    NAME = "sphere_stitcher"
    PARAMS = SphereStitcherParams
    LARGE_MESSAGES = True
    params: SphereStitcherParams

    def configure(self) -> None:
        """Read the rig, compute its tables, open topics."""
        p = self.params
        if not p.rig:
            raise ValueError("parameter rig: expected a rig file (rig.yaml), found none")
        self.rig = read_rig(p.rig)
        kernels.warm_up()
        self.stitcher = Stitcher(self.rig, p.stitch, masks_of(self.rig), p.jobs)
        self.sync = Synchroniser(self.rig.names, p.sync)
        self.points: NDArray[np.float32] | None = None
        self.sphere = self.announce("sphere", AugmentedSphere, qos.LARGE)
        self.preview = self.announce("sphere/preview/compressed", CompressedImage, qos.SENSOR)
        self.tf_static = self.announce("/tf_static", TFMessage, qos.TF_STATIC)
        is_raw = p.transport == "raw"
        for name in self.rig.names:
            topic = f"cameras/{name}/image_raw" + ("" if is_raw else "/compressed")
            kind, profile = (Image, qos.LARGE) if is_raw else (CompressedImage, qos.SENSOR)
            self.listen(topic, kind, partial(self.on_image, name), profile, is_required=False)
            self.listen(f"cameras/{name}/camera_info", CameraInfo, partial(self.on_info, name), is_required=False)
        if p.has_cloud:
            self.listen("points", PointCloud2, self.on_points)
        self.every(p.sync.deadline_s / 4, self.on_tick)
        self.report("stitching", OK, "waiting for images")

    def activate(self) -> None:
        """Tell where the sphere is on the rig."""
        p, T_rig_sphere = self.params, self.stitcher.T_rig_sphere
        transform = conversions.se3_to_transform(T_rig_sphere, self.now_ns(), p.rig_frame, p.sphere_frame)
        self.tf_static.publish(TFMessage(transforms=[transform]))

    def clock_jumped(self) -> None:
        """Forget half-complete instants."""
        self.sync.clear()

    def on_info(self, name: str, message: CameraInfo) -> None:
        """Refuse a camera whose own calibration is of another size or focal length than the rig's."""
        ours, width = self.rig.camera(name).camera, int(message.width)
        if (width, int(message.height)) != (ours.width, ours.height):
            found = f"{width} x {message.height}"
            raise ValueError(f"{name}: size: expected {ours.width} x {ours.height} (rig file), found {found}")
        fx = float(ours.coefficients[0])
        if message.k[0] and ours.model != "double_sphere" and abs(message.k[0] - fx) > INFO_TOLERANCE * fx:
            raise ValueError(f"{name}: K[0]: expected {fx:.3f} (rig file), found {message.k[0]:.3f}")

    def on_points(self, message: PointCloud2) -> None:
        """Keep the newest cloud, in the frame of the rig."""
        self.points = conversions.message_to_cloud(message)[0]

    def on_image(self, name: str, message: Image | CompressedImage) -> None:
        """Add a camera's image to its instant."""
        is_raw = isinstance(message, Image)
        image = conversions.image_to_rgb(message) if is_raw else conversions.compressed_to_array(message)
        camera = self.rig.camera(name).camera
        if image.shape[:2] != (camera.height, camera.width):
            found = f"{image.shape[1]} x {image.shape[0]}"
            raise ValueError(f"{name}: image size: expected {camera.width} x {camera.height} (rig file), found {found}")
        for instant in self.sync.put(name, conversions.stamp_ns(message), image, self.now_ns()):
            self.deliver(instant)

    def on_tick(self) -> None:
        """Close instants whose cameras are late."""
        for instant in self.sync.take(self.now_ns()):
            self.deliver(instant)

    def finish_open(self) -> None:
        """Stitch what is still open: the recording has ended."""
        for instant in self.sync.flush():
            self.deliver(instant)

    def deliver(self, instant: Instant) -> None:
        """Stitch an instant and publish its sphere; whatever lacks is told by name."""
        self.tell_health()
        for name, problem in instant.notes.items():
            self.log.warning(f"camera {name}: {problem}", every=5.0, key=name)
        if instant.is_failed or not instant.images:
            self.log.error(f"no sphere at {instant.stamp_ns / 1e9:.3f} s: {', '.join(instant.notes)}", every=5.0)
            return
        stitched = self.stitcher.stitch(instant.images, instant.stamp_ns, self.points)
        sphere, frame = stitched.sphere, self.params.sphere_frame
        self.sphere.publish(conversions.sphere_to_message(sphere, frame))
        if self.preview.num_listeners:
            self.preview.publish(self.previewed(sphere.image, instant.stamp_ns))

    def tell_health(self) -> None:
        """Report every camera."""
        for name, health in self.sync.health.items():
            level = OK if not health.problem else ERROR if health.problem.startswith("frozen") else WARN
            values = {"images": health.num_images, "missing": health.num_missing, "refused": health.num_refused}
            self.report(f"camera {name}", level, health.problem or "delivers", **values)

    def previewed(self, image: NDArray[np.uint8], stamp: int) -> CompressedImage:
        """Return a small JPEG of the sphere."""
        width = min(self.params.preview_width, image.shape[1])
        small = cv2.resize(image, (width, width // 2), interpolation=cv2.INTER_AREA)
        small = cv2.cvtColor(small, cv2.COLOR_RGB2BGR) if small.ndim == 3 else small
        data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, self.params.preview_quality])[1].tobytes()
        return CompressedImage(header=conversions.header(stamp, self.params.sphere_frame), format="jpeg", data=data)


def masks_of(rig: Rig) -> dict[str, NDArray[np.uint8]]:
    """Read the masks of a rig's cameras."""
    found = {}
    for part in rig.cameras:
        if part.mask is not None:
            image = cv2.imdecode(np.fromfile(Path(part.mask), np.uint8), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise ValueError(f"{part.mask}: mask of {part.name}: expected an image, found none")
            found[part.name] = image.astype(np.uint8)
    return found


def main() -> int:
    """Run the node."""
    return run(SphereStitcher)
