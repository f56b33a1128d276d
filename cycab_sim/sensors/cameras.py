"""What is mounted on the car, where, and what its sensors add to a perfect image."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import ImagingParams, SimCameraParams, SphereParams
from cycab_sim.sensors.lenses import make_lens
from sphere_nav.geometry import SE3, Camera, Spherical

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # body axes of optical axes


@dataclass(frozen=True)
class Mount:
    """A camera on the car: its model, its place, its frame, whether it sees grey only, and its noise.

    T_base_camera maps camera coordinates (optical axes, body axes for a sphere) to the car's;
    noise in grey levels, shot_noise as variance over the grey level;
    noises as they are without `imaging`; cameras of one group have one exposure.
    """

    name: str
    frame_id: str
    camera: Camera
    T_base_camera: SE3
    is_grey: bool
    noise: float
    shot_noise: float
    group: str
    imaging: ImagingParams = field(default_factory=ImagingParams)


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """An image (H, W[, 3]) u1 and range along the ray (H, W) f32 m of one instant."""

    image: NDArray[np.uint8]
    range_m: NDArray[np.float32]
    camera: Camera
    stamp_ns: int
    index: int
    range_std_m: None = None  # the range is exact


def forward_camera(params: SimCameraParams, imaging: ImagingParams) -> Mount:
    """Return the camera for driving; the frame of a panorama has body axes."""
    camera = make_lens(params, "camera")
    tilt = SE3.exp([0.0, 0.0, 0.0, 0.0, np.radians(params.pitch_deg), 0.0])
    place = SE3.from_parts(np.eye(3), [params.x, params.y, params.z])
    is_sphere = params.model == "panorama"
    T_base_camera = place @ tilt @ SE3.from_parts(np.eye(3) if is_sphere else OPTICAL, np.zeros(3))
    frame_id = "camera_link" if is_sphere else "camera_optical"
    imaging = replace(imaging, vignetting=0.0) if is_sphere else imaging
    return Mount(
        "camera", frame_id, camera, T_base_camera, True, params.read_noise, params.shot_noise, "camera", imaging
    )


def roof_sphere(params: SphereParams) -> Mount:
    """Return the ideal RGB-D sphere."""
    if params.width % 2:
        raise ValueError(f"sphere.width: expected an even number, found {params.width}")
    T_base_camera = SE3.from_parts(np.eye(3), [params.x, params.y, params.z])
    camera = Spherical(params.width, params.width // 2)
    return Mount("sphere", "sphere_link", camera, T_base_camera, False, params.read_noise, params.shot_noise, "sphere")


def vignette(camera: Camera, share: float, gamma: float) -> NDArray[np.float32]:
    """Return factors (H, W) on grey levels: the light falls with the squared distance to the middle, to 1 - share."""
    rows, columns = np.linspace(-1.0, 1.0, camera.height), np.linspace(-1.0, 1.0, camera.width)
    height, width = float(camera.height), float(camera.width)
    squares = ((rows * height) ** 2)[:, None] + ((columns * width) ** 2)[None]
    light = 1.0 - share * squares / (height**2 + width**2)
    return np.asarray(light ** (1.0 / gamma), dtype=np.float32)


def expose(
    levels: NDArray[np.float32], noise: float, shot_noise: float, seed: tuple[int, ...], bias: float = 0.0
) -> NDArray[np.uint8]:
    """Return what the sensor reads of perfect grey levels (H, W[, 3]): noise of its electronics and of the light.

    `seed` names the image, so that every image has its own noise and has it again in the next run.
    Levels are 1 to 255; 0 is kept for pixels outside the lens.
    """
    if noise > 0.0 or shot_noise > 0.0:
        rng = np.random.default_rng(seed)
        deviation = np.sqrt(np.float32(noise * noise) + np.float32(shot_noise) * levels)
        read = levels + deviation * rng.standard_normal(levels.shape, dtype=np.float32)
    else:
        read = levels
    if bias:
        read = read + np.float32(bias)
    image = np.clip(np.rint(read), 1.0, 255.0).astype(np.uint8)
    image[levels == 0.0] = 0
    return image
