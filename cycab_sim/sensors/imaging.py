"""From what a camera sees to its image: exposure that comes late, drifting colours, blur, vignetting, noise, faults."""

from __future__ import annotations

import math
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from cycab_sim.params import ImagingParams, LightParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.cameras import Mount
from cycab_sim.sensors.faults import SECOND, Faults
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array, Bytes, Floats

STRIDE = 4  # every 4th row and column are measured
DRIFT_WAVES = np.array([1.0, 1.7, 2.9])  # the white balance drifts with these multiples of its rate
GAMMA = LightParams.gamma
CAMERAS_AT_ONCE = 2  # of a rig


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """An image (H, W[, 3]) u1 and range along the ray (H, W) f32 m of one instant."""

    image: Bytes
    range_m: Floats
    camera: Camera
    stamp_ns: int
    range_std_m: None = None  # the range is exact


class CameraArray:
    """All cameras on the car by name, `mounts`, each with the exposure of its group.

    `set_scene(offset)` puts the world as it is that many s from now, and returns where the car is then.
    """

    def __init__(
        self,
        mounts: Iterable[Mount],
        faults: Faults,
        renderer: Renderer,
        set_scene: Callable[[float], SE3],
        seeds: tuple[int, int],
    ) -> None:
        """`seeds`: of the world and of the noise."""
        self.mounts = {mount.name: mount for mount in mounts}
        self._faults, self._renderer, self._set_scene = faults, renderer, set_scene
        seed, self._noise_seed = seeds
        self._last: dict[str, RenderedFrame] = {}
        self._exposures = {
            mount.group: Exposure(mount.imaging, (seed, 83, zlib.crc32(mount.group.encode())))
            for mount in self.mounts.values()
        }

    def capture(self, name: str, index: int, now_ns: int, drawn: tuple[Floats, Floats] | None = None) -> RenderedFrame:
        """Return image number `index` of a camera, noise and faults included; `drawn`: what `look` has returned."""
        mount, imaging = self.mounts[name], self.mounts[name].imaging
        if self._faults.magnitude(name, "stuck", now_ns) is not None and name in self._last:
            return replace(self._last[name], stamp_ns=now_ns)
        levels, range_m = drawn or self.look(name, now_ns)
        if imaging.vignetting > 0.0:
            fall = vignette(mount.camera, imaging.vignetting)
            levels = levels * (fall if mount.is_gray else fall[..., None])
        self._exposures[mount.group].observe(now_ns, levels)
        seed = (self._noise_seed, index, zlib.crc32(name.encode()))
        deviation, variance = mount.noises
        noise = float(np.hypot(imaging.noise * deviation, self._faults.magnitude(name, "noise", now_ns) or 0.0))
        shot_noise = imaging.noise**2 * variance
        image = expose(levels, noise, shot_noise, seed, self._faults.magnitude(name, "bias", now_ns) or 0.0)
        self._last[name] = RenderedFrame(image, range_m, mount.camera, now_ns)
        return self._last[name]

    def capture_together(self, names: Sequence[str], index: int, now_ns: int) -> dict[str, RenderedFrame]:
        """Return what some cameras see at one instant, by name."""
        if any(self.mounts[name].imaging.shutter > 0.0 for name in names):  # a shutter that is open moves the scene
            return {name: self.capture(name, index, now_ns) for name in names}
        self._set_scene(0.0)
        for name in names:
            self._exposures[self.mounts[name].group].gains(now_ns)  # moves on with time, once: not in the threads
        with ThreadPoolExecutor(CAMERAS_AT_ONCE) as pool:  # what one leaves of the cores, another one takes
            drawn = pool.map(lambda name: self.look(name, now_ns), names)
            return {name: self.capture(name, index, now_ns, levels) for name, levels in zip(names, drawn, strict=True)}

    def look(self, name: str, now_ns: int) -> tuple[Floats, Floats]:
        """Return grey levels and ranges that a camera sees now, by its exposure; blurred while its shutter is open."""
        mount = self.mounts[name]
        gain = self._exposures[mount.group].gains(now_ns)
        exposure = self._faults.magnitude(name, "exposure", now_ns)
        if exposure is not None:
            gain = gain * exposure**GAMMA  # a factor on grey levels

        def draw(offset: float) -> tuple[Floats, Floats]:
            T_world_camera = self._set_scene(offset) @ mount.T_base_camera
            return self._renderer.render(mount.camera, T_world_camera, mount.is_gray, gain)

        levels, range_m = draw(0.0)
        if mount.imaging.shutter > 0.0:
            levels = averaged(draw, mount.imaging.shutter, mount.imaging.shutter_samples)
        return levels, range_m


