"""Nodes that belong together: described once, started by `sphere_nav up` and by the launch files.

A composition has arguments, all of them text, and says which nodes to start with which parameters, topics and names.
With a `namespace` every relative topic lies below it, /tf, /tf_static and /clock too, so that several vehicles share a
domain. `site` is a parameter file for all nodes, with sections `/**` or `/**/<node>`; arguments go before it.
What is unknown or impossible is refused before anything starts; `after_exit` says what follows when a node ends.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.params import meant
from sphere_nav.params.homes import at_home
from sphere_nav.ros.camera.drivers import read_driver, topics_by_driver
from sphere_nav.ros.constants import ABSOLUTE, MAX_RESTARTS
from sphere_nav.ros.site_file import check_site_file

Values = Mapping[str, Any]  # of the arguments
MAPPER_TOPICS = {"sphere": "sphere", "rgbd": "depth/image_raw", "stereo": "right/image_raw"}
TRUE, FALSE = ("true", "True", "yes", "1"), ("false", "False", "no", "0")
FLAG = (*TRUE, *FALSE)
TOPIC = re.compile(r"~?/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)  # names as ROS 2 allows them
NAMESPACE = re.compile(r"/?|/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*/?", re.ASCII)
SECURITY = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_ENCLAVE_OVERRIDE": ""}
CANNOT_START = 2  # status of a node that refuses its parameters: a restart changes nothing
RESTART_AFTER: Mapping[str, float | None] = {  # s from the end of a node to its restart; None: its end ends all
    "command_guard": 0.1,  # a base without a time-out waits for its zero; > 0: an end of all comes first
    "dense_localizer": 2.0,
    "mcl_depth": 2.0,
    "sphere_stitcher": 2.0,
    "bag_recorder": 2.0,
    "route_navigator": 2.0,  # the follower drives on meanwhile
    "sphere_mapper": None,  # the map is in its memory
    "path_follower": None,  # an operator must see it
    "cycab_sim": None,  # the clock of all
    "bag_player": None,  # the others outlive the good end of a bag
}
OUTLIVED = "bag_player"


@dataclass(frozen=True)
class Argument:
    """One argument; a default of None must be given. A `file` that is named must exist."""

    default: str | None
    meaning: str
    choices: tuple[str, ...] = ()
    form: re.Pattern[str] | None = None
    is_file: bool = False
    kind: type[Any] = str

    def read(self, name: str, text: str) -> Any:
        """Return the value of a text; ValueError for one that is not possible, whatever files there are."""
        if self.choices and text not in self.choices:
            raise ValueError(f"{name}: expected {', '.join(self.choices)}, found {text!r}")
        if self.form and not self.form.fullmatch(text):
            raise ValueError(f"{name}: expected letters, digits, _ and / as in a name of ROS, found {text!r}")
        if self.choices is FLAG:
            return text in TRUE
        if self.kind is str:
            return at_home(text)
        try:
            number = self.kind(text)
        except ValueError:
            number = math.nan
        if not 0 <= number < math.inf:
            what = "a whole number" if self.kind is int else "a number"
            raise ValueError(f"{name}: expected {what}, 0 or more, found {text!r}")
        return number


@dataclass(frozen=True)
class NodeStart:
    """One node to start: parameters by dotted name, topics by their names in the node."""

    node: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    namespace: str = ""
    site: str = ""
    enclave: str = ""  # of SROS2; empty: without security


@dataclass(frozen=True)
class Composition:
    """What `sphere_nav up NAME` and `ros2 launch sphere_nav NAME.launch.py` start."""

    purpose: str
    arguments: Mapping[str, Argument]
    describe: Callable[[Values], list[NodeStart]]

    def starts(self, given: Values) -> list[NodeStart]:
        """Return the nodes to start; ValueError for an unknown, a missing or an impossible argument."""
        for name in given:
            if name not in self.arguments:
                hint = meant(name, self.arguments)
                raise ValueError(f"{name}{hint}: expected one of {', '.join(self.arguments)}, found this argument")
        values = {}
        for name, argument in self.arguments.items():
            if (text := given.get(name, argument.default)) is None:
                raise ValueError(f"{name}: expected a value ({argument.meaning}), found none")
            values[name] = argument.read(name, text)
        return self.describe(values)

    def ready(self, given: Values) -> list[NodeStart]:
        """Return the nodes to start, as `starts`; ValueError too for a file that does not exist or does not fit."""
        starts = self.starts(given)
        for name, value in given.items():
            is_named = self.arguments[name].is_file and value and (name, value) != ("rig", "map")
            if is_named and not Path(value).exists():
                raise ValueError(f"{name}: expected a file or folder that exists, found {value!r}")
        if given.get("driver"):
            read_driver(given["driver"])
        check_enclaves(starts)
        if given.get("site"):
            check_site_file(given["site"], tuple(RESTART_AFTER))
        return starts


def after_exit(node: str, status: int, num_restarts: int) -> float | None:
    """Return in how many seconds a node that has ended starts again, or None: the others go on without it.

    RuntimeError: all must end. A node that ends with status 0 was told to, by someone who means it.
    """
    if node == OUTLIVED and status == 0:
        return None
    delay = RESTART_AFTER[node]
    if delay is None or status in (0, CANNOT_START) or num_restarts >= MAX_RESTARTS:
        raise RuntimeError(f"{node} ended with status {status}; the others end, too")
    return delay


def check_enclaves(starts: Sequence[NodeStart]) -> None:
    """Raise ValueError where a node is to start with its keys, and would start without them or with other ones."""
    enclaves = [start.enclave for start in starts if start.enclave]
    for name, expected in SECURITY.items() if enclaves else ():
        if (found := os.environ.get(name, "")) != expected:
            wanted = f"{name}={expected}" if expected else f"no {name}"
            raise ValueError(f"security: expected {wanted}, found {found or 'nothing'!r}")
    for enclave in enclaves:
        path = Path(os.environ.get("ROS_SECURITY_KEYSTORE", "")) / f"enclaves{enclave}/permissions.p7s"
        if not path.is_file():
            raise ValueError(f"security: expected {path} (sphere_nav keystore makes it), found no such file")


def _node(
    values: Values, name: str, parameters: Mapping[str, Any], topics: Mapping[str, str] | None = None
) -> NodeStart:
    """Return a node in the namespace, with the site's parameters and the clock of all."""
    namespace = values["namespace"].strip("/")
    own = {topic: topic.removeprefix("/") for topic in ABSOLUTE} if namespace else {}
    renamed = {topic: target for topic, target in (topics or {}).items() if target != topic}
    clock = {"use_sim_time": values["use_sim_time"]} if "use_sim_time" in values else {}
    enclave = f"/{namespace}/{name}".replace("//", "/") if values["security"] else ""
    return NodeStart(name, {**parameters, **clock}, {**own, **renamed}, namespace, values["site"], enclave)


