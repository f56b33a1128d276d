"""Parameters of stitching and of its range. The rig is data (`rig.yaml`), not parameters."""

from __future__ import annotations

from typed_params import group, param, parameters


@parameters
class BlendParams:
    """How the views are joined (`views.py`, `exposure.py`, `blending.py`)."""

    num_bands: int = param(4, "bands of the Laplacian pyramid; the coarsest blends over 2^(n + 1) px", low=1, high=7)
    distance_m: float = param(10.0, "range taken where none is known; 0: very far", "m", low=0.0)
    has_gains: bool = param(True, "compensate exposure by the overlaps")
    max_gain: float = param(3.0, "largest gain of a camera over another", low=1.0)
    num_passes: int = param(
        1, "matches of a vertical rig; 2 where its levels' cameras look different ways", low=1, high=3
    )
    min_known: float = param(0.3, "share with range below which the image is not moved by it", low=0.0, high=1.0)
    is_reprojected: bool = param(True, "move every pixel to the sphere's centre by its range")


@parameters
class MatchParams:
    """Semi-global matching along the columns of two spheres, or of two views (`matching.py`)."""

    match_width: int = param(
        1024, "columns up to which a sphere is matched as it is; wider ones are halved", "px", low=64
    )
    max_disparity_deg: float = param(16.0, "largest disparity searched, an angle", "deg", low=1.0, high=60.0)
    min_disparity_deg: float = param(-0.7, "smallest disparity searched, below 0 for what calibration leaves", "deg")
    block_size: int = param(5, "side of the matched block, odd", "px", low=1, high=21)
    smoothness: float = param(8.0, "penalty of a disparity step of 1, by block area", low=0.0)
    jump_penalty: float = param(32.0, "penalty of a larger disparity step, by block area", low=0.0)
    uniqueness: int = param(5, "margin of the best cost over the second", "%", low=0, high=100)
    max_left_right_px: int = param(1, "disagreement allowed between both directions; -1: no check", "px", low=-1)
    speckle_size: int = param(60, "smaller islands of disparity are removed; 0: none", "px", low=0)
    speckle_range: int = param(2, "disparity step that separates islands", "px", low=1)
    edge_px: int = param(3, "matches this near to a jump are not trusted; 0: all are", "px", low=0, high=20)
    jump_px: float = param(
        0.6, "least step of disparity, over the width of that neighbourhood, that is a jump", "px", low=0.1
    )
    jump_share: float = param(0.1, "least step of a jump by the disparity", low=0.01)
    refine_radius: int = param(3, "half side of the block of the sub-pixel refinement", "px", low=1, high=20)
    refine_steps: int = param(2, "steps of the sub-pixel refinement", low=1, high=20)
    noise: float = param(2.5, "standard deviation of the images' noise", "grey level", low=0.1)
    calibration_px: float = param(0.08, "standard deviation of disparity that calibration leaves", "px", low=0.0)
    match_px: float = param(0.3, "standard deviation of a match before the refinement", "px", low=0.01)
    max_residual: float = param(1.0, "grey-level variance left in a block, by that of noise and contrast", low=0.1)
    max_relative_std: float = param(0.08, "relative range error above which a pixel is not measured", low=0.001)
    min_range_m: float = param(0.3, "nearest range trusted", "m", low=0.01)
    far_m: float = param(120.0, "what is surely farther is known to be far (+Inf)", "m", low=1.0)


@parameters
class PairParams:
    """Pairs of cameras that stand side by side (`pairs.py`)."""

    max_between_deg: float = param(75.0, "largest angle between the axes of a pair", "deg", low=0.0, high=180.0)
    half_width_deg: float = param(75.0, "half of the view of a pair across its baseline", "deg", low=5.0, high=180.0)
    half_height_deg: float = param(50.0, "half of the view of a pair along its baseline", "deg", low=5.0, high=85.0)
    edge_px: int = param(4, "as match.edge_px: what one pair leaves out another one may see", "px", low=0, high=20)
    min_baseline_m: float = param(0.02, "cameras closer to each other are no pair", "m", low=0.001)


