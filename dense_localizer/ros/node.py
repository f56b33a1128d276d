"""The node `dense_localizer`: the localizer in a map of key spheres (sphere_nav/ros/localizer/node.py is around it)."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import Image

from dense_localizer.inputs import CameraImage
from dense_localizer.judge.residual import residual_image
from dense_localizer.localizer import Localizer
from dense_localizer.params import DenseLocalizerParams
from dense_localizer.ros.drive_recorder import DriveRecorder
from dense_localizer.ros.maps import Maps, read_calibration
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE, BaseEstimate, Reason, State, Status, Verdict, status_of
from sphere_nav.photometric import warm_up
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.intake import Cameras
from sphere_nav.ros.camera.stream import Picture
from sphere_nav.ros.localizer.node import LocalizerNode
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.ros.run import run
from sphere_nav.spheres.appearance.headings import warm_up as warm_up_headings


class DenseLocalizerNode(LocalizerNode):
    """Converts, calls the localizer, converts back."""

    NAME = "dense_localizer"
    PARAMS = DenseLocalizerParams
    NO_MAP = "set `map`, or call ~/load_map"
    params: DenseLocalizerParams

    def configure(self) -> None:
        """Open topics, services and the map."""
        warm_up()
        warm_up_headings()
        self.localizer: Localizer | None = None
        self.drive: DriveRecorder | None = None
        self.maps = Maps(self.endpoints, self.use_map)
        if self.params.map:
            self.maps.open(self.params.map)
        self.residual = self.add_publisher("residual", Image, qos.LARGE)
        super().configure()

    def cleanup(self) -> None:
        """Close the map."""
        self.end_drive()
        if self.localizer is not None:
            self.localizer.references.close()
        self.maps.close()
        self.localizer = None

    def make_intake(self) -> Cameras:
        """Subscribe to the camera, or to those of a rig."""
        p, callbacks = self.params, (self.on_picture, self.on_refusal)
        if not self.has_rig:
            return Cameras(self.endpoints, p, *callbacks, has_depth=p.use_depth)
        if p.use_depth:
            raise ValueError(f"use_depth: expected one camera, found several: {p.rig.cameras or p.rig.calibration}")
        calibration = read_calibration(p.rig.calibration, self.maps.reader)
        return Cameras(self.endpoints, p, *callbacks, rig=p.rig, calibration=calibration)

    @property
    def has_rig(self) -> bool:
        """Whether several cameras localize together."""
        return bool(self.params.rig.cameras or self.params.rig.calibration)

    def use_map(self, reader: MapReader) -> None:
        """Localize in a map from now on."""
        is_live, before = self.endpoints.is_live and not self.params.every_image, self.localizer
        self.localizer = Localizer(self.params, reader, is_live=is_live)
        self.end_drive()
        if self.params.learn:
            self.drive = DriveRecorder(reader, self.log.info, is_live=is_live)
        if before is not None:
            before.references.close()

    def end_drive(self) -> None:
        """Let what was kept of a drive have its name."""
        if self.drive is not None:
            self.drive.close()
        self.drive = None

    @property
    def is_ready(self) -> bool:
        """Whether there is a map, and the camera's place on the base is known."""
        return self.localizer is not None and self.intake.is_mounted

    @property
    def has_map(self) -> bool:
        """Whether a map is open."""
        return self.localizer is not None

    @property
    def map_id(self) -> str:
        """The name of the map in use."""
        return str(self.maps.reader.info.map_id) if self.maps.reader is not None else ""

    def localize(self, picture: Picture) -> BaseEstimate:
        """Localize one image; publish the residual where anyone subscribes to it."""
        if self.localizer is None:
            return BaseEstimate(self.refuse(picture.stamp_ns, FINE))
        T_base_body = self.intake.T_base_camera
        is_told = self.has_rig or bool(np.any(T_base_body.translation))
        self.localizer.references.ground.T_base_body = T_base_body if is_told else None
        T_odom_body = picture.T_odom_base and picture.T_odom_base @ T_base_body
        images = self.images_of(picture)
        estimate = self.localizer.update_rig(images, picture.stamp_ns, T_odom_body)
        if self.drive is not None:
            self.drive.see(images, estimate)
        if estimate.candidate is not None and self.residual.num_subscriptions:
            shown, frame = residual_image(picture.image, picture.camera, estimate.candidate), self.params.camera_frame
            self.residual.publish(conversions.array_to_image(shown, picture.stamp_ns, frame, "mono8"))
        return estimate.to_base(T_base_body)

    def images_of(self, picture: Picture) -> tuple[CameraImage, ...]:
        """Return the images of an instant; one camera is its own body, that of several is the base."""
        if not self.has_rig:
            return (CameraImage(picture.image, picture.camera, depth=picture.depth),)
        return tuple(
            CameraImage(one.image, one.camera, one.T_base_camera, one.name, (one.stamp_ns - picture.stamp_ns) * 1e-9)
            for one in (picture, *picture.others)
        )

    def refuse(self, stamp_ns: int, finding: Verdict) -> Status:
        """Return the status of an image that cannot be used."""
        if self.localizer is None:
            return status_of(State.NO_MAP, stamp_ns, Verdict(Reason.NONE, advice=self.NO_MAP))
        return self.localizer.refuse(stamp_ns, finding).status

    def silence(self, elapsed_s: float, finding: Verdict) -> Status | None:
        """Return what to say of a silent camera."""
        return self.localizer.silence(elapsed_s, finding) if self.localizer is not None else None

    def relocalize(self, given: tuple[SE3, Array] | None) -> BaseEstimate | None:
        """Search with the last image, and those to come; what is found is returned, though not trusted yet."""
        if self.localizer is None:
            raise ValueError("relocalize: expected a map, found none: load one first")
        T_base_camera = self.intake.T_base_camera
        estimate = self.localizer.relocalize(given[0] @ T_base_camera if given is not None else None)
        return estimate.expose_candidate().to_base(T_base_camera) if estimate is not None else None

    def forget(self) -> None:
        """Forget pose and stream."""
        if self.localizer is not None:
            self.localizer.reset()


def main() -> int:
    """Run the node."""
    return run(DenseLocalizerNode)
