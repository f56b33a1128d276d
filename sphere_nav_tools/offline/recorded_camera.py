"""The images of one camera of a bag, with its calibration.

Recordings with few images: a localiser must wait for the next one longer than behind a live camera.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from sphere_nav.geometry.arrays import Bytes
from sphere_nav.localization.params import InputParams
from sphere_nav.ros import conversions
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.streams import Stream
from sphere_nav.ros.conversions import camera_from_info
from sphere_nav_tools.offline.constants import SILENT_PERIODS
from sphere_nav_tools.offline.topic_finder import TopicFinder

TIMEOUT = "input.timeout_s"


def patience(streams: Sequence[Stream], images: Iterable[str]) -> dict[str, float]:
    """Return the time-out for the slowest of the topics with images, where the default is too short for it."""
    wanted, default = set(images), InputParams().timeout_s
    slowest_hz = min((s.rate_hz for s in streams if s.topic in wanted and s.count > 1), default=0.0)
    if slowest_hz <= 0.0 or SILENT_PERIODS / slowest_hz <= default:
        return {}
    timeout_s = round(SILENT_PERIODS / slowest_hz, 3)
    text = f"an image every {1.0 / slowest_hz:.2f} s: {TIMEOUT}={timeout_s:g} (else {default:g})"
    logging.getLogger("sphere_nav.slow_camera").warning(text)
    return {TIMEOUT: timeout_s}


class RecordedCamera:
    """Found by the options of `topics.add_options`; BagError where there is none.

    `patience` is what a localiser is to be given where its images are far apart, `odometry` the topic of it, if any,
    `frames` are those of the bag.
    """

    def __init__(self, path: str | Path, arguments: argparse.Namespace) -> None:
        self._path = path
        with BagReader(path) as bag:
            finder = TopicFinder.of(bag, arguments)
            self._topics = finder.odometry | finder.find(("image_raw", "camera_info")).topics
            told = next(iter(bag.messages([self._topics["camera_info"]]))).message
            info = conversions.as_rectified(
                told, is_rectified=conversions.is_rectified_topic(self._topics["image_raw"])
            )
            self.frames, self.patience = finder.frames, patience(finder.streams, [self._topics["image_raw"]])
        self.camera, self.frame_id = camera_from_info(info), str(info.header.frame_id)
        self.odometry = self._topics.get("odom", "")

    def images(self) -> Iterator[tuple[int, Bytes]]:
        """Yield stamp in ns and image (H, W) grey or (H, W, 3) RGB, raw or compressed."""
        levels = conversions.Levels()
        with BagReader(self._path) as bag:
            for _, _, message in bag.messages([self._topics["image_raw"]]):
                yield conversions.stamp_ns(message), conversions.image_to_rgb(message, levels)
