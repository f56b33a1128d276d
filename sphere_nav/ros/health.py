"""What a node says of its topics: what it lacks, what was refused or lost, and what DDS does not connect.

DDS connects nothing where one end asks for more than the other offers, and tells nobody.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, cast

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from sphere_nav.ros import qos
from sphere_nav.ros.endpoints import ERROR, OK, WARN
from sphere_nav.ros.interfaces import type_name
from sphere_nav.ros.subscription import Subscription

EXPLAIN_PERIOD = 10.0  # s between two equal explanations in the log
MAX_REFUSED = 4  # messages in a row that are refused without an alarm


def examine(shell: Any, wanted: Subscription) -> tuple[int, str, dict[str, Any]]:
    """Return level, line and counts of one input; what is missing is logged, too. `shell`: a LiveShell."""
    topic, level, text = wanted.handle.topic_name, OK, "receiving"
    is_present = wanted.num_received > 0 and not wanted.is_missing
    publishers = () if is_present else shell.get_publishers_info_by_topic(topic)
    if wanted.is_missing or wanted.incompatible(publishers):
        level, text = WARN, wanted.explain(topic, publishers)
        shell.log.warning(text, every=EXPLAIN_PERIOD, key=f"waiting {topic}")
    elif wanted.num_refused_in_row > (MAX_REFUSED if wanted.num_refused < wanted.num_received else 0):
        level, text = ERROR, f"last {wanted.num_refused_in_row} messages refused: {wanted.last_refusal}"
    elif wanted.num_lost_lately:
        level, text = WARN, f"{wanted.num_lost_lately} messages lost in the last second"
    elif not wanted.num_received:
        text = "optional, nothing received"
    wanted.num_lost_lately = 0
    return level, text, {"received": wanted.num_received, "refused": wanted.num_refused, "lost": wanted.num_lost}


def unserved(node: Node, publishers: Iterable[Publisher]) -> Iterator[str]:
    """Yield one line for each subscription that one of our publishers cannot serve."""
    for publisher in publishers:
        topic = publisher.topic_name
        if node.count_subscribers(topic) == publisher.get_subscription_count():
            continue  # all are connected
        for info in node.get_subscriptions_info_by_topic(topic):
            reason = _why_not(type_name(cast("type[Any]", publisher.msg_type)), publisher.qos_profile, info)
            if reason:
                yield f"{topic}: {info.node_namespace.rstrip('/')}/{info.node_name} gets nothing: {reason}"


def _why_not(kind: str, offered: QoSProfile, info: Any) -> str:
    if info.topic_type != kind:
        return f"it asks for {info.topic_type}, sent is {kind}"
    return qos.mismatch(offered, info.qos_profile)
