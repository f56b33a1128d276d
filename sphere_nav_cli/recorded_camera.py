"""The images of one camera of a bag, with its calibration."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from sensor_msgs.msg import CompressedImage, Image

from node_kit import conversions
from node_kit.bag_reader import BagReader
from node_kit.conversions import camera_from_info
from node_kit.streams import read_streams
from sphere_nav_cli import topics
from sphere_nav_cli.slow_camera import patience


class RecordedCamera:
    """Found by the options of `topics.add_options`; BagError where there is none.

    `patience` is what a localiser is to be given where its images are far apart, `odometry` the topic of it, if any.
    """

    def __init__(self, path: str | Path, arguments: argparse.Namespace) -> None:
        self._path = path
        with BagReader(path) as bag:
            chosen = topics.choose_topics(bag, arguments)
            self._topics = topics.find_topics(bag, ("image_raw", "camera_info"), chosen)
            info = next(iter(bag.messages([self._topics["camera_info"]]))).message
            self.patience = patience(read_streams(bag), [self._topics["image_raw"]])
        self.camera, self.frame_id = camera_from_info(info), str(info.header.frame_id)
        self.odometry = self._topics.get("odom", "")

    def messages(self) -> Iterator[tuple[int, Image]]:
        """Yield stamp in ns and image, those that were compressed undone."""
        with BagReader(self._path) as bag:
            for item in bag.messages([self._topics["image_raw"]]):
                message = item.message
                if isinstance(message, CompressedImage):
                    message = conversions.compressed_to_image(message)
                yield conversions.stamp_ns(message), message
