"""Where the camera is before the image has been aligned: motion on SE(3), odometry, measured rotation, the ground.

All times are differences of image stamps. The covariance is that of a tangent vector (v, omega) in the camera frame:
T_map_camera @ exp(xi). It grows from the last alignment on, also while images are refused.

The pose is relative to the map. Whoever uses it as odometry needs something else: how far has the camera come since it
was localized? Key spheres err against one another, so that this uncertainty grows with the way (`map_error.py`).

Does a predicted motion move the last images onto the present ones? Where it does not, the rotation is measured
(`InterFrame`, M15 section 5.2): between two images rotation dominates, and the coarsest level shows it (eq. 20). Asking
costs a few hundred pixels; measuring costs an alignment, so it is done only where the answer is no.

A vehicle stands on the ground that was taught: its height, roll and pitch are those of the key spheres around it. That
is worth most to a narrow view, in which a step ahead looks like a change of height and pitch, and cars that stand
elsewhere decide between them. How even the ground is say the key spheres themselves. Nothing is expected where nobody
tells how a camera sits on the vehicle, or where a map was taken by hand (`Ground`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dense_localizer.constants import (
    GAP_PERIODS,
    GAP_S,
    GROUND_SIGMA,
    IMAGE_FORGETTING,
    MAX_ATTITUDE_SIGMA_RAD,
    MAX_INNOVATION,
    MAX_MISMATCH_RATIO,
    MAX_POSITION_SIGMA_M,
    MAX_REACH_M,
    MAX_ROTATION_MISMATCH,
    MISMATCH_FLOOR,
    NUM_PERIODS,
    START_SPEED,
    START_TURN_RATE,
)
from dense_localizer.inputs import LocalizerInput
from dense_localizer.params import PriorParams
from dense_localizer.references.map_error import MapDrift
from sphere_nav.estimation.least_squares import scaled_inverse, squared_distance
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.photometric import RegistrationParams, register_rotation
from sphere_nav.photometric.align.esm import UNKNOWN, correlation_after_turn
from sphere_nav.photometric.align.problem import NO_EXPECTATION, Expectation, RigImage
from sphere_nav.spheres.graph import Experience, SphereGraph


class InterFrame:
    """Keeps the last images and how well predictions have matched them."""

    def __init__(self, params: RegistrationParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Nothing is known of the stream."""
        self.images: tuple[RigImage, ...] = ()  # the last ones, placed or not
        self._usual: float | None = None  # mismatch of predictions

    def refine(self, images: Sequence[RigImage], T_before_now: SE3) -> SE3 | None:
        """Return a measured rotation (eq. 20) where images do not support a predicted motion but support that one.

        By the first camera of which there are both images.
        """
        earlier = {image.name: image.pyramid for image in self.images}
        image = next((one for one in images if one.name in earlier), None)
        if image is None:
            return None
        pair, R_body_camera = (image.pyramid, earlier[image.name]), image.mount.rotation
        before = correlation_after_turn(*pair, R_body_camera.T @ T_before_now.rotation @ R_body_camera)
        if before is None:
            return None
        predicted = residual = 1.0 - before
        measured: SE3 | None = None
        if self._usual is None or predicted > MAX_MISMATCH_RATIO * self._usual + MISMATCH_FLOOR:
            R_camera = register_rotation(*pair, self._params).rotation
            after = correlation_after_turn(*pair, R_camera)
            if after is not None and 1.0 - after <= MAX_ROTATION_MISMATCH * predicted:
                measured = SE3.from_parts(R_body_camera @ R_camera @ R_body_camera.T, np.zeros(3))
                residual = 1.0 - after
        usual, weight = self._usual, IMAGE_FORGETTING
        self._usual = residual if usual is None else weight * usual + (1.0 - weight) * residual
        return measured


SHARES, TINY = np.linspace(0.0, 1.0, 21), np.finfo(float).tiny


