"""Topics of bags as their first messages show them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

from sphere_nav.ros.bags.streams import CAMERA_INFO, COMPRESSED, IMAGE, Stream
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.offline.topic_finder import TopicFinder


def image(topic, encoding="rgb8", frame="color_optical", size=(640, 480), count=100):
    return Stream(topic, IMAGE, count, 30.0, frame, *size, encoding)


def compressed(topic, format_="rgb8; jpeg compressed bgr8"):
    return Stream(topic, COMPRESSED, 100, 30.0, "color_optical", encoding=f"compressed: {format_}")


def info(topic, frame="color_optical", size=(640, 480)):
    return Stream(topic, CAMERA_INFO, 100, 30.0, frame, *size, "plumb_bob")


def camera(topic, encoding="rgb8", frame="color_optical", size=(640, 480), count=100):
    """Return images, and their calibration beside them."""
    return [image(topic, encoding, frame, size, count), info(f"{topic.rpartition('/')[0]}/camera_info", frame, size)]


def finder_of(streams, chosen=None, tree=None, mounting=""):
    """Return what looks for topics in a bag of these, which belong together."""
    finder = TopicFinder(SimpleNamespace(path=Path("drive")), chosen, mounting)
    finder.streams, finder.frames = list({stream.topic: stream for stream in streams}.values()), tree or TransformTree()
    finder.check_source = lambda *_: None
    return finder
