"""Parameters of stitching and of its range. The rig is data (`rig.yaml`), not parameters."""

from __future__ import annotations

from sphere_nav.params import group, param, parameters


@parameters
class BlendParams:
    """How the views are joined (`views.py`, `light.py`, `blending.py`)."""

    distance_m: float = param(10.0, "range taken where none is known; 0: very far", "m", low=0.0)


@parameters
class MatchParams:
    """Semi-global matching of two images whose epipolar lines are columns (`matching.py`)."""

    nearest_m: float = param(0.5, "nearest range looked for", "m", low=0.01)
    noise: float = param(2.5, "standard deviation of the images' noise", "grey level", low=0.1)
    calibration_px: float = param(0.08, "standard deviation of disparity that calibration leaves", "px", low=0.0)
    max_relative_std: float = param(0.08, "relative range error above which a pixel is not measured", low=0.001)


@parameters
class FusionParams:
    """Ranges of several sources in one sphere (`fusion.py`)."""

    depth_std_m: float = param(
        0.003, "standard deviation of an RGB-D camera at 1 m; grows by the square", "m", low=1e-5
    )
    max_depth_m: float = param(8.0, "depth beyond which an RGB-D camera is not trusted", "m", low=0.1)


@parameters
class StitchParams:
    """From the images of a rig to an augmented sphere (`stitcher.py`)."""

    width: int = param(1024, "columns of the sphere, a multiple of 64; rows are half of it", "px", low=64, high=16384)
    range: str = param(
        "stereo", "stereo: between cameras that have a baseline; none: image only", choices=("stereo", "none")
    )
    blend: BlendParams = group(BlendParams)
    match: MatchParams = group(MatchParams)
    fusion: FusionParams = group(FusionParams)


@parameters
class SynchronizerParams:
    """Which images are one instant (`sphere_nav/ros/camera/synchronizer.py`)."""

    slack_s: float = param(0.005, "largest difference of the stamps of one instant", "s", low=0.0, high=1.0)
    deadline_s: float = param(0.2, "time after an instant's first image at which it is closed", "s", low=0.001)


@parameters
class RectifyParams:
    """The rig corrected by its own images (`rectification.py`)."""

    num_instants: int = param(
        0, "instants whose images correct the rig before the first sphere; 0: it is as told", low=0
    )


@parameters
class LidarParams:
    """The cloud of a LiDAR (topic points)."""

    mounting: str = param("", "LiDAR on rig_frame, x,y,z,roll,pitch,yaw (m, rad) or a YAML, where /tf does not tell")


@parameters
class SphereStitcherParams:
    """The node `sphere_stitcher` (`ros/node.py`)."""

    rig: str = param(
        "",
        "rig file; empty: the topic rig_description",
    )
    transport: str = param("raw", "image_raw, or image_raw/compressed", choices=("raw", "compressed"))
    has_depth: bool = param(False, "RGB-D cameras: cameras/<name>/depth/image_raw, registered to the image")
    has_cloud: bool = param(False, "a LiDAR's cloud on the topic points, placed by /tf")
    rig_frame: str = param("rig_link", "frame of the rig")
    sphere_frame: str = param("rig_sphere_link", "frame of the sphere, told on /tf_static below that of the rig")
    jobs: int = param(2, "threads", low=1, high=64)
    sync: SynchronizerParams = group(SynchronizerParams)
    cloud: LidarParams = group(LidarParams)
    rectify: RectifyParams = group(RectifyParams)
    stitch: StitchParams = group(StitchParams)