def _localizer(values: Values) -> NodeStart:
    image = values["image"]
    topics = {"image_raw": image, "image_raw/compressed": f"{image}/compressed"}
    topics |= {"camera_info": values["info"], "odom": values["odom"]}
    parameters = {name: values[name] for name in ("map", "transport", "driver")}
    rig = {"rig.cameras": values["cameras"], "rig.calibration": values["rig"]}
    parameters |= {name: value for name, value in rig.items() if value}
    return _node(values, "dense_localizer", parameters, topics)


def _follower(values: Values, cmd_vel: str) -> NodeStart:
    parameters: dict[str, Any] = {"enable_stamped_cmd_vel": values["stamped_cmd_vel"]}
    parameters |= {"trajectory": values["trajectory"]} if values["trajectory"] else {}
    return _node(values, "path_follower", parameters, {"cmd_vel": cmd_vel, "scan": values["scan"]})


def _navigation(values: Values) -> list[NodeStart]:
    routes = [_node(values, "route_navigator", {"network": values["routes"]})] if values["routes"] else []
    if not values["guard"]:
        return [_localizer(values), _follower(values, values["cmd_vel"]), *routes]
    stamped = {"is_stamped": values["stamped_cmd_vel"]}
    guard = _node(values, "command_guard", stamped, {"cmd_vel": values["cmd_vel"]})
    return [_localizer(values), _follower(values, "cmd_vel_in"), guard, *routes]


