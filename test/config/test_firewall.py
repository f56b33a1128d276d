"""Who is outside the vehicle reaches its nodes, whatever the discovery range, until the firewall rule is there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from sphere_nav.ros.shared_files import share_file
from sphere_nav_tools.cli.processes import node_command

PATIENCE, SILENCE = 60, 10  # s of a loaded machine; s without an answer
ALONE = ("unshare", "--mount", "sh", "-c", 'mount -t tmpfs none /dev/shm && exec "$@"', "sh")  # with memory of its own
WITHIN = ("ip", "netns", "exec")
ANSWER = "no path is loaded"
ASK = """
import sys, time, rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("stranger")
client = node.create_client(Trigger, "path_follower/start")
if client.wait_for_service(timeout_sec=float(sys.argv[1])):
    answer = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, answer, timeout_sec=float(sys.argv[1]))
    print(answer.result())
"""


def ip(*words: str) -> str:
    return subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=PATIENCE).stdout


@pytest.fixture
def computers() -> Iterator[tuple[str, str]]:
    """Names of two network namespaces that are joined by a cable: 10.77.0.1, the vehicle, and 10.77.0.2."""
    names = f"vehicle{os.getpid()}", f"stranger{os.getpid()}"
    if os.geteuid() or not (shutil.which("ip") and shutil.which("nft")):
        pytest.skip("two networks need root, ip (iproute2) and nft (nftables)")
    try:
        for name in names:
            ip("netns", "add", name)
        ip("link", "add", "eth0", "netns", names[0], "type", "veth", "peer", "name", "eth0", "netns", names[1])
        for number, name in enumerate(names, 1):
            ip("-n", name, "addr", "add", f"10.77.0.{number}/24", "dev", "eth0")
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", "eth0", "up")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"this machine gives no network namespaces: {error.stderr.strip()}")
    for name in names:
        while " UP " not in ip("-n", name, "-br", "link", "show", "eth0"):  # DDS looks once which interfaces there are
            time.sleep(0.05)
    yield names
    for name in names:
        ip("netns", "delete", name)


def start_by(words: list[str], seconds: int) -> str:
    """Return what the follower answers to somebody who names the vehicle's address; empty: nothing."""
    environment = os.environ | {"ROS_STATIC_PEERS": "10.77.0.1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    words = [*words, sys.executable, "-c", ASK, str(seconds)]
    return subprocess.run(words, env=environment, capture_output=True, text=True, timeout=3 * PATIENCE).stdout


@pytest.mark.slow
@pytest.mark.dds
def test_a_stranger_reaches_a_follower_until_the_rule_is_there(computers: tuple[str, str]) -> None:
    vehicle, stranger = computers
    first = 7400 + 250 * int(os.environ["ROS_DOMAIN_ID"])
    rule = share_file("config/firewall.nft").read_text().replace("7400-7649", f"{first}-{first + 249}")
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"  # which keeps nobody out
    follower = subprocess.Popen([*WITHIN, vehicle, *ALONE, *node_command("path_follower")], stderr=subprocess.DEVNULL)
    outside, inside = [*WITHIN, stranger, *ALONE], ["nsenter", "--mount", "--net", "--target", str(follower.pid)]
    try:
        assert ANSWER in start_by(outside, PATIENCE)
        give(vehicle, rule)
        assert start_by(outside, SILENCE) == ""
        assert ANSWER in start_by(inside, PATIENCE)  # it goes on for who is inside
        give(vehicle, rule.replace("{ lo }", "{ lo, eth0 }"))
        assert ANSWER in start_by(outside, PATIENCE)  # who is not a stranger now
    finally:
        follower.terminate()
        follower.wait(PATIENCE)


def give(computer: str, rule: str) -> None:
    subprocess.run([*WITHIN, computer, "nft", "-f", "-"], input=rule, text=True, check=True)
