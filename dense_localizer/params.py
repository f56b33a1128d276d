"""Parameters of the dense localiser, one class for each file that needs them."""

from __future__ import annotations

import localization.params
from localization.params import InputParams, NodeParams
from photometric import RegistrationParams
from typed_params import group, param, parameters


@parameters
class PriorParams:
    """How the camera may move between images (`motion_prior.py`)."""

    acceleration: float = param(5.0, "standard deviation, each axis", "m/s^2", low=0.01)
    angular_acceleration: float = param(10.0, "standard deviation, each axis", "rad/s^2", low=0.01)
    start_speed: float = param(5.0, "standard deviation of the unknown speed after a start", "m/s", low=0.0)
    start_turn_rate: float = param(1.0, "standard deviation of the unknown turn rate after a start", "rad/s", low=0.0)
    odometry_error: float = param(0.05, "error of odometry as share of the motion", low=0.0, high=1.0)
    use_rotation: bool = param(True, "measure the rotation between images before the alignment (M15 eq. 20)")
    moving_speed: float = param(0.05, "speed from which the camera counts as moving", "m/s", low=0.0)


@parameters
class ReferenceParams:
    """Which key spheres an image is aligned to (`reference.py`)."""

    num_references: int = param(2, "key spheres used at once (M15 eq. 19)", low=1, high=4)
    num_candidates: int = param(12, "nearest key spheres looked at", low=1)
    min_visible_share: float = param(0.25, "share of the image that a reference must cover", low=0.0, high=1.0)
    relative_share: float = param(0.6, "the same, by the share that the best candidate covers", low=0.0, high=1.0)
    reach: float = param(1.0, "distance of a second reference by its median range, farther ones are left", low=0.0)
    level_sigmas: float = param(1.0, "uncertainty of the prediction that the first level must cover", low=0.0)
    kept_share: float = param(0.25, "share of a key sphere's pixels kept, the most salient", low=0.01, high=0.5)
    cache_size: int = param(24, "prepared key spheres kept in memory", low=2)


@parameters
class AcceptanceParams:
    """When an alignment is used (`acceptance.py`). A value past the `good` limit is used with care: DEGRADED."""

    min_overlap: float = param(0.15, "share of the chosen pixels that the image sees", low=0.0, high=1.0)
    good_overlap: float = param(0.25, "overlap of a good alignment", low=0.0, high=1.0)
    min_pixels: int = param(500, "pixels in the alignment", low=6)
    min_inlier_share: float = param(0.4, "share of pixels that agree", low=0.0, high=1.0)
    good_inlier_share: float = param(0.5, "inlier share of a good alignment", low=0.0, high=1.0)
    min_ncc: float = param(0.4, "normalised cross-correlation of image and references", low=-1.0, high=1.0)
    good_ncc: float = param(0.5, "correlation of a good alignment", low=-1.0, high=1.0)
    max_gain: float = param(3.0, "factor of brightness to the map, either way", low=1.0)
    max_bias: float = param(80.0, "offset of brightness to the map", "grey level", low=0.0)
    max_sigma_m: float = param(0.1, "standard deviation of the position", "m", low=0.0)
    good_sigma_m: float = param(0.05, "standard deviation of the position of a good alignment", "m", low=0.0)
    max_sigma_rad: float = param(0.05, "standard deviation of the attitude", "rad", low=0.0)
    max_distance: float = param(1.0, "distance to the nearest reference by its median range", low=0.01)
    max_innovation: float = param(8.0, "distance to the prediction", "standard deviations", low=0.1)


@parameters
class CovarianceParams:
    """From the alignment's covariance to an honest one (`acceptance.py`)."""

    map_sigma_m: float = param(0.002, "error of the map's geometry, each axis", "m", low=0.0)
    map_sigma_rad: float = param(0.0015, "error of the map's attitude, each axis", "rad", low=0.0)
    map_share: float = param(0.01, "error of range and calibration, as share of the distance to the reference", low=0.0)


@parameters
class StateParams(localization.params.StateParams):
    """When a pose is trusted (`localizer.py`)."""

    max_blind_sigma_m: float = param(0.5, "standard deviation of the predicted position until LOST", "m", low=0.0)


@parameters
class StartParams:
    """How the first pose is found (`startup.py`, M15 section 5.4)."""

    period_s: float = param(0.5, "pause between two searches", "s", low=0.0)
    heading_step_deg: float = param(20.0, "between headings tried in a whole sphere", "deg", low=1.0, high=180.0)
    side_step_deg: float = param(15.0, "to either side of the heading of a partial sphere", "deg", low=0.0, high=90.0)
    tilt_step_deg: float = param(12.0, "above and below the heading of a partial sphere", "deg", low=0.0, high=45.0)
    forward_step: float = param(0.2, "before and behind the centre, as share of the range", low=0.0, high=1.0)
    num_aligned: int = param(30, "best guesses that are aligned coarsely", low=1)
    num_verified: int = param(4, "best coarse results that are verified at full resolution", low=1)
    min_ncc: float = param(0.5, "correlation of a verified start", low=-1.0, high=1.0)
    min_ncc_margin: float = param(0.1, "lead of the best place over another one", low=0.0, high=1.0)
    same_place_m: float = param(0.3, "results closer than this are one place", "m", low=0.0)
    same_place_deg: float = param(10.0, "and turned by less than this", "deg", low=0.0)
    near_s: float = param(2.0, "time for which a given or lost pose is tried", "s", low=0.0)
    num_near: int = param(6, "key spheres around a given or lost pose that are tried", low=1)
    max_guess_distance_m: float = param(10.0, "from an initial pose to the nearest key sphere", "m", low=0.0)


@parameters
class TrackingParams(RegistrationParams):
    """Registration at the rate of the camera."""

    min_step: float = param(0.04, "image motion of an increment below which a level is done", "px", low=1e-6)
    max_mad: float = param(40.0, "median absolute deviation above which a result is refused", "grey level", low=0.0)


@parameters
class LocalizerParams:
    """The localiser and all its steps (`localizer.py`)."""

    automatic: bool = param(True, "search the whole map without being asked")
    input: InputParams = group(InputParams)
    prior: PriorParams = group(PriorParams)
    reference: ReferenceParams = group(ReferenceParams)
    registration: TrackingParams = group(TrackingParams)
    acceptance: AcceptanceParams = group(AcceptanceParams)
    covariance: CovarianceParams = group(CovarianceParams)
    state: StateParams = group(StateParams)
    start: StartParams = group(StartParams)


@parameters
class DenseLocalizerParams(LocalizerParams, NodeParams):
    """Everything that the node needs (`node.py`)."""

    map: str = param("", "map to localise in; empty: wait for the call load_map")
