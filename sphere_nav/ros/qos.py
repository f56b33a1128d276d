"""The quality-of-service profiles of our topics by purpose, and QoS in words and as rosbag2's YAML."""

from __future__ import annotations

import re
from typing import Any

import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPresetProfiles, QoSProfile, ReliabilityPolicy

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
VOLATILE, TRANSIENT_LOCAL = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL

SENSOR: QoSProfile = QoSPresetProfiles.SENSOR_DATA.value  # 5 messages, best effort, volatile
"""Camera, laser, IMU, odometry inputs: matches every publisher."""

STATE: QoSProfile = QoSPresetProfiles.DEFAULT.value  # 10 messages, reliable, volatile
"""Poses, status, paths and other small outputs; also what drivers call 'system default'."""

LATCHED = QoSProfile(depth=1, reliability=RELIABLE, durability=TRANSIENT_LOCAL)
"""The last value holds, also for those who join later: graph, map cloud, map info, tf_static."""

LARGE = QoSProfile(depth=4, reliability=RELIABLE, durability=VOLATILE)
"""Messages above 64 KB: best effort loses whole samples as soon as one fragment is lost."""

DEEP = QoSProfile(depth=1000, reliability=RELIABLE, durability=VOLATILE)
"""Where a slow computer must lose nothing."""

COMMAND = QoSProfile(depth=1, reliability=RELIABLE, durability=VOLATILE)
"""cmd_vel and its kin: only the newest counts."""

TF = QoSProfile(depth=100, reliability=RELIABLE, durability=VOLATILE)
TF_STATIC = QoSProfile(depth=100, reliability=RELIABLE, durability=TRANSIENT_LOCAL)

LATCHED_TEXT = re.compile(r"\bdurability: *(transient_local|1)\b")  # a name (version 9), or a number (older)
INFINITE = {"sec": 9223372036, "nsec": 854775807}


def describe_policies(profile: QoSProfile) -> str:
    """Return the policies that decide about compatibility, in words."""
    words = [profile.reliability.name, profile.durability.name]
    text = ", ".join(word.lower().replace("_", " ") for word in words)
    return f"{text}, depth {profile.depth}" if profile.depth else text


def mismatch(offered: QoSProfile, asked: QoSProfile) -> str:
    """Return why a publisher cannot serve a subscription, in words; empty where it can."""
    if asked.reliability == RELIABLE and offered.reliability == BEST_EFFORT:
        return "it offers best effort, asked is reliable"
    if asked.durability == TRANSIENT_LOCAL and offered.durability == VOLATILE:
        return "it offers volatile, asked is transient local"
    return ""


def adapted(offers: list[QoSProfile], depth: int) -> QoSProfile:
    """Return a subscription profile that every one of the publishers can serve, as strict as they allow."""
    is_reliable = bool(offers) and all(offer.reliability != BEST_EFFORT for offer in offers)
    is_latched = bool(offers) and all(offer.durability == TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=depth,
        reliability=RELIABLE if is_reliable else BEST_EFFORT,
        durability=TRANSIENT_LOCAL if is_latched else VOLATILE,
    )


def to_entry(profile: QoSProfile) -> dict[str, Any]:
    """Return a profile as rosbag2 writes it in metadata version 9."""
    return {
        "history": "keep_all" if profile.history == HistoryPolicy.KEEP_ALL else "keep_last",
        "depth": int(profile.depth),
        "reliability": "best_effort" if profile.reliability == BEST_EFFORT else "reliable",
        "durability": "transient_local" if profile.durability == TRANSIENT_LOCAL else "volatile",
        "deadline": dict(INFINITE),
        "lifespan": dict(INFINITE),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(INFINITE),
        "avoid_ros_namespace_conventions": False,
    }


def to_yaml(profile: QoSProfile) -> str:
    """Return a profile as the text of a channel's `offered_qos_profiles`."""
    return yaml.safe_dump([to_entry(profile)], sort_keys=False).strip()


def from_yaml(text: str) -> QoSProfile:
    """Return how a topic was offered, as far as it matters: whether its last message holds for who comes later."""
    return LATCHED if LATCHED_TEXT.search(text) else STATE
