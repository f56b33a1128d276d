"""The RViz configuration and the Foxglove layout show topics that the nodes publish, by type, durability and field."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import yaml

from architecture.tree import modules_with, parse
from sphere_nav.ros.interfaces import message_class

ROOT = Path(__file__).resolve().parents[2]
RVIZ = yaml.safe_load((ROOT / "config" / "sphere_nav.rviz").read_text(encoding="utf-8"))
FOXGLOVE = json.loads((ROOT / "config" / "foxglove.json").read_text(encoding="utf-8"))
TYPES = {  # what a display of RViz shows
    "MarkerArray": "MarkerArray",
    "PointCloud2": "PointCloud2",
    "Path": "Path",
    "PoseWithCovariance": "PoseWithCovarianceStamped",
    "Pose": "PoseStamped",
    "Odometry": "Odometry",
    "LaserScan": "LaserScan",
    "Image": "Image",
}
PACKAGES = ("sphere_nav_msgs", "sensor_msgs", "nav_msgs", "geometry_msgs", "visualization_msgs", "diagnostic_msgs")


def calls(name: str) -> dict[str, tuple[str, str]]:
    """Return the type, and the profile where one is named, of every topic that the packages open by this call."""
    found = {}
    for module in modules_with(f".{name}("):
        owner = f"/{module.parts[0]}/"
        for node in ast.walk(parse(module)):
            is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == name
            if is_call and len(node.args) > 1 and isinstance(node.args[0], ast.Constant):
                topic = str(node.args[0].value).replace("~/", owner)
                words = [ast.unparse(argument) for argument in node.args]
                found["/" + topic.lstrip("/")] = words[1], words[-1]
    return found


PUBLISHED = calls("add_publisher") | {"/diagnostics": ("DiagnosticArray", "qos.STATE")}  # every node: ros/live.py
HEARD = calls("add_subscription")


def displays() -> list[dict[str, Any]]:
    return [display for display in RVIZ["Visualization Manager"]["Displays"] if "Topic" in display]


def test_rviz_shows_what_is_published() -> None:
    shown = {d["Topic"]["Value"]: TYPES[d["Class"].split("/")[1]] for d in displays()}
    assert {topic: PUBLISHED.get(topic, ("nobody",))[0] for topic in shown} == shown
    assert {"/graph/markers", "/map_cloud", "/path", "/pose", "/residual", "/hypotheses"} <= set(shown)


def test_a_late_rviz_gets_what_is_latched() -> None:
    told = {d["Topic"]["Value"]: d["Topic"]["Durability Policy"] == "Transient Local" for d in displays()}
    assert told == {topic: PUBLISHED[topic][1] == "qos.LATCHED" for topic in told}
    assert any(told.values())


def test_an_initial_pose_goes_where_it_is_heard() -> None:
    (tool,) = [t for t in RVIZ["Visualization Manager"]["Tools"] if t["Class"].endswith("SetInitialPose")]
    assert tool["Topic"]["Value"] in HEARD
    assert FOXGLOVE["configById"]["3D!main"]["publish"]["poseEstimateTopic"] in HEARD


def test_foxglove_shows_what_is_published_by_fields_that_exist() -> None:
    panels = FOXGLOVE["configById"].values()
    topics = {topic for panel in panels for topic in panel.get("topics", {})}
    topics |= {panel["imageMode"]["imageTopic"] for panel in panels if "imageMode" in panel}
    topics |= {panel["topicToRender"] for panel in panels if "topicToRender" in panel}
    assert topics - set(PUBLISHED) == set()
    fields = [line["value"].rsplit(".", 1) for panel in panels for line in panel.get("paths", [])]
    assert len(fields) > 8
    for topic, field in fields:
        kind = PUBLISHED[topic][0]
        classes = (f"{package}/msg/{kind}" for package in PACKAGES)
        known = next(c for c in map(find_class, classes) if c is not None)
        assert field in known.get_fields_and_field_types(), f"{topic}.{field}"


def find_class(name: str) -> Any:
    try:
        return message_class(name)
    except (ValueError, OSError):
        return None


def test_every_panel_of_foxglove_has_its_place() -> None:
    def leaves(part: Any) -> set[str]:
        return {part} if isinstance(part, str) else leaves(part["first"]) | leaves(part["second"])

    assert leaves(FOXGLOVE["layout"]) == set(FOXGLOVE["configById"])