@dataclass(frozen=True)
class Prediction:
    """Pose and covariance (6, 6) at a stamp; `step_s` since the last image, `blind_s` since the last alignment."""

    T_map_camera: SE3
    covariance: Array
    stamp_ns: int
    step_s: float = 0.0
    max_step_s: float = GAP_S  # a longer one is a gap
    blind_s: float = 0.0
    defies_odometry: bool = False  # made without the odometry that was there
    is_guess: bool = False  # of a search: the pose may be any other
    is_near: bool = False  # of a search near a pose that was given or lost
    is_trusted: bool = False  # made while the pose is trusted
    experience: Experience | None = None  # of a guess: whose key spheres parts of the view resemble
    asks_parts: bool = True  # likely enough for parts of the view to be asked where grey levels do not align
    by_contrast: bool | None = None  # aligned by local contrast, or by grey levels; None: by what serves at present
    T_map_aligned: SE3 | None = None  # pose of the last alignment
    growth: Array | None = None  # covariance (6, 6) of the motion since then
    expected: Expectation = NO_EXPECTATION  # of the ground, whatever the motion

    @staticmethod
    def guess(T_map_camera: SE3, *, is_near: bool = False, experience: Experience | None = None) -> Prediction:
        """Return a pose to try of which nothing else is known.

        Near a known one it is tried by what serves at present; in another light, where parts of the view resemble those
        of an experience, by local contrast; else by grey levels.
        """
        asks_parts = is_near or experience is not None
        return Prediction(
            T_map_camera,
            UNKNOWN,
            0,
            is_guess=True,
            is_near=is_near,
            experience=experience,
            asks_parts=asks_parts,
            by_contrast=None if is_near else experience is not None,
        )

    @property
    def finding(self) -> Verdict:
        """What makes a pose found from this prediction one to use with care."""
        if self.defies_odometry:
            return Verdict(Reason.ODOM_STALE, detail="odometry disagrees with the images")
        return Verdict(Reason.GAP, self.step_s, self.max_step_s) if self.step_s > self.max_step_s else FINE

    def frame_motion(self, readout_s: float) -> FrameMotion | None:
        """Return the motion within the frame by that since the last alignment; None for a global shutter."""
        if self.T_map_aligned is None or readout_s == 0.0 or self.blind_s <= 0.0:
            return None
        return FrameMotion(self.T_map_aligned, readout_s / self.blind_s)

    def distance(self, T_map_camera: SE3, covariance: Array) -> float:
        """Return how far a measured pose is from this one, in standard deviations of both together."""
        return float(np.sqrt(squared_distance(self.T_map_camera, T_map_camera, self.covariance + covariance)))

    def join(self, T_map_camera: SE3, covariance: Array) -> tuple[SE3, Array]:
        """Return the pose, and its covariance, that a measured one and this one make together.

        Both err with the map, nobody knows how much alike: their information is shared out (covariance intersection),
        so that the result is right for whatever they have in common. What is not trusted adds nothing: on probation,
        images have to agree by themselves.
        """
        if self.is_guess or not self.is_trusted:
            return T_map_camera, covariance
        measured, predicted = scaled_inverse(covariance), scaled_inverse(self.covariance)
        share = share_out(measured, predicted)
        joint = scaled_inverse((1.0 - share) * measured + share * predicted)
        xi = (T_map_camera.inverse() @ self.T_map_camera).log()
        return T_map_camera @ SE3.exp(joint @ (share * predicted @ xi)), joint

    @property
    def is_certain(self) -> bool:
        """Whether the position is known well enough to go on from."""
        return measure_position_sigma(self.covariance) <= MAX_POSITION_SIGMA_M


def share_out(one: Array, other: Array) -> float:
    """Return by which share the second of two informations (6, 6) leaves the least volume of uncertainty, 0...1."""
    ratios = np.linalg.eigvals(np.linalg.solve(one, other)).real
    logs = np.log(np.maximum(1.0 + SHARES[:, None] * (ratios - 1.0), TINY)).sum(axis=1)
    return float(SHARES[np.argmax(logs)])


