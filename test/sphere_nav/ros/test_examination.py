"""What is said of one input, by its counts."""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from sphere_nav.ros.endpoints import ERROR, OK, WARN
from sphere_nav.ros.rclpy_shell import examine_input


def wanted(**counts):
    given = {
        "num_received": 9, "num_refused": 0, "num_refused_in_row": 0, "num_lost": 0, "num_lost_lately": 0,
        "is_missing": False, "last_refusal": "too late",
    } | counts  # fmt: skip
    return SimpleNamespace(
        handle=SimpleNamespace(topic_name="/a"),
        incompatible=lambda publishers: bool(publishers),
        explain=lambda topic, publishers: f"waiting for {topic}",
        **given,
    )


def shell(publishers=()):
    said = []
    log = SimpleNamespace(warning=lambda text, every, key: said.append((text, every, key)))
    return SimpleNamespace(get_publishers_info_by_topic=lambda topic: publishers, log=log, said=said)


def test_an_input_is_judged_by_its_counts():
    for counts, publishers, level, text in [
        ({}, (), OK, "receiving"),
        ({}, ("other",), OK, "receiving"),  # what is received is compatible
        ({"num_received": 0}, (), OK, "optional, nothing received"),
        ({"num_received": 0}, ("other",), WARN, "waiting for /a"),
        ({"is_missing": True}, (), WARN, "waiting for /a"),
        ({"num_refused": 4, "num_refused_in_row": 4}, (), OK, "receiving"),
        ({"num_refused": 5, "num_refused_in_row": 5}, (), ERROR, "last 5 messages refused: too late"),
        (
            {"num_refused": 1, "num_refused_in_row": 1, "num_received": 1},
            (),
            ERROR,
            "last 1 messages refused: too late",
        ),
        ({"num_lost": 7, "num_lost_lately": 2}, (), WARN, "2 messages lost in the last second"),
    ]:
        input_, asked = wanted(**counts), shell(publishers)
        found = examine_input(asked, input_)
        assert found[:2] == (level, text)
        assert found[2] == {"received": input_.num_received, "refused": input_.num_refused, "lost": input_.num_lost}
        assert input_.num_lost_lately == 0  # told once
        assert asked.said == ([(text, 10.0, "waiting /a")] if text.startswith("waiting") else [])
