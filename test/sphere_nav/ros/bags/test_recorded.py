"""Stored bytes depend on the message alone."""

import os
import subprocess
import sys

import numpy as np
import pytest
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_nav.ros.bags.recorded import BagError, serialize_to_store, view_message

# glibc fills every new piece of memory with this byte, so that what a serializer leaves untouched shows.
PROGRAM = """
import sys
from sphere_nav_msgs.msg import AugmentedSphere
from sphere_nav.ros.bags.recorded import serialize_to_store
message = AugmentedSphere()
message.header.frame_id = "odd"
print(serialize_to_store(message).hex())
"""


@pytest.mark.dds
def test_stored_bytes_do_not_depend_on_the_memory_before():
    command = [sys.executable, "-c", PROGRAM]
    variables = [{**os.environ, "MALLOC_PERTURB_": filling} for filling in ("1", "170")]
    runs = [subprocess.run(command, env=one, capture_output=True, check=True, timeout=60) for one in variables]
    assert len(runs[0].stdout) > 100
    assert runs[0].stdout == runs[1].stdout


def test_a_view_has_the_fields_of_the_message_and_copies_nothing_large():
    message = AugmentedSphere(id=7, image_encoding="mono8", image=list(range(200)), range=[1, 2, 3])
    message.header.frame_id, message.header.stamp.sec, message.info.full_width = "odd", 5, 2048.0
    data = serialize_to_store(message)
    found = view_message(memoryview(data), AugmentedSphere, "map")
    assert (found.id, found.image_encoding, found.header.frame_id, found.header.stamp.sec) == (7, "mono8", "odd", 5)
    assert found.info.full_width == 2048.0
    assert bytes(found.image) == bytes(range(200))
    assert bytes(found.range) == b"\1\2\3"
    assert np.shares_memory(found.image, np.frombuffer(data, np.uint8))


def test_bytes_that_are_no_message_are_refused_cut_anywhere():
    data = serialize_to_store(AugmentedSphere(image=[1] * 20))
    for size in range(len(data) - 8):
        with pytest.raises(BagError, match="map: expected sphere_nav_msgs/msg/AugmentedSphere, found"):
            view_message(memoryview(data[:size]), AugmentedSphere, "map")
