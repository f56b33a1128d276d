"""Parameters of the simulator, each with meaning, unit and range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from sphere_nav.params import build, group, leaves, param, parameters, to_mapping

CONDITIONS: Mapping[str, Mapping[str, Any]] = {
    # hours are solar; an exposure brings the mean grey level of the town near that of the default light
    "low_sun": {"light.sun": "265,17.2h", "light.exposure": 2.2},
    "overcast": {"light.sun": "120,10.0h", "light.overcast": 1.0, "light.exposure": 1.6},
    "wet": {"light.sun": "120,15.0h", "light.overcast": 0.9, "season.wet": 1.0, "light.exposure": 1.8},
    "autumn": {"light.sun": "300,10.0h", "light.exposure": 1.2, "season.leaves": "yellow"},
    "winter": {"light.sun": "355,11.0h", "light.exposure": 1.4, "season.leaves": "none"},
    "snow": {
        "light.sun": "20,13.0h", "light.overcast": 0.7, "light.exposure": 1.6,
        "season.leaves": "none", "season.snow": 0.8,
    },
    "dusk": {
        "light.sun": "265,18.35h", "light.has_street_lamps": True, "light.torch": 3000.0,
        "light.exposure": 450.0, "imaging.noise": 2.0,
    },
    "night_lamps": {
        "light.sun": "300,22.0h", "light.has_street_lamps": True, "light.torch": 3000.0,
        "light.exposure": 900.0, "imaging.noise": 3.0,
    },
    "night_torch": {
        "light.sun": "300,22.0h", "light.torch": 6000.0, "light.exposure": 900.0, "imaging.noise": 3.0,
    },
}  # fmt: skip


@parameters
class LightParams:
    """Sun and exposure."""

    sun: str = param(
        "238,43",
        "where the sun is: azimuth (from x, to the left), elevation (deg); or hour (20 May): 9.5h; of a day: 265,9.5h",
    )
    exposure: float = param(0.85, "factor from radiance to the range of the grey levels", low=0.0)
    clouds: float = param(0.0, "share of the sun's light that passing clouds take", low=0.0, high=1.0)
    overcast: float = param(0.0, "share of the sky behind a closed layer of clouds", low=0.0, high=1.0)
    has_street_lamps: bool = param(False, "whether street lamps and some windows are lit")
    torch: float = param(0.0, "light of the head lamp on the car's nose", "cd", low=0.0, high=1e6)

    cloud_period: ClassVar[float] = 90.0  # from cloud to cloud, about, s
    gamma: ClassVar[float] = 2.2  # grey level = 255 radiance^(1/gamma)

    @property
    def has_hour(self) -> bool:
        """Whether an hour decides where the sun is."""
        return self.sun.endswith("h")

    @property
    def sun_deg(self) -> tuple[float, float]:
        """Azimuth, counter-clockwise from the x axis, and elevation of a sun without an hour, deg."""
        azimuth, elevation = split_numbers("light.sun", self.sun, "azimuth,elevation", (-360.0, 3.0), (360.0, 90.0))
        return azimuth, elevation

    @property
    def day_and_hour(self) -> tuple[float, float]:
        """Day of the year, 20 May where none is given, and solar time, h."""
        text = self.sun.removesuffix("h")
        day, hour = split_numbers("light.sun", text if "," in text else f"140,{text}", "day,hour", (1, 0), (366, 24))
        return day, hour


@parameters
class SeasonParams:
    """What days and weather change in a world whose buildings stay."""

    leaves: str = param("green", "of the trees", choices=("green", "yellow", "none"))
    parked: int = param(0, "other cars are parked, elsewhere along the same kerbs; 0: those of the seed", low=0)
    wet: float = param(0.0, "water on the ground: darker, and a mirror where it stands", low=0.0, high=1.0)
    snow: float = param(0.0, "share of open, upward surfaces that is white; its depth is not drawn", low=0.0, high=1.0)


@parameters
class ImagingParams:
    """What the sensors and lenses of the camera and of the rig's cameras do to their images."""

    noise: float = param(1.0, "factor on the deviation of the noise of read-out and light", low=0.0, high=50.0)
    vignetting: float = param(0.0, "share of the light lost in the corners of a lens", low=0.0, high=0.95)
    has_automatic_exposure: bool = param(False, "the exposure follows the mean grey level of the images")
    white_balance: float = param(0.0, "standard deviation of the share of red and blue, drifting", low=0.0, high=0.5)
    shutter: float = param(
        0.0, "how long the shutter is open around the stamp; 0: no motion blur", "s", low=0.0, high=1.0
    )

    exposure_delay: ClassVar[float] = 0.1  # from an image to the first exposure that heeds it, s
    exposure_lag: ClassVar[float] = 0.4  # time constant with which the exposure follows, s
    target: ClassVar[float] = 115.0  # mean grey level that it aims at, grey level
    range: ClassVar[float] = 8.0  # largest factor of the automatic exposure, up and down
    white_balance_period: ClassVar[float] = 40.0  # in which the white balance drifts, s
    shutter_samples: ClassVar[int] = 6  # instants of which a blurred image is the mean


