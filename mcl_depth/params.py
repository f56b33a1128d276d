"""Parameters of Monte Carlo localisation, one class for each file that needs them."""

from __future__ import annotations

from sphere_nav.localization import params as shared
from sphere_nav.localization.params import NodeParams
from sphere_nav.params import group, param, parameters

UNITS = ("m", "ft", "us-ft", "km", "mm")


@parameters
class SynthesisParams:
    """Depth panoramas from the map (N17 section III-A)."""

    num_columns: int = param(180, "columns of the panorama, all around", low=32, high=4096)
    voxel_m: float = param(0.1, "finest spacing of the points of a cloud; they grow coarser with range", "m", low=1e-3)
    max_range_m: float = param(200.0, "range beyond which points are not drawn", "m", low=1.0)


@parameters
class SurveyParams:
    """The frame of a cloud's file (`geometry/survey_frame.py`)."""

    origin: str = param("", "E,N,H in m of the file at the origin of the map; empty: near the cloud, where it is far")
    unit: str = param("auto", "of the file; auto: as it declares, else by its extent", choices=("auto", *UNITS))
    crs: str = param("", "EPSG:<code> of the file, or auto: as it declares; then poses go out on fix, too; empty: not")
    up: str = param("auto", "axis of the file that points up; auto: by its ground", choices=("auto", "z", "y"))


@parameters
class ComparisonParams:
    """Gradient features of depth images (N17 section III-B)."""

    is_sky_far: bool = param(False, "unknown pixels above all known ones of their column are far, not interpolated")
    is_measured_only: bool = param(
        False, "edges of depth only where ranges are known on both sides, none to the sky: for sweeps of a LiDAR"
    )


@parameters
class LikenessParams:
    """How an image is compared with depth images (`likeness/gradients.py`, `likeness/learned.py`)."""

    kind: str = param(
        "auto",
        "gradients: by edges (N17); learned: by trained networks, for whole panoramas at the default synthesis; "
        "auto: learned for those in a building, else gradients",
        choices=("auto", "gradients", "learned"),
    )


@parameters
class MotionParams:
    """How odometry errs (`belief/motion_model.py`)."""

    way_share: float = param(0.05, "standard deviation of a way, and of a turn, as share of it", low=0.0, high=1.0)
    drift_deg: float = param(2.0, "heading lost on a way of one metre; grows with its square root", "deg", low=0.0)
    min_sigma: float = param(0.05, "standard deviation of the position for each image, each axis", "m", low=0.0)
    max_speed: float = param(10.0, "faster odometry is a leap and not believed", "m/s", low=0.1)


@parameters
class CacheParams:
    """Which depth images are kept (`likeness/depth_cache.py`, N17 section III-C)."""

    max_distance: float = param(0.25, "largest distance of a position from the depth image used for it", "m", low=0.01)
    max_megabytes: int = param(1000, "memory for depth features; the least recently used go first", "MB", low=1)
    folder: str = param("", "folder to keep depth features in between runs; empty: none")


@parameters
class AreaParams:
    """Where the vehicle may be (`geometry/area.py`)."""

    step: float = param(0.25, "grid of possible positions", "m", low=0.05)
    min_piece: float = param(0.5, "smaller pieces that nothing joins to the largest one are left out", "m^2", low=0.0)
    limits: str = param("", "x0,y0,x1,y1 in m of the part of the map that is considered; empty: all of it")


@parameters
class ResamplingParams:
    """How many particles there are (`belief/particles.py`)."""

    num_particles: int = param(1000, "particles at the start, and at most; later as many as the belief needs", low=1)


@parameters
class MclStateParams(shared.StateParams):
    """When the pose is trusted (`status.py`)."""

    max_chance: float = param(
        1e-3, "false-alarm rate: a place is trusted whose lead over the map is chance less often", low=0.0, high=1.0
    )


@parameters
class MclInputParams(shared.InputParams):
    """Which images are used (`sphere_nav/localization/input_check.py`), and which of them are compared."""

    min_way: float = param(0.1, "images closer than this to the last one used only carry the pose on", "m", low=0.0)


@parameters
class DirectionParams:
    """Motion direction towards the next waypoint (`homing.py`, N17 section III-D)."""

    distance_step: float = param(1.0, "of the samples around a waypoint: d is once and twice that", "m", low=0.05)
    spacing: float = param(1.5, "distance of the waypoints along the path", "m", low=0.1)


@parameters
class FilterParams:
    """The filter and all its steps (`filter.py`)."""

    preset: str = param(
        "auto",
        "surroundings whose values take the place of those left at their defaults (site.py); auto: by the cloud",
        choices=("auto", "indoor", "outdoor"),
    )
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
    likeness: LikenessParams = group(LikenessParams)
    motion: MotionParams = group(MotionParams)
    area: AreaParams = group(AreaParams)
    cache: CacheParams = group(CacheParams)
    resampling: ResamplingParams = group(ResamplingParams)
    state: MclStateParams = group(MclStateParams)
    input: MclInputParams = group(MclInputParams)

    @property
    def num_headings(self) -> int:
        """How many headings are compared."""
        return round(360.0 / self.heading_step_deg)


@parameters
class MclDepthParams(FilterParams, NodeParams):
    """Everything that the node needs (`node.py`)."""

    cloud: str = param("", "map: .ply, .pcd, .las, .npy, plan .csv, a folder of tiles or key spheres; empty: wait")
    roll_deg: float = param(0.0, "of the vehicle, where there is no imu", "deg", low=-45.0, high=45.0)
    pitch_deg: float = param(0.0, "of the vehicle, where there is no imu", "deg", low=-45.0, high=45.0)
    survey: SurveyParams = group(SurveyParams)
    homing: DirectionParams = group(DirectionParams)
