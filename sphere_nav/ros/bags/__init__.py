"""Bags: rosbag2 folders of MCAP files, written and read without rosbag2.

`BagWriter` (writer.py), `BagReader` (reader.py), `verify_bag` and `salvage` (check.py).
"""

from sphere_nav.ros.bags.check import salvage, verify_bag
from sphere_nav.ros.bags.reader import BagReader, Recorded, TopicInfo
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.writer import BagWriter

__all__ = ["BagError", "BagReader", "BagWriter", "Recorded", "TopicInfo", "salvage", "verify_bag"]
