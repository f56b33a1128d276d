"""Parameters of Monte Carlo localisation, one class for each file that needs them; those of images: image_params.py."""

from __future__ import annotations

import localization.params
from localization.params import NodeParams
from mcl_depth.image_params import ComparisonParams, SynthesisParams
from typed_params import group, param, parameters


@parameters
class MotionParams:
    """How odometry errs (`motion_model.py`)."""

    way_share: float = param(0.05, "standard deviation along the way, as share of it", low=0.0, high=1.0)
    side_share: float = param(0.03, "standard deviation across the way, as share of it", low=0.0, high=1.0)
    turn_share: float = param(0.05, "standard deviation of a turn, as share of it", low=0.0, high=1.0)
    drift_deg: float = param(1.0, "heading lost on a way of one metre; grows with its square root", "deg", low=0.0)
    min_sigma: float = param(0.03, "standard deviation of the position for each image, each axis", "m", low=0.0)
    min_sigma_deg: float = param(0.5, "standard deviation of the heading for each image", "deg", low=0.0)
    max_speed: float = param(10.0, "faster odometry is a leap and not believed", "m/s", low=0.1)
    max_leap: float = param(0.5, "way that is believed at any speed", "m", low=0.0)
    blind_speed: float = param(0.5, "standard deviation of the speed while odometry is missing", "m/s", low=0.0)
    blind_turn_rate: float = param(0.35, "the same of the turn rate", "rad/s", low=0.0)
    max_blind_step: float = param(1.0, "bound of the standard deviation of one blind step", "m", low=0.0)


@parameters
class CacheParams:
    """Which depth images are kept (`depth_cache.py`, N17 section III-C)."""

    max_distance: float = param(0.25, "largest distance of a position from the depth image used for it", "m", low=0.01)
    max_megabytes: int = param(1000, "memory for depth features; the least recently used go first", "MB", low=1)
    batch: int = param(64, "depth images made at once", low=1)
    folder: str = param("", "folder to keep depth features in between runs; empty: none")
    is_prefilled: bool = param(False, "make the depth images of the whole area when the cloud is loaded")
    uses_similarities: bool = param(True, "compare a depth image once for all particles that share it")


@parameters
class AreaParams:
    """Where the vehicle may be (`area.py`)."""

    step: float = param(0.5, "grid of possible positions", "m", low=0.05)
    clearance: float = param(0.3, "free space around the camera that a position needs", "m", low=0.0)
    limits: str = param("", "x0,y0,x1,y1 in m of the part of the map that is considered; empty: all of it")


@parameters
class AdjustmentParams:
    """How far particles turn to the best heading (`orientation.py`; algorithm 2, line 19)."""

    num_images: int = param(2, "images after which a particle counts as old", low=0)
    initial: float = param(1.0, "strength for young particles; 1: the best heading is assigned", low=0.0, high=1.0)
    later: float = param(0.0, "strength for old particles; below 1: fused with their own heading", low=0.0, high=1.0)
    spread_deg: float = param(3.0, "standard deviation left in an assigned heading", "deg", low=0.0)


@parameters
class WeightParams:
    """From similarity to weight (`weighting.py`)."""

    exponent: float = param(20.0, "lambda of w = s ** lambda", low=0.0)
    scaling: str = param(
        "maximum",
        "s is divided by its maximum, the same after what chance gives is taken off, or s is spread over 0 to 1",
        choices=("maximum", "chance", "minmax"),
    )
    min_effective_share: float = param(
        0.0, "share of the particles that must survive one image; lambda is lowered for it", low=0.0, high=1.0
    )


@parameters
class ResamplingParams:
    """Which particles live on, and how many (`resampling.py`)."""

    num_particles: int = param(1000, "particles at the start, and at most", low=1)
    min_particles: int = param(300, "particles at least", low=1)
    effective_share: float = param(0.5, "resample when fewer than this share carry the belief", low=0.0, high=1.0)
    is_adaptive: bool = param(True, "fewer particles when the belief is narrow (KLD sampling)")
    kld_error: float = param(0.03, "largest error of the belief", low=0.001)
    kld_z: float = param(2.33, "quantile of the normal distribution for the probability of that error", low=0.0)
    roughening: float = param(
        0.15, "spread of the copies of young particles, by the distance of particles at the start", low=0.0
    )
    bin_size: float = param(0.25, "bin of position", "m", low=0.01)
    bin_heading_deg: float = param(10.0, "bin of heading", "deg", low=0.5)


@parameters
class RecoveryParams:
    """New particles when the images stop to fit (`recovery.py`)."""

    is_active: bool = param(True, "spread new particles when the belief loses its lead over the rest of the map")
    num_scouts: int = param(200, "fixed positions all over the area that the belief is compared with", low=2)
    scouts_per_image: int = param(20, "of them for each image, in turn", low=2)
    slow_rate: float = param(0.05, "rate of the long-term average of the lead", low=0.0, high=1.0)
    fast_rate: float = param(0.3, "rate of the short-term average of the lead", low=0.0, high=1.0)
    fall: float = param(
        0.6, "new particles come while the short-term lead is below this share of the long-term one", low=0.05, high=1.0
    )
    max_share: float = param(0.3, "largest share of new particles for one image", low=0.0, high=1.0)
    lost_share: float = param(0.1, "share of new particles while the pose is not known", low=0.0, high=1.0)
    tries: int = param(5, "positions looked at for each new particle; those that fit the image best live on", low=1)