def _mcl(values: Values) -> list[NodeStart]:
    topics = {"image_raw": values["image"], "camera_info": values["info"], "odom": values["odom"]}
    topics |= {"other/pose": values["other"], "reference_path": values["path"]}
    return [_node(values, "mcl_depth", {name: values[name] for name in ("cloud", "preset", "driver")}, topics)]


def _mapping(values: Values) -> list[NodeStart]:
    kind = values["input"]
    if values["driver"] and kind == "sphere":
        kind = read_driver(values["driver"]).input
        if kind not in MAPPER_TOPICS:
            raise ValueError(f"driver: expected one with depth or two cameras, found {values['driver']}")
    mapper = {"input": kind, "driver": values["driver"]}
    starts = [_node(values, "sphere_mapper", mapper, {"odom": values["odom"]})]
    if values["rig"]:
        starts.insert(0, _node(values, "sphere_stitcher", {"rig": values["rig"]}))
    if values["bag"]:
        first = f"cameras/{next(iter(read_rig(values['rig']).names))}/image_raw" if values["rig"] else ""
        starts.append(_player(values, first or _heard(values, MAPPER_TOPICS[kind])))
    return starts


def _heard(values: Values, topic: str) -> str:
    """Return a camera's topic as the driver calls it, unless it is renamed."""
    return topics_by_driver(values["driver"]).get(topic, topic)


def _player(values: Values, wait_for: str) -> NodeStart:
    parameters = {"bag": values["bag"], "rate": values["rate"], "wait_for": wait_for, "clock": values["use_sim_time"]}
    own_clock = {name: value for name, value in values.items() if name != "use_sim_time"}  # it is the clock
    return _node(own_clock, "bag_player", parameters)


def _replay(values: Values) -> list[NodeStart]:
    return [_localizer(values), _player(values, _heard(values, values["image"]))]


def _simulation(values: Values) -> list[NodeStart]:
    timed = {**values, "use_sim_time": True, "stamped_cmd_vel": True, "guard": False}
    simulator = {
        "mode": values["mode"],
        "seed": values["seed"],
        "world": values["world"],
        "traffic.density": "usual" if values["traffic"] else "none",
        "has_stamped_command": True,  # a command says which image it answers: lock-step
    }
    starts = [_node(values, "cycab_sim", simulator)]
    if values["record"]:
        starts.insert(0, _node(timed, "bag_recorder", {"output": values["record"], "topic_set": "all"}))
    defaults = {name: argument.read(name, argument.default or "") for name, argument in NAVIGATION.items()}
    return [*starts, *(_navigation({**defaults, **timed}) if values["map"] else [])]


