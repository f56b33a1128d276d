"""Bags: rosbag2 folders of MCAP files, written and read without rosbag2.

`BagWriter` (bag_writer.py), `BagReader` (bag_reader.py), `verify_bag` and `salvage` (bag_check.py).
"""

from node_kit.bag_check import BagReport, salvage, verify_bag
from node_kit.bag_error import BagError
from node_kit.bag_reader import BagReader, Recorded, TopicInfo
from node_kit.bag_writer import BagWriter

__all__ = ["BagError", "BagReader", "BagReport", "BagWriter", "Recorded", "TopicInfo", "salvage", "verify_bag"]