@parameters
class TrafficParams:
    """What moves through the streets of a town; where it is at an instant depends on the seed and the stamp alone."""

    density: str = param("none", "how many are under way; busy: twice as many", choices=("none", "usual", "busy"))
    seed: int = param(0, "decides who is under way, together with the seed of the town", low=0)
    may_cross: bool = param(False, "traffic may cross the path; who would touch the car is not there")
    standing_at: float = param(
        0.0, "somebody stands in the way of the car, so far along the path; 0: nobody", "m", low=0.0
    )

    speeds: ClassVar[Mapping[str, float]] = {"road": 5.0, "cycle": 3.5, "walk": 1.3}  # mean, by where they go, m/s
    trams: ClassVar[int] = 1  # trams of three sections
    members: ClassVar[Mapping[str, tuple[int, int, int]]] = {  # cars, cyclists, pedestrians
        "usual": (12, 6, 40), "busy": (20, 10, 80),
    }  # fmt: skip


@parameters
class RenderParams:
    """Effort spent on an image."""

    supersampling: int = param(2, "n x n rays for pixels where surfaces meet; 1: none", low=1, high=8)
    shadow_texel: float = param(0.08, "resolution of the shadows; 0: things cast none", "m", low=0.0)


@parameters
class CarParams:
    """The Cycab: an electric car that steers its front wheels; the reference point is the rear axle's middle."""

    wheelbase: float = param(1.2, "distance between the axles", "m", low=0.05)
    front: float = param(1.55, "from the rear axle to the front end of the body", "m", low=0.0)
    rear: float = param(0.35, "from the rear axle to the rear end of the body", "m", low=0.0)
    width: float = param(1.2, "width of the body", "m", low=0.05)
    max_steering_angle: float = param(0.45, "largest angle of the (virtual) front wheel", "rad", low=0.01, high=1.4)
    max_steering_rate: float = param(0.7, "largest rate of the steering angle", "rad/s", low=0.01)

    max_reverse_speed: ClassVar[float] = 2.0  # largest speed in reverse, m/s
    max_acceleration: ClassVar[float] = 1.5  # largest gain of speed, m/s^2
    max_deceleration: ClassVar[float] = 4.0  # largest loss of speed, m/s^2
    max_speed: ClassVar[float] = 5.0  # largest speed forward, m/s


@parameters
class ActuatorParams:
    """How the car follows its commands."""

    dead_time: float = param(0.0, "from a command to the first reaction of the car", "s", low=0.0, high=1.0)
    steering_lag: float = param(0.2, "time constant of the steering, first order", "s", low=0.0, high=2.0)
    speed_lag: float = param(0.2, "time constant of the speed, first order", "s", low=0.0, high=2.0)


@parameters
class OdometryParams:
    """Wheel odometry; what it measures wrongly: `vehicle.WheelErrors`."""

    period: float = param(0.02, "time between two messages", "s", low=0.001)


