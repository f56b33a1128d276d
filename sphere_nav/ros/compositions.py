"""Nodes that belong together: described once, started by `sphere_nav up` and by the launch files.

A composition has arguments, all of them text, and says which nodes to start with which parameters, topics and names.
With a `namespace` every relative topic lies below it, /tf, /tf_static and /clock too, so that several vehicles share a
domain. `site` is a parameter file for all nodes, with sections `/**` or `/**/<node>`; arguments go before it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sphere_nav.ros.camera.drivers import names_of, read_driver

Values = Mapping[str, str]
ABSOLUTE = ("/tf", "/tf_static", "/clock")  # would be shared by all vehicles of a domain
MAPPER_TOPICS = {"sphere": "sphere", "rgbd": "depth/image_raw", "stereo": "right/image_raw"}
TRUE, FALSE = ("true", "1", "yes"), ("false", "0", "no")


@dataclass(frozen=True)
class Argument:
    """One argument; a default of None must be given."""

    default: str | None
    meaning: str
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class NodeStart:
    """One node to start: parameters by dotted name, topics by their names in the node."""

    node: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    topics: Mapping[str, str] = field(default_factory=dict)
    namespace: str = ""
    site: str = ""


@dataclass(frozen=True)
class Composition:
    """What `sphere_nav up NAME` and `ros2 launch sphere_nav NAME.launch.py` start."""

    purpose: str
    arguments: Mapping[str, Argument]
    describe: Callable[[Values], list[NodeStart]]

    def starts(self, given: Values) -> list[NodeStart]:
        """Return the nodes to start; ValueError for an unknown, a missing or an impossible argument."""
        for name, value in given.items():
            if name not in self.arguments:
                raise ValueError(f"{name}: expected one of {', '.join(self.arguments)}, found this argument")
            choices = self.arguments[name].choices
            if choices and value not in choices:
                raise ValueError(f"{name}: expected {', '.join(choices)}, found {value!r}")
        values = {name: given.get(name, argument.default) for name, argument in self.arguments.items()}
        missing = [name for name, value in values.items() if value is None]
        if missing:
            raise ValueError(f"{missing[0]}: expected a value ({self.arguments[missing[0]].meaning}), found none")
        return self.describe({name: str(value) for name, value in values.items()})


def _is(values: Values, name: str) -> bool:
    """Return an argument that is true or false."""
    word = values[name].lower()
    if word not in TRUE + FALSE:
        raise ValueError(f"{name}: expected true or false, found {values[name]!r}")
    return word in TRUE


def _number(values: Values, name: str, kind: type[Any]) -> Any:
    try:
        return kind(values[name])
    except ValueError:
        raise ValueError(f"{name}: expected a number, found {values[name]!r}") from None


def _node(
    values: Values, name: str, parameters: Mapping[str, Any], topics: Mapping[str, str] | None = None
) -> NodeStart:
    """Return a node in the namespace, with the site's parameters and the clock of all."""
    namespace = values["namespace"].strip("/")
    own = {topic: topic.removeprefix("/") for topic in ABSOLUTE} if namespace else {}
    renamed = {topic: target for topic, target in (topics or {}).items() if target != topic}
    clock = {"use_sim_time": _is(values, "use_sim_time")} if "use_sim_time" in values else {}
    return NodeStart(name, {**parameters, **clock}, {**own, **renamed}, namespace, values["site"])


def _camera_topics(values: Values) -> dict[str, str]:
    image, info = values["image"], values["info"]
    return {"image_raw": image, "image_raw/compressed": f"{image}/compressed", "camera_info": info}


def _localizer(values: Values) -> NodeStart:
    topics = {**_camera_topics(values), "odom": values["odom"]}
    parameters = {name: values[name] for name in ("map", "transport", "driver")}
    rig = {"rig.cameras": values["cameras"], "rig.calibration": values["rig"]}
    parameters |= {name: value for name, value in rig.items() if value}
    return _node(values, "dense_localizer", parameters, topics)


def _follower(values: Values, cmd_vel: str) -> NodeStart:
    parameters: dict[str, Any] = {"enable_stamped_cmd_vel": _is(values, "stamped_cmd_vel")}
    parameters |= {"trajectory": values["trajectory"]} if values["trajectory"] else {}
    return _node(values, "path_follower", parameters, {"cmd_vel": cmd_vel, "scan": values["scan"]})


def _localisation(values: Values) -> list[NodeStart]:
    return [_localizer(values)]


def _navigation(values: Values) -> list[NodeStart]:
    if not _is(values, "guard"):
        return [_localizer(values), _follower(values, values["cmd_vel"])]
    stamped = {"is_stamped": _is(values, "stamped_cmd_vel")}
    guard = _node(values, "command_guard", stamped, {"cmd_vel": values["cmd_vel"]})
    return [_localizer(values), _follower(values, "cmd_vel_in"), guard]


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
        starts.append(_player(values, "" if values["rig"] else _heard(values, MAPPER_TOPICS[kind])))
    return starts


def _heard(values: Values, topic: str) -> str:
    """Return a camera's topic as the driver calls it, unless it is renamed."""
    return names_of(values["driver"]).get(topic, topic)


def _player(values: Values, wait_for: str) -> NodeStart:
    rate = _number(values, "rate", float)
    parameters = {"bag": values["bag"], "rate": rate, "wait_for": wait_for, "clock": _is(values, "use_sim_time")}
    own_clock = {name: value for name, value in values.items() if name != "use_sim_time"}  # it is the clock
    return _node(own_clock, "bag_player", parameters)