def measure_position_sigma(covariance: Array) -> float:
    """Return the largest standard deviation of the position in m."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))


class PosePrior:
    """The last pose, its velocity and what is not known about them."""

    def __init__(
        self, params: PriorParams, graph: SphereGraph | None = None, inter_frame: InterFrame | None = None
    ) -> None:
        """`graph` is that of the map whose errors add up along the way; `inter_frame` measures rotations, if given."""
        self._params, self.drift, self._inter_frame = params, MapDrift(graph), inter_frame
        self.reset()

    def reset(self) -> None:
        """Know nothing."""
        self.velocity: Array | None = None  # (6,) (v, omega) in the camera frame, per second
        self.velocity_covariance: Array | None = None  # (6, 6)
        self._noise: Array = np.zeros((6, 6))  # of the last alignment
        self._held: Prediction | None = None  # pose at the last image, aligned or predicted
        self._aligned: Prediction | None = None  # pose at the last alignment
        self._confirmed_ns = 0  # stamp of the last alignment with the map
        self._T_odom_aligned: SE3 | None = None
        self._T_odom_held: SE3 | None = None
        self._defies_odometry = False  # an image has refused what odometry said, no other one what did without it
        self._periods_s: deque[float] = deque(maxlen=NUM_PERIODS)

    @property
    def last(self) -> Prediction | None:
        """The pose at the last image, predicted where it could not be aligned."""
        return self._held

    def age(self, stamp_ns: int) -> float:
        """Return the seconds since the last alignment with the map, 0 before the first."""
        return (stamp_ns - self._confirmed_ns) * 1e-9 if self._aligned is not None else 0.0

    def start(self, T_map_camera: SE3, covariance: Array, stamp_ns: int, T_odom_camera: SE3 | None = None) -> None:
        """Begin at a found pose, with unknown velocity."""
        self._defies_odometry = False
        self.velocity = self.velocity_covariance = self._aligned = None
        self.drift.reset()
        self.correct(T_map_camera, covariance, stamp_ns, T_odom_camera)

    def predict(self, stamp_ns: int, T_odom_camera: SE3 | None = None, T_before_now: SE3 | None = None) -> Prediction:
        """Return the pose at `stamp_ns`, by odometry where given, else by velocity.

        `T_before_now` is a measured rotation since the last image (M15 eq. 20); it replaces the predicted one, and what
        both differ by is not known.
        """
        held, aligned = self._held, self._aligned
        if held is None or aligned is None:
            raise ValueError("prediction: expected a started prior, found none")
        step_s, blind_s = (stamp_ns - held.stamp_ns) * 1e-9, (stamp_ns - aligned.stamp_ns) * 1e-9
        T_held_now, growth = self._motion(step_s, T_odom_camera), np.diag(self._growth(blind_s, T_odom_camera) ** 2)
        if T_before_now is not None:
            T_turned = SE3.from_parts(T_before_now.rotation, T_held_now.translation)
            xi = (T_turned.inverse() @ T_held_now).log()
            T_held_now, growth = T_turned, growth + np.outer(xi, xi)
        T_map_camera = held.T_map_camera @ T_held_now
        Ad = (T_map_camera.inverse() @ aligned.T_map_camera).adjoint()
        covariance, before = Ad @ aligned.covariance @ Ad.T + growth, aligned.T_map_camera
        max_step_s = max(GAP_S, GAP_PERIODS * float(np.median(self._periods_s))) if self._periods_s else GAP_S
        steps = step_s, max_step_s, blind_s
        return Prediction(T_map_camera, covariance, stamp_ns, *steps, T_map_aligned=before, growth=growth)

    def propose(self, frame: LocalizerInput) -> Prediction:
        """Return the prediction of an instant: by odometry or velocity, whichever served the last image.

        Where an image has refused one, the next is tried with the other: odometry may be wrong. The rotation since the
        last image (M15 eq. 20) is measured where the images do not support a predicted motion.
        """
        T_odom_camera = None if self._defies_odometry else frame.T_odom_camera
        T_held_now = self._motion(self.pause_s(frame.stamp_ns), T_odom_camera)
        T_before_now = self._inter_frame.refine(frame.images, T_held_now) if self._inter_frame else None
        prediction = self.predict(frame.stamp_ns, T_odom_camera, T_before_now)
        return replace(prediction, defies_odometry=frame.T_odom_camera is not None and self._defies_odometry)

    def pause_s(self, stamp_ns: int) -> float:
        """Return the seconds since the last image."""
        return (stamp_ns - self._held.stamp_ns) * 1e-9 if self._held is not None else 0.0

    def hold(self, prediction: Prediction, T_odom_camera: SE3 | None = None, *, is_refused: bool = False) -> None:
        """Go on from the prediction: the image could not be aligned, or its alignment was refused."""
        self._defies_odometry = is_refused and not self._defies_odometry
        self._move_to(prediction, T_odom_camera)

    def correct(
        self,
        T_map_camera: SE3,
        covariance: Array,
        stamp_ns: int,
        T_odom_camera: SE3 | None = None,
        noise: Array | None = None,
        *,
        is_by_map: bool = True,
    ) -> None:
        """Go on from an accepted alignment; its motion since the one before is the new velocity.

        `noise` (6, 6) is the part of the covariance that is new with each image: an error of the map that two images
        in a row share moves no velocity. None: all of it. One that is not by the map makes the pose no younger.
        """
        noise = covariance if noise is None else noise
        before = self._aligned
        if self._defies_odometry and before is not None:
            by_odometry = self.predict(stamp_ns, T_odom_camera)
            self._defies_odometry = by_odometry.distance(T_map_camera, covariance) > MAX_INNOVATION
        if before is not None and stamp_ns > before.stamp_ns:
            elapsed_s = (stamp_ns - before.stamp_ns) * 1e-9
            self.velocity = (before.T_map_camera.inverse() @ T_map_camera).log() / elapsed_s
            self.velocity_covariance = (self._noise + noise) / elapsed_s**2
        self._noise = noise
        self._aligned, self._T_odom_aligned = Prediction(T_map_camera, covariance, stamp_ns), T_odom_camera
        self._move_to(self._aligned, T_odom_camera)
        if is_by_map:
            self._confirmed_ns = stamp_ns

    def _move_to(self, pose: Prediction, T_odom_camera: SE3 | None) -> None:
        if self.pause_s(pose.stamp_ns) > 0.0:
            self._periods_s.append(self.pause_s(pose.stamp_ns))
        self._held, self._T_odom_held = pose, T_odom_camera
        self.drift.propagate(pose.T_map_camera)

    def _motion(self, step_s: float, T_odom_camera: SE3 | None) -> SE3:
        if T_odom_camera is not None and self._T_odom_held is not None:
            return self._T_odom_held.inverse() @ T_odom_camera
        return SE3.identity() if self.velocity is None else SE3.exp(self.velocity * step_s)

    def _growth(self, blind_s: float, T_odom_camera: SE3 | None) -> Array:
        """Return the standard deviation (6,) of the motion since the last alignment."""
        params = self._params
        if T_odom_camera is not None and self._T_odom_aligned is not None:
            distance, angle = self._T_odom_aligned.distance(T_odom_camera)
            return params.odometry_error * np.repeat([distance, angle], 3)
        speed = np.zeros(2) if self.velocity is not None else np.array([START_SPEED, START_TURN_RATE])
        acceleration = np.array([params.acceleration, params.angular_acceleration])
        return np.repeat(speed * blind_s + 0.5 * acceleration * blind_s**2, 3)


ON_GROUND = [2, 3, 4]  # of a tangent vector of the base: height, roll, pitch


class Ground:
    """The ground of one map. `T_base_body`: the camera, or what several share, on the vehicle; None: nobody knows."""

    def __init__(self, graph: SphereGraph, T_base_sphere: SE3 | None) -> None:
        self.T_base_body: SE3 | None = None
        first = graph[min(graph.nodes)]
        # Later drives have mounts of their own, which nobody tells.
        taught = [node for node in graph if node.experience == first.experience]
        self._taught = SphereGraph(sorted(taught, key=lambda node: node.id))
        self._T_sphere_base = (T_base_sphere or SE3.identity()).inverse()
        # (3,) m, rad; None: no vehicle on a ground, or nobody knows how it carried the spheres.
        self.sigma = self._measure() if T_base_sphere is not None else None

    def stand(self, prediction: Prediction) -> Prediction:
        """Return a prediction with what the ground says of its pose."""
        return replace(prediction, expected=self.expect(prediction.T_map_camera))

    def camera_on_base(self, T_body_camera: SE3 | None) -> SE3 | None:
        """Return where a camera of the body is on the vehicle; None: nobody knows."""
        if self.T_base_body is None or T_body_camera is None:
            return self.T_base_body
        return self.T_base_body @ T_body_camera

    def height_above(self, T_base_camera: SE3) -> float:
        """Return by how much in m a camera is higher than the key spheres; 0 where nobody knows."""
        if self.sigma is None:
            return 0.0
        return float((self._T_sphere_base @ T_base_camera).translation[2])

    def expect(self, T_map_body: SE3, T_body_camera: SE3 | None = None) -> Expectation:
        """Return what the ground says of the body near a pose; or of a camera on it, then the pose is that one's."""
        T_base_body = self.camera_on_base(T_body_camera)
        if T_base_body is None or self.sigma is None:
            return NO_EXPECTATION
        if not (near := self._taught.nearest(T_map_body.translation, 1, MAX_REACH_M)):
            return NO_EXPECTATION
        T_map_ground, T_map_base = near[0].T_map_sphere @ self._T_sphere_base, T_map_body @ T_base_body.inverse()
        place = T_map_ground.inverse() @ T_map_base
        x, y, _ = place.translation.tolist()
        T_map_expected = T_map_ground @ SE3.from_planar(x, y, float(place.yaw)) @ T_base_body
        A = T_base_body.adjoint()[ON_GROUND]
        return Expectation(T_map_expected, A.T @ np.diag(self.sigma**-2) @ A)

    def _measure(self) -> Array | None:
        """Return how far height, roll and pitch differ between neighbours, but for what is assumed at least."""
        T_map_base = [node.T_map_sphere @ self._T_sphere_base for node in self._taught]
        steps = [a.inverse() @ b for a, b in pairwise(T_map_base) if a.distance(b)[0] <= MAX_REACH_M]
        differ = np.array([[T.translation[2], *T.angles[:2]] for T in steps]).reshape(-1, 3)
        sigma = np.sqrt(np.mean(differ**2, axis=0)) if steps else np.zeros(3)
        return np.maximum(sigma, GROUND_SIGMA) if max(sigma[1:]) <= MAX_ATTITUDE_SIGMA_RAD else None
