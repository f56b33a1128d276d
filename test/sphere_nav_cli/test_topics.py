"""The options that name topics."""

import argparse

import pytest

from sphere_nav_cli.topics import OPTIONS, add_options, chosen_topics, options_of


def parse(*words):
    parser = argparse.ArgumentParser()
    add_options(parser, OPTIONS, has_rig=True)
    return parser.parse_args(words)


def test_options_name_our_topics():
    words = ("--image", "/a", "--depth-info", "/b", "--camera", "front=/c", "--remap", "/imu/data:=/d")
    assert chosen_topics(parse(*words)) == {
        "image_raw": "/a",
        "depth/camera_info": "/b",
        "cameras/front/image_raw": "/c",
        "imu/data": "/d",
    }


@pytest.mark.parametrize("words", [("--camera", "front"), ("--remap", "a=b"), ("--camera", "=/a")])
def test_a_word_that_is_no_pair_is_refused(words):
    with pytest.raises(ValueError, match="expected A"):
        chosen_topics(parse(*words))


def test_what_is_told_is_what_is_understood():
    topics = {"image_raw": "/a", "camera_info": "/camera_info", "cameras/x/image_raw": "/y"}
    words = options_of(topics)
    assert "/camera_info" not in words
    assert chosen_topics(parse(*words)) == {"image_raw": "/a", "cameras/x/image_raw": "/y"}