class Exposure:
    """The common exposure of a group of cameras; deterministic: it depends on the images seen so far and the stamps."""

    def __init__(self, params: ImagingParams, seed: tuple[int, ...]) -> None:
        self.params = params
        self._gain, self._wanted = 1.0, 1.0
        self._now_ns: int | None = None
        self._seen: deque[tuple[int, float]] = deque()
        self._phases = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, (2, len(DRIFT_WAVES)))

    def gains(self, stamp_ns: int) -> Array:
        """Return the factors on red, green and blue light (3,) for an image of this instant."""
        if self.params.has_automatic_exposure and stamp_ns != self._now_ns:
            self._follow(stamp_ns)
        return self._gain * self._balance(stamp_ns / SECOND)

    def observe(self, stamp_ns: int, levels: Floats) -> None:
        """Measure an image (H, W[, 3]) that was taken with the present gain; 0: outside the lens."""
        if not self.params.has_automatic_exposure:
            return
        some = levels[::STRIDE, ::STRIDE]
        mean = float(some[some > 0.0].mean()) if (some > 0.0).any() else self.params.target
        self._seen.append((stamp_ns, math.log(self._gain) + GAMMA * math.log(self.params.target / mean)))

    def _follow(self, stamp_ns: int) -> None:
        """Move towards what the images called for that are known by now."""
        p = self.params
        known: dict[int, list[float]] = {}
        while self._seen and self._seen[0][0] + round(p.exposure_delay * SECOND) <= stamp_ns:
            stamp, wanted = self._seen.popleft()
            known.setdefault(stamp, []).append(wanted)
        if known:
            limit = math.log(p.range)
            self._wanted = math.exp(min(max(float(np.mean(known[max(known)])), -limit), limit))
        seconds = 0.0 if self._now_ns is None else (stamp_ns - self._now_ns) / SECOND
        share = -math.expm1(-seconds / p.exposure_lag) if p.exposure_lag > 0.0 else 1.0
        self._gain *= (self._wanted / self._gain) ** share
        self._now_ns = stamp_ns

    def _balance(self, seconds: float) -> Array:
        """Return factors (3,) on the colours; green stays."""
        p = self.params
        if p.white_balance == 0.0:
            return np.ones(3)
        angles = 2 * np.pi * DRIFT_WAVES * seconds / p.white_balance_period + self._phases
        red, blue = np.exp(p.white_balance * np.sqrt(2.0 / len(DRIFT_WAVES)) * np.sin(angles).sum(axis=1))
        return np.array([red, 1.0, blue])


def averaged(draw: Callable[[float], tuple[Floats, Floats]], shutter: float, num: int) -> Floats:
    """Return the levels of an open shutter: the mean light of `num` instants, seconds before and after the middle.

    draw(offset s) returns levels 0..255 and ranges of an instant.
    """
    offsets = (np.arange(num) + 0.5) / num - 0.5
    total = sum((draw(float(shutter * offset))[0] / np.float32(255.0)) ** np.float32(GAMMA) for offset in offsets)
    return np.asarray(np.float32(255.0) * (total / np.float32(num)) ** np.float32(1.0 / GAMMA), dtype=np.float32)


def vignette(camera: Camera, share: float) -> Floats:
    """Return factors (H, W) on grey levels: the light falls with the squared distance to the middle, to 1 - share."""
    rows, columns = np.linspace(-1.0, 1.0, camera.height), np.linspace(-1.0, 1.0, camera.width)
    height, width = float(camera.height), float(camera.width)
    squares = ((rows * height) ** 2)[:, None] + ((columns * width) ** 2)[None]
    light = 1.0 - share * squares / (height**2 + width**2)
    return np.asarray(light ** (1.0 / GAMMA), dtype=np.float32)


def expose(levels: Floats, noise: float, shot_noise: float, seed: tuple[int, ...], bias: float = 0.0) -> Bytes:
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