_topic, _file = partial(Argument, form=TOPIC), partial(Argument, is_file=True)
COMMON = {
    "namespace": Argument("", "of all nodes and topics, where several vehicles share a domain", form=NAMESPACE),
    "site": _file("", "parameter file for all nodes"),
    "security": Argument("false", "start each node with its keys, which sphere_nav keystore makes (SROS2)", FLAG),
}
TIMED = {"use_sim_time": Argument("false", "take the time from /clock", FLAG), **COMMON}
ODOM = {"odom": _topic("odom", "topic of the odometry")}
CAMERA = {
    "image": _topic("image_raw", "topic of the camera's images"),
    "info": _topic("camera_info", "topic of the camera's calibration"),
    "driver": Argument("", "camera driver whose topics are heard instead (config/cameras)"),
}
LOCALISATION = {
    "map": _file(None, "map to localise in"),
    **CAMERA,
    "cameras": Argument("", "several cameras, on cameras/<name>/image_raw: names, with commas; empty: one"),
    "rig": _file("", "rig file of the cameras, or map for that in the map; empty: by camera_info, /tf_static"),
    "transport": Argument("raw", "images come on IMAGE, or on IMAGE/compressed", ("raw", "compressed")),
    **ODOM,
    **TIMED,
}
ROUTES = {
    "routes": _file("", "network of taught paths, or a map that has one, for missions by route_navigator; empty: none")
}
NAVIGATION = {
    **LOCALISATION,
    **ROUTES,
    "trajectory": _file("", "file of the trajectory to follow; empty: by the service load_trajectory or a topic"),
    "cmd_vel": _topic("cmd_vel", "topic of the commands to the base"),
    "stamped_cmd_vel": Argument("false", "commands are TwistStamped, not Twist", FLAG),
    "guard": Argument("false", "put command_guard before the base, which has no time-out of its own", FLAG),
    "scan": _topic("scan", "topic of the laser scanner"),
}
BAG = {
    "bag": _file("", "bag to play; empty: live topics"),
    "rate": Argument("1.0", "speed of playing; 0: as fast as the listeners take it", kind=float),
}
COMPOSITIONS = {
    "mapping": Composition(
        "the mapper on live topics or a bag, with the stitcher before it where a rig is named",
        {
            "input": Argument("sphere", "what is mapped", tuple(MAPPER_TOPICS)),
            "rig": _file("", "rig file of the cameras that the stitcher makes spheres of; empty: no stitcher"),
            "driver": Argument("", "camera driver whose topics are heard (config/cameras), of rgbd and stereo"),
            **BAG,
            **ODOM,
            **TIMED,
        },
        _mapping,
    ),
    "localisation": Composition(
        "the localiser in a map: pose, status and map -> odom", LOCALISATION, lambda values: [_localizer(values)]
    ),
    "navigation": Composition(
        "localiser and path follower; nothing moves before the call path_follower/start", NAVIGATION, _navigation
    ),
    "nav2": Composition(
        "beside Nav2: map -> odom, and commands for its collision monitor instead of the base",
        {
            **NAVIGATION,
            "cmd_vel": _topic("cmd_vel_smoothed", "input of the collision monitor (cmd_vel_in_topic)"),
        },
        _navigation,
    ),
    "mcl": Composition(
        "the localiser in bare geometry",
        {
            "cloud": _file(None, "cloud, mesh, floor plan or map to localise in"),
            **CAMERA,
            **ODOM,
            "other": _topic("other/pose", "topic of the pose of another localiser, which watches and helps"),
            "path": _topic("reference_path", "topic of the path to be followed by direction"),
            "preset": Argument("auto", "surroundings: indoor, outdoor, or auto: by the cloud"),
            **TIMED,
        },
        _mcl,
    ),
    "simulation": Composition(
        "the simulated Cycab; with a map also localiser and path follower, so that it drives by its camera",
        {
            "mode": Argument("drive", "who drives: the topic cmd_vel, or the simulator itself", ("drive", "teach")),
            "seed": Argument("1", "decides the town and every noise", kind=int),
            "world": Argument("town", "where it drives", ("town", "city", "corridor", "ramp")),
            "traffic": Argument("false", "cars, cyclists and pedestrians in the streets", FLAG),
            "map": _file("", "map to localise in; empty: the simulator alone"),
            "trajectory": _file("", "file of the trajectory to follow"),
            **ROUTES,
            "record": Argument("", "bag to record everything into; empty: none"),
            **COMMON,
        },
        _simulation,
    ),
    "replay": Composition(
        "a recorded drive, localised in a map",
        {
            **LOCALISATION,
            "bag": _file(None, "bag to play"),
            "rate": BAG["rate"],
            "use_sim_time": Argument("true", "the recording's time, on /clock", FLAG),
        },
        _replay,
    ),
}