@parameters
class SimCameraParams:
    """The camera for driving, looking forward."""

    model: str = param("pinhole", "lens; a panorama sees all around", choices=("pinhole", "fisheye", "panorama"))
    period: float = param(0.1, "time between two images; 0: there are none", "s", low=0.0)
    size: str = param("640,480", "columns,rows; a panorama keeps as many rows around its horizon", "px")
    view_deg: float = param(80.0, "horizontal field of view of a lens", "deg", low=10.0, high=280.0)
    mounting_deg: str = param(
        "1,0,1.6,0,4,0", "x,y,z (m),roll,pitch,yaw on base_link; pitch looks down, roll 180: upside down", "deg"
    )

    distortion: ClassVar[tuple[float, float]] = (-0.05, 0.01)  # radial, of a lens
    noises: ClassVar[tuple[float, float]] = (1.2, 0.012)  # read-out: deviation; light: variance over the level

    @property
    def columns_rows(self) -> tuple[int, int]:
        """Columns and rows of the images, px."""
        return columns_and_rows("camera.size", self.size)

    @property
    def place(self) -> tuple[float, ...]:
        """Return x, y, z, roll, pitch, yaw on the car, m and deg; turns about its fixed axes, roll first."""
        low, high = (-100.0, -100.0, 0.05, -180.0, -90.0, -180.0), (100.0, 100.0, 100.0, 180.0, 90.0, 180.0)
        return split_numbers("camera.mounting_deg", self.mounting_deg, "x,y,z,roll,pitch,yaw", low, high)


@parameters
class CaptureParams:
    """When the ideal sphere and the rig, on the roof, take images."""

    when: str = param("teach", "while the simulator teaches, or always", choices=("teach", "always"))
    distance: float = param(0.5, "way between two captures", "m", low=0.01)


@parameters
class SphereParams:
    """The ideal RGB-D sphere on the roof."""

    width: int = param(1024, "columns of the whole sphere, twice the rows; 0: no spheres", "px", low=0, high=8192)

    place: ClassVar[tuple[float, float, float]] = (0.4, 0.0, 1.8)  # on the car, from the rear axle, m
    noises: ClassVar[tuple[float, float]] = (0.8, 0.006)  # read-out: deviation; light: variance over the level


@parameters
class CameraRigParams:
    """Six cameras on the roof: three stereo pairs back to back one above the other, or a ring (M15 section 4.3)."""

    kind: str = param("none", "arrangement of the cameras", choices=("none", "vertical", "ring"))
    model: str = param("fisheye", "lens", choices=("pinhole", "fisheye"))
    size: str = param("544,544", "columns,rows of each camera", "px")
    view_deg: float = param(190.0, "horizontal field of view of each camera", "deg", low=30.0, high=280.0)
    tolerance: float = param(1.0, "times 1 mm, 0.3 deg, 0.3 % of the focal length: where each is mounted", low=0.0)
    file: str = param("", "write the rig's true description to this file at the start; empty: nowhere")

    place: ClassVar[tuple[float, float, float]] = (0.4, 0.0, 1.8)  # of the upper cameras' middle on the car, m
    baseline: ClassVar[float] = 0.3  # from each camera to the one below it, or to the next of the ring, m
    radius: ClassVar[float] = 0.03  # from the mast of the vertical rig to its cameras, m
    noises: ClassVar[tuple[float, float]] = (0.8, 0.006)  # read-out: deviation; light: variance over the level
    distortion: ClassVar[tuple[float, float]] = (-0.02, 0.002)  # radial, of the lens

    @property
    def columns_rows(self) -> tuple[int, int]:
        """Columns and rows of the images, px."""
        return columns_and_rows("rig.size", self.size)


@parameters
class ImuParams:
    """An inertial sensor with the axes of the car; what it measures wrongly: `imu.ImuErrors`."""

    is_on: bool = param(False, "publish readings")

    place: ClassVar[tuple[float, float, float]] = (0.4, 0.0, 0.5)  # on the car, from the rear axle, m
    period: ClassVar[float] = 0.01  # time between two readings, s


@parameters
class ScanParams:
    """A laser scanner in a plane parallel to the wheels' contact points; what it is like: `scanner.ScannerModel`."""

    is_on: bool = param(False, "publish scans")

    period: ClassVar[float] = 0.1  # time between two scans, s