def _replay(values: Values) -> list[NodeStart]:
    return [*_recorder(values), _localizer(values), _player(values, _heard(values, values["image"]))]


def _recorder(values: Values) -> list[NodeStart]:
    if not values["record"]:
        return []
    return [_node(values, "bag_recorder", {"output": values["record"], "topic_set": "all"})]


def _simulation(values: Values) -> list[NodeStart]:
    timed = {**values, "use_sim_time": "true", "stamped_cmd_vel": "true", "guard": "false"}
    simulator = {
        "mode": values["mode"],
        "seed": _number(values, "seed", int),
        "world": values["world"],
        "traffic.is_on": _is(values, "traffic"),
        "has_stamped_command": True,  # a command says which image it answers: lock-step
    }
    starts = [*_recorder(timed), _node(values, "cycab_sim", simulator)]
    defaults = {name: argument.default or "" for name, argument in NAVIGATION.items()}
    return [*starts, *(_navigation({**defaults, **timed}) if values["map"] else [])]


COMMON = {
    "namespace": Argument("", "of all nodes and topics, where several vehicles share a domain"),
    "site": Argument("", "parameter file for all nodes"),
}
TIMED = {"use_sim_time": Argument("false", "take the time from /clock", (*TRUE, *FALSE)), **COMMON}
ODOM = {"odom": Argument("odom", "topic of the odometry")}
CAMERA = {
    "image": Argument("image_raw", "topic of the camera's images"),
    "info": Argument("camera_info", "topic of the camera's calibration"),
    "driver": Argument("", "camera driver whose topics are heard instead (config/cameras)"),
}
LOCALISATION = {
    "map": Argument(None, "map to localise in"),
    **CAMERA,
    "cameras": Argument("", "several cameras, on cameras/<name>/image_raw: names, with commas; empty: one"),
    "rig": Argument("", "rig file of the cameras, or map for that in the map; empty: by camera_info, /tf_static"),
    "transport": Argument("raw", "images come on IMAGE, or on IMAGE/compressed", ("raw", "compressed")),
    **ODOM,
    **TIMED,
}
NAVIGATION = {
    **LOCALISATION,
    "trajectory": Argument("", "file of the trajectory to follow; empty: by the service load_trajectory or a topic"),
    "cmd_vel": Argument("cmd_vel", "topic of the commands to the base"),
    "stamped_cmd_vel": Argument("false", "commands are TwistStamped, not Twist"),
    "guard": Argument("false", "put command_guard before the base, which has no time-out of its own"),
    "scan": Argument("scan", "topic of the laser scanner"),
}
BAG = {
    "bag": Argument("", "bag to play; empty: live topics"),
    "rate": Argument("1.0", "speed of playing; 0: as fast as the listeners take it"),
}
COMPOSITIONS = {
    "mapping": Composition(
        "the mapper on live topics or a bag, with the stitcher before it where a rig is named",
        {
            "input": Argument("sphere", "what is mapped", tuple(MAPPER_TOPICS)),
            "rig": Argument("", "rig file of the cameras that the stitcher makes spheres of; empty: no stitcher"),
            "driver": Argument("", "camera driver whose topics are heard (config/cameras), of rgbd and stereo"),
            **BAG,
            **ODOM,
            **TIMED,
        },
        _mapping,
    ),
    "localisation": Composition("the localiser in a map: pose, status and map -> odom", LOCALISATION, _localisation),
    "navigation": Composition(
        "localiser and path follower; nothing moves before the call path_follower/start", NAVIGATION, _navigation
    ),
    "nav2": Composition(
        "beside Nav2: map -> odom, and commands for its collision monitor instead of the base",
        {**NAVIGATION, "cmd_vel": Argument("cmd_vel_smoothed", "input of the collision monitor (cmd_vel_in_topic)")},
        _navigation,
    ),
    "mcl": Composition(
        "the localiser in bare geometry",
        {
            "cloud": Argument(None, "cloud, mesh, floor plan or map to localise in"),
            **CAMERA,
            **ODOM,
            "other": Argument("other/pose", "topic of the pose of another localiser, which watches and helps"),
            "path": Argument("reference_path", "topic of the path to be followed by direction"),
            "preset": Argument("auto", "surroundings: indoor, outdoor, or auto: by the cloud"),
            **TIMED,
        },
        _mcl,
    ),
    "simulation": Composition(
        "the simulated Cycab; with a map also localiser and path follower, so that it drives by its camera",
        {
            "mode": Argument("drive", "who drives: the topic cmd_vel, or the simulator itself", ("drive", "teach")),
            "seed": Argument("1", "decides the town and every noise"),
            "world": Argument("town", "where it drives", ("town", "city", "corridor", "ramp")),
            "traffic": Argument("false", "cars, cyclists and pedestrians in the streets"),
            "map": Argument("", "map to localise in; empty: the simulator alone"),
            "trajectory": Argument("", "file of the trajectory to follow"),
            "record": Argument("", "bag to record everything into; empty: none"),
            **COMMON,
        },
        _simulation,
    ),
    "replay": Composition(
        "a recorded drive, localised in a map",
        {
            **LOCALISATION,
            "bag": Argument(None, "bag to play"),
            "rate": BAG["rate"],
            "record": Argument("", "bag to record everything into; empty: none"),
            "use_sim_time": Argument("true", "the recording's time, on /clock", (*TRUE, *FALSE)),
        },
        _replay,
    ),
}