@parameters
class FusionParams:
    """Ranges of several sources in one sphere (`fusion.py`)."""

    max_deviations: float = param(
        3.0, "sources that differ by more do not see the same", "standard deviations", low=0.1
    )
    contradiction: float = param(
        3.0, "a source up to so much less sure than the surest, that differs, makes a pixel unknown; 0: none", low=0.0
    )
    contradiction_share: float = param(0.05, "least share of the range by which it differs then", low=0.0)
    cloud_std_m: float = param(0.03, "standard deviation of a LiDAR's range", "m", low=0.001)
    cloud_size_px: int = param(1, "half side of the patch that a LiDAR point covers", "px", low=0, high=10)
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
    pairs: PairParams = group(PairParams)
    fusion: FusionParams = group(FusionParams)


@parameters
class SynchroniserParams:
    """Which images are one instant (`synchroniser.py`)."""

    slack_s: float = param(0.005, "largest difference of the stamps of one instant", "s", low=0.0, high=1.0)
    deadline_s: float = param(0.2, "time after an instant's first image at which it is closed", "s", low=0.001)
    policy: str = param(
        "omit",
        "a camera missing at the deadline: its last image again, no image, no sphere",
        choices=("hold", "omit", "fail"),
    )
    max_hold_s: float = param(0.5, "largest age of an image that is held", "s", low=0.0)
    frozen_after: int = param(3, "equal images in a row, while other cameras change, that are a frozen camera", low=1)


@parameters
class RectifyParams:
    """The rig corrected by its own images (`rectification.py`)."""

    num_instants: int = param(
        0, "instants whose images correct the rig before the first sphere; 0: it is as told", low=0
    )
    warn_deg: float = param(0.5, "turn of a camera against the rig file that is warned of", "deg", low=0.0)
    turn_deg: float = param(0.3, "standard deviation of a camera's turn about each axis", "deg", low=1e-4)
    focal_share: float = param(0.003, "standard deviation of the focal length, by itself", low=1e-6)
    centre_share: float = param(0.005, "standard deviation of the principal point, by the focal length", low=1e-6)
    width: int = param(2048, "columns of the sphere in which features are found", "px", low=256, high=8192)
    num_features: int = param(5000, "features of a camera", low=50)
    max_parallax_deg: float = param(12.0, "largest angle between the directions of a match", "deg", low=0.1, high=90.0)
    max_ratio: float = param(0.75, "distance of a match over that of the second best", low=0.1, high=1.0)
    from_border_deg: float = param(1.0, "features nearer to the border of an image are left out", "deg", low=0.0)
    cloud_reach_deg: float = param(0.4, "a LiDAR's point this near to a feature tells its range", "deg", low=0.0)
    min_matches: int = param(15, "matches below which a pair of cameras says nothing", low=1)


@parameters
class CloudParams:
    """The cloud of a LiDAR (topic points)."""

    max_age_s: float = param(0.06, "largest time between a cloud and an instant that it serves", "s", low=0.0)
    has_mount: bool = param(False, "the LiDAR is mounted as below where /tf does not tell")
    x: float = param(0.0, "place in the frame of the rig, forward", "m")
    y: float = param(0.0, "place in the frame of the rig, to the left", "m")
    z: float = param(0.0, "place in the frame of the rig, up", "m")
    roll_deg: float = param(0.0, "turn about the forward axis, first", "deg", low=-360.0, high=360.0)
    pitch_deg: float = param(0.0, "turn about the axis to the left, second", "deg", low=-360.0, high=360.0)
    yaw_deg: float = param(0.0, "turn about the upward axis, last", "deg", low=-360.0, high=360.0)


@parameters
class SphereStitcherParams:
    """The node `sphere_stitcher` (`stitcher_node.py`)."""

    rig: str = param(
        "",
        "rig file; empty: the topic rig_description",
    )
    transport: str = param("raw", "image_raw, or image_raw/compressed", choices=("raw", "compressed"))
    has_depth: bool = param(False, "RGB-D cameras: cameras/<name>/depth/image_raw, registered to the image")
    has_cloud: bool = param(False, "a LiDAR's cloud on the topic points, placed by /tf")
    rig_frame: str = param("rig_link", "frame of the rig")
    sphere_frame: str = param("rig_sphere_link", "frame of the sphere, told on /tf_static below that of the rig")
    preview_width: int = param(1024, "columns of the preview", "px", low=64)
    preview_quality: int = param(80, "JPEG quality of the preview", "%", low=1, high=100)
    jobs: int = param(2, "threads", low=1, high=64)
    sync: SynchroniserParams = group(SynchroniserParams)
    cloud: CloudParams = group(CloudParams)
    rectify: RectifyParams = group(RectifyParams)
    stitch: StitchParams = group(StitchParams)