@parameters
class HypothesisParams:
    """What counts as one place (`hypotheses.py`)."""

    bin_size: float = param(0.75, "particles this far apart may be of one place", "m", low=0.05)
    bin_heading_deg: float = param(30.0, "and turned by this", "deg", low=1.0, high=180.0)
    max_hypotheses: int = param(5, "places that are reported", low=1)


@parameters
class StateParams(localization.params.StateParams):
    """When the pose is trusted (`status.py`)."""

    min_weight: float = param(0.8, "share of the belief in one place before it is trusted", low=0.0, high=1.0)
    ambiguous_share: float = param(0.4, "a second place counts from this share of the first", low=0.0, high=1.0)
    max_sigma_m: float = param(0.6, "standard deviation of a trusted position", "m", low=0.0)
    good_sigma_m: float = param(0.4, "the same of a good position", "m", low=0.0)
    max_sigma_deg: float = param(15.0, "standard deviation of a trusted heading", "deg", low=0.0)
    min_lead: float = param(1.0, "lead over the rest of the map of a trusted place", "standard deviations", low=0.0)
    probation_images: int = param(3, "good images in a row before a place is trusted; doubled by each loss", low=1)
    lost_images: int = param(6, "bad images in a row until the pose is LOST", low=1)
    max_blind_s: float = param(2.0, "time without a usable image until the pose is LOST", "s", low=0.0)
    patience: int = param(20, "images of search after which all particles are spread anew", low=1)


@parameters
class CovarianceParams:
    """What the spread of the particles does not tell (`estimate.py`), standard deviations."""

    position: float = param(0.10, "error of map and synthesis, x and y", "m", low=0.0)
    heading_deg: float = param(1.0, "error of the heading", "deg", low=0.0)
    height: float = param(0.10, "error of the height above the ground", "m", low=0.0)
    tilt_deg: float = param(1.0, "error of roll and pitch", "deg", low=0.0)


@parameters
class InputParams(localization.params.InputParams):
    """Which images are used (`localization/input_check.py`), and which of them are compared."""

    timeout_s: float = param(2.0, "silence after which the pose is not current any more", "s", low=0.01)
    min_way: float = param(0.1, "images closer than this to the last one used only carry the pose on", "m", low=0.0)
    min_turn_deg: float = param(3.0, "unless turned by this", "deg", low=0.0)


@parameters
class HomingParams:
    """Motion direction towards the next waypoint (`homing.py`, N17 section III-D)."""

    num_directions: int = param(16, "directions psi around the waypoint", low=4)
    distance_step: float = param(1.0, "between the distances d around the waypoint", "m", low=0.05)
    num_distances: int = param(2, "distances beside zero", low=1)
    num_median: int = param(5, "images in the median of the direction", low=1)
    reach: float = param(0.6, "a waypoint closer than this is passed", "m", low=0.05)
    num_passed: int = param(2, "images in a row that must say so", low=1)
    spacing: float = param(1.5, "distance of the waypoints along the path", "m", low=0.1)
    min_lead: float = param(
        1.5, "lead of the best sample over the others of a clear direction", "standard deviations", low=0.0
    )


@parameters
class FilterParams:
    """The filter and all its steps (`filter.py`)."""

    heading_step_deg: float = param(
        10.0, "between the headings alpha that are compared; divides 360", "deg", low=0.5, high=90.0
    )
    camera_height: float = param(
        0.0, "of the camera above the ground; 0: that of the camera above base_frame", "m", low=0.0
    )
    seed: int = param(1, "of all random numbers", low=0)
    automatic: bool = param(True, "search the whole map without being asked")
    synthesis: SynthesisParams = group(SynthesisParams)
    comparison: ComparisonParams = group(ComparisonParams)
    motion: MotionParams = group(MotionParams)
    area: AreaParams = group(AreaParams)
    cache: CacheParams = group(CacheParams)
    adjustment: AdjustmentParams = group(AdjustmentParams)
    weight: WeightParams = group(WeightParams)
    resampling: ResamplingParams = group(ResamplingParams)
    recovery: RecoveryParams = group(RecoveryParams)
    hypothesis: HypothesisParams = group(HypothesisParams)
    state: StateParams = group(StateParams)
    covariance: CovarianceParams = group(CovarianceParams)
    input: InputParams = group(InputParams)


@parameters
class MclDepthParams(FilterParams, NodeParams):
    """Everything that the node needs (`node.py`)."""

    cloud: str = param("", "map: .ply, .pcd, .las, .npy, a floor plan .csv, or a folder of key spheres; empty: wait")
    roll_deg: float = param(0.0, "of the vehicle, where there is no imu", "deg", low=-45.0, high=45.0)
    pitch_deg: float = param(0.0, "of the vehicle, where there is no imu", "deg", low=-45.0, high=45.0)
    homing: HomingParams = group(HomingParams)
