"""The whole chain on a drawn street: map, localise from colour alone, evaluate; offline, twice, and over DDS."""

import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros.bags import BagReader
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.evaluation import read_poses

from .conftest import PERIOD, SECOND, STREET, Frames, write_bag

pytestmark = pytest.mark.dds

NUM_FRAMES = 16
START_UP = 90.0  # s: imports and, on a fresh machine, kernels to compile
REPLAY = 60.0  # s: a dozen small images


def poses():
    """A drive of 1.5 m along a street, 0.1 m and 0.3 degrees an image."""
    return [SE3.exp([10.0 + 0.1 * i, 0.02 * i, 1.6, 0.0, 0.0, 0.005 * i]) for i in range(NUM_FRAMES)]


def drive(street, frames: Frames):
    messages = [frames.mount(SECOND)]
    for i, T_map_base in enumerate(poses()):
        stamp = SECOND + i * PERIOD
        pixels, depth_m = street(T_map_base)
        messages += [frames.truth(T_map_base, stamp), frames.info(stamp)]
        messages += [frames.depth(depth_m, stamp), frames.image(pixels, stamp)]
    return messages


@pytest.fixture(scope="session")
def chain(street, tmp_path_factory):
    """Folder with both recordings, the map and the poses of the second recording."""
    folder, messages = tmp_path_factory.mktemp("chain"), drive(street, Frames(STREET))
    write_bag(folder / "taught", messages)
    write_bag(folder / "driven", [item for item in messages if item[0] != "/depth/image_raw"])
    assert main(["map", str(folder / "taught"), "-o", str(folder / "map"), "--anchor", "truth"]) == 0
    assert localize(folder, "poses.tum") == 0
    return folder


def localize(folder: Path, name: str) -> int:
    return main(["localize", str(folder / "map"), str(folder / "driven"), "-o", str(folder / name)])


def test_poses_are_near_the_truth(chain, capsys):
    words = ["evaluate", str(chain / "poses.tum"), str(chain / "driven"), "--json", str(chain / "errors.json")]
    assert main(words) == 0
    errors = json.loads((chain / "errors.json").read_text())
    # all but the images of the probation at the start
    assert errors["coverage"] >= 0.6
    # a pixel is 4 mrad: a tenth of it at 10 m is 4 mm; the map adds its own drift over 1.5 m, 1 % at most
    assert errors["translation_m"]["median"] < 0.02
    assert errors["translation_m"]["max"] < 0.05
    # a quarter of a pixel
    assert errors["rotation_deg"]["median"] < 0.06


def test_localising_twice_gives_the_same_bits(chain):
    assert localize(chain, "again.tum") == 0
    assert (chain / "again.tum").read_bytes() == (chain / "poses.tum").read_bytes()


@pytest.fixture
def processes(spawn):
    def start(code: str, *words: object) -> subprocess.Popen:
        line = [sys.executable, "-c", f"import sys; {code}", *map(str, words)]
        return spawn(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    return start


def wait_until_said(process: subprocess.Popen, texts: list[str]) -> None:
    """Read what a node logs until every text was in it; a node that ends or is silent for too long fails the test."""
    timer = threading.Timer(START_UP, process.kill)
    timer.start()
    said = ""
    for line in process.stdout:
        said += line
        if all(text in said for text in texts):
            break
    timer.cancel()
    assert all(text in said for text in texts), said


def stopped(process: subprocess.Popen) -> str:
    """Ask a node to end, and return what it said; it must end well."""
    process.terminate()
    said, _ = process.communicate(timeout=600.0)
    assert process.returncode == 0, said
    return said


def test_nodes_over_dds_give_the_same_poses(chain, processes, tmp_path):
    node = "from dense_localizer.ros.node import main; sys.exit(main())"
    command = "from sphere_nav_tools.cli.main import main; sys.exit(main())"
    live = tmp_path / "live"
    recorder = processes(command, "record", "-o", live, "/pose", "/status", "--use-sim-time")
    settings = (f"map:={chain / 'map'}", "use_sim_time:=true", "every_image:=true")
    localizer = processes(node, "--ros-args", *(word for setting in settings for word in ("-p", setting)))
    wait_until_said(recorder, ["/pose: recording", "/status: recording"])
    player = processes(command, "play", chain / "driven", "--clock", "--rate", 0, "--wait-for", "/image_raw")
    said, _ = player.communicate(timeout=START_UP + REPLAY)
    assert player.returncode == 0, said
    time.sleep(3.0)  # the last small messages reach the recorder with the next heartbeat
    said = stopped(localizer) + stopped(recorder)
    with BagReader(live) as bag:
        answers = [m for _, _, m in bag.messages(["/status"]) if m.reason != m.TIMEOUT]  # the clock stands at the end
        assert len(answers) == NUM_FRAMES, said
    offline, online = read_tum(chain / "poses.tum"), read_poses(live, ("/pose",))
    np.testing.assert_array_equal(online.stamps_ns, offline.stamps_ns)
    # the same callbacks on the same bytes; the file has nine decimals
    moved, turned = online.T_map_body.distance(offline.T_map_body)
    assert np.max(moved) < 1e-3
    assert np.max(turned) < 1e-4
