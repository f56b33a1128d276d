"""The node `sphere_stitcher`: the images of a rig in, augmented spheres and a small JPEG of each out."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
from sensor_msgs.msg import CompressedImage
from sphere_nav_msgs.msg import AugmentedSphere
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from sphere_mapping.acquisition.constants import WARN_DEG
from sphere_mapping.acquisition.params import SphereStitcherParams
from sphere_mapping.acquisition.range.rectification import rectify
from sphere_mapping.acquisition.ros.rig_intake import RigInstant, RigIntake
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.acquisition.stitching.views import masks_of
from sphere_mapping.acquisition.warm_up import warm_up
from sphere_nav.geometry import Rig
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.node import OK, WARN, ManagedNode
from sphere_nav.ros.run import run
from sphere_nav.ros.service import one_line
from sphere_nav.ros.tf import TransformListener, TransformTree
from sphere_nav.spheres.sphere import Sphere

WIDTH, QUALITY = 1024, 80  # columns; of JPEG


def draw_preview(sphere: Sphere, frame_id: str) -> CompressedImage:
    """Return a small JPEG of the sphere."""
    width = min(WIDTH, sphere.image.shape[1])
    small = cv2.resize(sphere.image, (width, width // 2), interpolation=cv2.INTER_AREA)
    small = cv2.cvtColor(small, cv2.COLOR_RGB2BGR) if small.ndim == 3 else small
    data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    return CompressedImage(header=conversions.header(sphere.stamp_ns, frame_id), format="jpeg", data=data)


class SphereStitcher(ManagedNode):
    """Converts, waits for the cameras of an instant, asks the stitcher, converts back."""

    NAME = "sphere_stitcher"
    PARAMS = SphereStitcherParams
    LARGE_MESSAGES = True
    params: SphereStitcherParams

    def configure(self) -> None:
        """Read the rig, compute its tables, open topics."""
        warm_up()
        self.intake: RigIntake | None = None
        self.sphere = self.add_publisher("sphere", AugmentedSphere, qos.LARGE)
        self.preview = self.add_publisher("sphere/preview/compressed", CompressedImage, qos.SENSOR)
        self.tf_static = self.add_publisher("/tf_static", TFMessage, qos.TF_STATIC)
        if self.params.rig:
            self.use(read_rig(self.params.rig))
        else:
            self.add_subscription("rig_description", String, self.on_description, qos.LATCHED, silence=0.0)

    def activate(self) -> None:
        """Tell where the sphere is on the rig."""
        if self.intake is not None:
            self.publish_frame()

    def clock_jumped(self) -> None:
        """Forget half-complete instants."""
        if self.intake is not None:
            self.intake.clear()

    def on_description(self, message: String) -> None:
        """Use the first rig file told."""
        if self.intake is not None:
            return
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rig.yaml"
            path.write_text(message.data, encoding="utf-8")
            try:
                rig = read_rig(path)
            except ValueError as error:
                raise ValueError(str(error).replace(str(path), "rig_description")) from None
        self.use(rig)
        self.publish_frame()

    def use(self, rig: Rig) -> None:
        """Compute the tables of a rig, listen to its cameras."""
        self.stitcher = Stitcher(rig, self.params.stitch, masks_of(rig), self.params.jobs)
        self.is_rectified = self.params.rectify.num_instants == 0
        tf = TransformListener(self.endpoints) if self.params.has_cloud else None
        lookup = tf.lookup if tf else TransformTree().lookup
        self.intake = RigIntake(rig, self.params, self.now_ns, lookup, self.on_instants)
        self.intake.subscribe(self.endpoints)
        if self.stitcher.warning:
            self.log.warning(self.stitcher.warning)
            self.report("range", WARN, self.stitcher.warning)
        self.add_timer(self.params.sync.deadline_s / 4, self.intake.close_late)
        self.report("stitching", OK, "waiting for images")

    def publish_frame(self) -> None:
        """Publish where the sphere is on the rig."""
        p, T_rig_sphere = self.params, self.stitcher.T_rig_sphere
        transform = conversions.se3_to_transform(T_rig_sphere, self.now_ns(), p.rig_frame, p.sphere_frame)
        self.tf_static.publish(TFMessage(transforms=[transform]))

    def finish_open(self) -> None:
        """Stitch what is still open: the recording has ended."""
        if self.intake is not None:
            self.intake.finish()

    def on_instants(self, instants: list[RigInstant]) -> None:
        """Stitch instants, after the first ones have corrected the rig where that is asked for."""
        if not self.is_rectified:
            self.rectify(instants)
        for instant in instants:
            self.deliver(instant)

    def rectify(self, instants: list[RigInstant]) -> None:
        """Correct the rig by what its cameras share."""
        self.is_rectified = True
        seen = [instant for instant in instants if instant.images]
        matches = [match for one in seen for match in self.stitcher.matches(one.images, one.points)]
        found = rectify(self.stitcher.rig, matches)
        self.stitcher = Stitcher(found.rig, self.params.stitch, masks_of(found.rig), self.params.jobs)
        self.publish_frame()
        worst = max(found.angle_deg, key=lambda name: found.angle_deg[name])
        text = f"{worst} turned by {found.angle_deg[worst]:.2f} deg against the rig file, the others less"
        is_off = found.angle_deg[worst] > WARN_DEG
        self.report("rig", WARN if is_off else OK, text, before_deg=found.before_deg, after_deg=found.after_deg)
        (self.log.warning if is_off else self.log.info)(f"rig: {text}")

    def deliver(self, instant: RigInstant) -> None:
        """Stitch an instant and publish its sphere; whatever lacks is told by name."""
        assert self.intake is not None
        for what, level, why, values in self.intake.health():
            self.report(what, level, why, **values)
        stamp, notes = instant.sync.stamp_ns, instant.sync.notes
        for name, problem in notes.items():
            self.log.warning(f"camera {name}: {problem}", every=5.0, key=name)
        if not instant.images:
            self.tell_lack(stamp, ", ".join(notes))
            return
        try:
            self.stitch(instant)
        except ValueError as error:  # of cameras that see too little: no message is to blame, nor a timer
            self.tell_lack(stamp, one_line(error))

    def tell_lack(self, stamp: int, why: str) -> None:
        """Say that there is no sphere of an instant."""
        self.log.error(f"no sphere at {stamp / 1e9:.3f} s: {why}", every=5.0, key="no sphere")
        self.report("stitching", WARN, f"no sphere: {why}")

    def stitch(self, instant: RigInstant) -> None:
        """Make the sphere of an instant and publish it."""
        sphere = self.stitcher.stitch(instant.images, instant.sync.stamp_ns, instant.points, instant.depths)
        self.publish(sphere)
        self.report("stitching", OK, "stitching")

    def publish(self, sphere: Sphere) -> None:
        """Tell a sphere, and show it where someone looks."""
        self.sphere.publish(conversions.sphere_to_message(sphere, self.params.sphere_frame))
        if self.preview.num_subscriptions:
            self.preview.publish(draw_preview(sphere, self.params.sphere_frame))


def main() -> int:
    """Run the node."""
    return run(SphereStitcher)