@parameters
class TeachParams:
    """The drive that the simulator does by itself, like a careful human."""

    speed: float = param(1.4, "speed on straight road", "m/s", low=0.05)

    wander: ClassVar[float] = 0.05  # largest distance from the planned path on purpose, m
    delay: ClassVar[float] = 2.0  # simulated time before the car starts, for recorders to be ready, s
    look_ahead: ClassVar[float] = 1.2  # the driver steers towards the path this far ahead, m
    acceleration: ClassVar[float] = 0.5  # gain and loss of speed, m/s^2
    lateral_acceleration: ClassVar[float] = 0.35  # largest lateral acceleration in bends, m/s^2


@parameters
class ClockParams:
    """How simulated time passes."""

    max_wait: float = param(
        3.0, "wall time to wait for the command that answers an image; 0: the clock runs on", "s", low=0.0
    )
    real_time_factor: float = param(1.0, "simulated over wall time where nothing waits; 0: no limit", low=0.0)
    is_strict: bool = param(
        False,
        "time waits for those who shall see and answer, then for every answer from the first image on, without limit: "
        "the same drive on a slow machine",
    )
    pause_at: float = param(
        0.0, "where strict: time of the image after whose answer time stands until ~/resume; 0: none", "s", low=0.0
    )

    step: ClassVar[float] = 0.01  # simulated time of one step, s


@parameters
class SimParams:
    """Everything that the simulator needs."""

    seed: int = param(1, "decides the town and every noise", low=0)
    noise_seed: int = param(1, "decides the noise only", low=0)
    mode: str = param("drive", "who drives: the topic cmd_vel, or the simulator itself", choices=("drive", "teach"))
    world: str = param("town", "where it drives", choices=("town", "city", "corridor", "ramp"))
    path: str = param(
        "two_turns", "path to start on and to teach, in the town", choices=("two_turns", "block", "straight")
    )
    condition: str = param(
        "", "light and season by name, for what is not set otherwise; empty: as set", choices=("", *CONDITIONS)
    )
    has_stamped_command: bool = param(True, "cmd_vel is TwistStamped, not Twist")
    clock: ClockParams = group(ClockParams)
    teach: TeachParams = group(TeachParams)
    vehicle: CarParams = group(CarParams)
    actuation: ActuatorParams = group(ActuatorParams)
    odometry: OdometryParams = group(OdometryParams)
    camera: SimCameraParams = group(SimCameraParams)
    capture: CaptureParams = group(CaptureParams)
    sphere: SphereParams = group(SphereParams)
    rig: CameraRigParams = group(CameraRigParams)
    imaging: ImagingParams = group(ImagingParams)
    imu: ImuParams = group(ImuParams)
    scan: ScanParams = group(ScanParams)
    light: LightParams = group(LightParams)
    season: SeasonParams = group(SeasonParams)
    traffic: TrafficParams = group(TrafficParams)
    render: RenderParams = group(RenderParams)


def in_condition(params: SimParams) -> SimParams:
    """Return parameters with those of their condition wherever they stand at the default."""
    default = {leaf.name: leaf.default for leaf in leaves(SimParams)}
    values = to_mapping(params)
    named = CONDITIONS.get(params.condition, {})
    return build(SimParams, values | {name: value for name, value in named.items() if values[name] == default[name]})


def columns_and_rows(name: str, text: str) -> tuple[int, int]:
    """Return columns and rows, px."""
    columns, rows = split_numbers(name, text, "columns,rows", (16, 16), (8192, 8192))
    if not (columns.is_integer() and rows.is_integer()):
        raise ValueError(f"{name}: expected whole numbers columns,rows, found {text!r}")
    return int(columns), int(rows)


def split_numbers(name: str, text: str, form: str, low: Sequence[float], high: Sequence[float]) -> tuple[float, ...]:
    """Return the numbers of a parameter, separated by commas, within their bounds; `form` says what they are."""
    try:
        found = tuple(map(float, text.split(",")))
    except ValueError:
        found = ()
    if len(found) != len(low) or not all(a <= value <= b for a, value, b in zip(low, found, high, strict=True)):
        bounds = f"{','.join(f'{value:g}' for value in low)} to {','.join(f'{value:g}' for value in high)}"
        raise ValueError(f"{name}: expected {form} within {bounds}, found {text!r}")
    return found
