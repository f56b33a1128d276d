"""The first drive by clicks alone: recorded, mapped, driven again, stopped in between. A real browser, real nodes.

Pictures of every step lie in the folder of the test (`--basetemp`).
"""

import signal
import subprocess
import sys
import time

import cv2
import pytest

pytest.importorskip("viser", reason="optional: pip install viser")
pytest.importorskip("rclpy")

import rclpy
from std_msgs.msg import Bool

from sphere_nav.ros import qos
from sphere_nav_tools.cli.demo.processes import node_command
from worlds.browser import Browser, find_browser

PORT, TOKEN = "8971", "of_the_yard"
COMMAND = (sys.executable, "-c", "import sys; from sphere_nav_tools.cli.main import main; sys.exit(main(sys.argv[1:]))")
STRAIGHT = {"mode": "teach", "path": "straight", "seed": 5, "camera.period": 0.0, "clock.max_wait": 0.0}


class Operator:
    """One who sees a page, clicks, and keeps pictures; and the programs that run meanwhile."""

    def __init__(self, folder):
        self.folder, self.running, self.browser = folder, [], None

    def run(self, *words):
        """Start a program."""
        self.running.append(subprocess.Popen(words, cwd=self.folder, start_new_session=True))
        return self.running[-1]

    def end(self, process):
        """End a program in order."""
        process.send_signal(signal.SIGINT)
        process.wait(40.0)

    def wait_for(self, words, seconds=60.0):
        """Wait until something can be read, and keep a picture."""
        self.wait_until(lambda: words in self.browser.text(), words, seconds)
        name = "".join(letter if letter.isalnum() else "_" for letter in words)
        cv2.imwrite(str(self.folder / f"{len(list(self.folder.glob('*.png'))):02d}_{name}.png"), self.picture())

    def picture(self):
        return self.browser.screenshot()[..., ::-1]

    def click(self, words, kind="button"):
        """Click as soon as there is something to click at."""
        self.wait_until(lambda: self.browser.click(words, kind), words, 60.0)

    def wait_until(self, holds, what, seconds):
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, f"waited for {what!r} in vain: {self.browser.text()}"
            time.sleep(0.2)

    def close(self):
        if self.browser is not None:
            self.browser.close()
        for process in self.running:
            if process.poll() is None:
                self.end(process)


@pytest.fixture
def operator(tmp_path):
    operator = Operator(tmp_path)
    yield operator
    operator.close()


@pytest.fixture
def is_taught():
    rclpy.init()
    node, told = rclpy.create_node("watch"), []
    node.create_subscription(Bool, "taught", lambda message: told.append(message.data), qos.LATCHED)

    def look():
        rclpy.spin_once(node, timeout_sec=0.5)
        return True in told

    yield look
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.skipif(find_browser() is None, reason="no chromium here")
@pytest.mark.dds
def test_a_drive_is_taught_and_driven_again_by_clicks_alone(operator, tmp_path, is_taught):
    maps = tmp_path / "maps"
    maps.mkdir()
    operator.run(
        *COMMAND,
        "operate",
        "--folder",
        str(maps),
        "--port",
        PORT,
        "--token",
        TOKEN,
        "--record",
        "sphere odom /tf_static",
    )
    time.sleep(5.0)
    operator.browser = Browser(find_browser())
    operator.browser.call("Page.navigate", url=f"http://127.0.0.1:{PORT}/{TOKEN}")
    operator.wait_for("EMERGENCY STOP", 120.0)
    operator.click("teach", "[role=tab]")
    time.sleep(1.0)
    assert operator.browser.fill("yard")
    operator.click("record")
    operator.wait_for("recording yard")
    settings = [part for name, value in STRAIGHT.items() for part in ("-p", f"{name}:={value}")]
    car = operator.run(*node_command("cycab_sim", "--ros-args", *settings))
    operator.wait_until(is_taught, "the end of the drive", 120.0)
    operator.click("end of the drive")
    operator.wait_for("recording yard: done")
    operator.end(car)
    operator.click("make its map")
    operator.wait_for("mapping yard: done", 300.0)
    assert (maps / "yard_map").is_dir()
    words = [f"map:={maps / 'yard_map'}", f"trajectory:={maps / 'yard.tum'}", "seed:=5"]
    operator.run(*COMMAND, "up", "simulation", *words)
    operator.wait_for("TRACKING", 180.0)
    operator.click("start")
    operator.wait_for("start: DRIVING")
    time.sleep(5.0)
    operator.click("EMERGENCY STOP")
    operator.wait_for("EMERGENCY_STOP after")
    operator.click("release the emergency stop")
    operator.wait_for("released; start drives again")
    operator.click("start")
    operator.wait_for("FINISHED", 240.0)
    assert "END_OF_PATH" in operator.browser.text()
