"""Parameters of the dense localiser: what depends on camera, vehicle or place. The rest: `constants.py`."""

from __future__ import annotations

from functools import cached_property

from dense_localizer.constants import MAX_MAD, MIN_STEP_PX
from sphere_nav.geometry.cameras.rolling_shutter import CameraParams
from sphere_nav.localization.params import InputParams, NodeParams, RigParams, StateParams
from sphere_nav.params import group, param, parameters
from sphere_nav.photometric import RegistrationParams
from sphere_nav.photometric.params import PyramidParams


@parameters
class PriorParams:
    """How the camera may move between images (`motion_prior.py`)."""

    acceleration: float = param(5.0, "standard deviation, each axis", "m/s^2", low=0.01)
    angular_acceleration: float = param(10.0, "standard deviation, each axis", "rad/s^2", low=0.01)
    max_blind_m: float = param(
        10.0, "way by the last images alone, where the map does not fit, until LOST", "m", low=0.0
    )
    odometry_error: float = param(0.05, "error of odometry as share of the motion", low=0.0, high=1.0)


@parameters
class ReferenceParams:
    """Which key spheres an image is aligned to (`reference.py`)."""

    num_references: int = param(2, "key spheres used at once (M15 eq. 19)", low=1, high=4)
    memory: float = param(100.0, "memory of prepared key spheres; three stay whatever they take", "MB", low=1.0)


@parameters
class AlignmentParams:
    """How an image is aligned (`photometric`)."""

    num_levels: int = param(5, "levels of the pyramid, the full image included", low=1, high=10)
    finest: int = param(0, "finest level that is used; 0 is the full image", low=0, high=9)
    max_pixels: int = param(60_000, "best pixels used at a level, all references together", low=100)
    contrast: bool = param(True, "where grey levels do not place an image, align local contrast: light changes it less")


@parameters
class AcceptanceParams:
    """When an alignment is used (`candidate.py`). A value past the `good` limit is used with care: DEGRADED."""

    min_pixels: int = param(500, "pixels in the alignment", low=6)
    min_ncc: float = param(0.4, "normalised cross-correlation of image and references", low=-1.0, high=1.0)
    max_sigma_m: float = param(0.2, "standard deviation of the position; half of it is good", "m", low=0.0)


@parameters
class CovarianceParams:
    """What is assumed of the map's errors until its key spheres have been compared (`map_error.py`)."""

    map_sigma_m: float = param(0.002, "error of the map's geometry, each axis", "m", low=0.0)
    map_sigma_rad: float = param(0.0015, "error of the map's attitude, each axis", "rad", low=0.0)


@parameters
class SearchParams:
    """How the first pose is found (`startup.py`, M15 section 5.4)."""

    heading_step_deg: float = param(20.0, "between headings tried in a whole sphere", "deg", low=1.0, high=180.0)
    min_ncc: float = param(0.5, "correlation of a verified start", low=-1.0, high=1.0)
    min_ncc_margin: float = param(0.1, "lead of the best place over another one", low=0.0, high=1.0)


@parameters
class LocalizerParams:
    """The localiser and all its steps (`localizer.py`)."""

    automatic: bool = param(True, "search the whole map without being asked")
    input: InputParams = group(InputParams)
    camera: CameraParams = group(CameraParams)
    prior: PriorParams = group(PriorParams)
    reference: ReferenceParams = group(ReferenceParams)
    alignment: AlignmentParams = group(AlignmentParams)
    acceptance: AcceptanceParams = group(AcceptanceParams)
    covariance: CovarianceParams = group(CovarianceParams)
    state: StateParams = group(StateParams)
    start: SearchParams = group(SearchParams)

    @cached_property
    def registration(self) -> RegistrationParams:
        """Registration as the group `alignment` asks for it, at the rate of the camera."""
        a = self.alignment
        return RegistrationParams(
            pyramid=PyramidParams(num_levels=a.num_levels, finest=a.finest),
            max_pixels=a.max_pixels,
            min_step=MIN_STEP_PX,
            max_mad=MAX_MAD,
        )


@parameters
class DenseLocalizerParams(LocalizerParams, NodeParams):
    """Everything that the node needs (`node.py`)."""

    map: str = param("", "map to localise in; empty: wait for the call load_map")
    use_depth: bool = param(False, "place by depth/image_raw, too, where the images alone do not: by night, new light")
    learn: bool = param(False, "keep key images of each drive beside the map, for sphere_nav map-learn")
    rig: RigParams = group(RigParams)
