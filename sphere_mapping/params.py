"""Parameters of mapping. A sphere's own numbers (camera, calibration) are data, not parameters."""

from __future__ import annotations

from sphere_mapping.acquisition.params import MatchParams
from sphere_nav.geometry.cameras.rolling_shutter import CameraParams
from sphere_nav.params import group, param, parameters
from sphere_nav.photometric import RegistrationParams

REGISTRATION = RegistrationParams(max_pixels=200_000)
"""How spheres are aligned: offline, so that all pixels may speak."""


@parameters
class PartialParams:
    """From one camera's view to a window of the sphere (`partial.py`)."""

    resolution: float = param(1.0, "sphere pixels for each pixel at the centre of the camera", low=0.1, high=4.0)


@parameters
class StereoParams(MatchParams):
    """From a rectified pair to range (`stereo.py`): a drive needs few pixels, but sure ones."""

    calibration_px: float = param(0.15, "standard deviation of disparity that rectification leaves", "px", low=0.0)
    max_relative_std: float = param(0.015, "relative range error above which a pixel is not measured", low=0.001)


@parameters
class KeySphereParams:
    """When a sphere becomes a key sphere (`keyframes.py`)."""

    max_mad_share: float = param(0.05, "MAD of the residual by 255, lambda of M15 eq. 12", low=0.0, high=1.0)
    min_overlap: float = param(0.6, "share of the reference still in view", low=0.0, high=1.0)
    max_parallax: float = param(0.12, "distance from the reference, by the reference's median range", low=0.01)
    max_parallax_whole: float = param(
        1.0, "the same for a whole sphere, which sees the way it left as well as the way ahead", low=0.01
    )
    merge: bool = param(True, "of key spheres that see the same place again a saved map has those that are needed")


@parameters
class LoopParams:
    """Loop closures (`loop_closure.py`)."""

    automatic: bool = param(True, "look at every new key sphere whether its place was seen before")
    min_way_m: float = param(1.0, "way between two key spheres that are compared by appearance", "m", low=0.0)


@parameters
class MapperParams:
    """The mapper and all its steps (`mapper.py`)."""

    num_references: int = param(2, "key spheres that each sphere is aligned to (M15 eq. 8)", low=1, high=4)
    partial: PartialParams = group(PartialParams)
    stereo: StereoParams = group(StereoParams)
    key: KeySphereParams = group(KeySphereParams)
    loop: LoopParams = group(LoopParams)


@parameters
class CloudParams:
    """The cloud of all key spheres that is shown while mapping (`cloud.py`)."""

    step: int = param(8, "every how many rows and columns of a key sphere", "px", low=1, high=256)
    max_range_m: float = param(50.0, "farther points are not shown", "m", low=0.1)
    max_points: int = param(500_000, "points in all; the newest key spheres first", low=100)


@parameters
class SphereMapperParams:
    """The node `sphere_mapper` (`node.py`)."""

    input: str = param("sphere", "what is mapped", choices=("sphere", "rgbd", "stereo"))
    slack_s: float = param(0.005, "largest difference of the stamps of one instant", "s", low=0.0, high=1.0)
    map_frame: str = param("map", "frame of the map")
    base_frame: str = param("base_link", "frame of the vehicle, whose pose is told")
    mounting: str = param("", "camera on base_frame, x,y,z,roll,pitch,yaw (m, rad) or a YAML; empty: by /tf_static")
    depth_pose: str = param(
        "", "depth camera in the axes of the image's, x,y,z,roll,pitch,yaw (m, rad) or a YAML; empty: as recorded"
    )
    driver: str = param("", "camera driver whose topics are heard: a name in config/cameras, or a file of that form")
    transport: str = param("raw", "images come on image_raw, or on image_raw/compressed", choices=("raw", "compressed"))
    map_folder: str = param("maps", "folder below which save_map writes")
    camera: CameraParams = group(CameraParams)
    mapper: MapperParams = group(MapperParams)
    cloud: CloudParams = group(CloudParams)
