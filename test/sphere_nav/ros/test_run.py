"""A node as a process: exit status, one line for what is wrong, and an orderly end within two seconds."""

import platform
import signal
import subprocess
import sys
import time

import pytest

from sphere_nav.ros.shared_files import share_file

pytestmark = pytest.mark.dds

PATIENCE = 30.0  # s until a process has started on a busy machine
LIMIT = 2.0  # s from the signal to the end of the process

NODE = """
import os, sys, time
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.run import run
from sphere_nav.params import param, parameters

@parameters
class Params:
    nap: float = param(0.0, "time a callback takes", "s", low=0.0)
    file: str = param("good", "file to open")
    is_done: bool = param(False, "end at once")

class Napper(ManagedNode):
    NAME = "napper"
    PARAMS = Params
    LARGE_MESSAGES = True

    def configure(self):
        if self.params.file != "good":
            raise ValueError(f"{self.params.file}: field x: expected 1, found 2")
        self.add_timer(0.01, self.tick, is_wall=True)
        self.is_told = False

    def tick(self):
        if not self.is_told:
            self.is_told = True
            print("ready", os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE"), flush=True)
        if self.params.is_done:
            self.endpoints.finish(0)
        time.sleep(self.params.nap)

    def cleanup(self):
        print("clean", flush=True)

sys.exit(run(Napper))
"""


@pytest.fixture
def start(tmp_path, spawn):
    (tmp_path / "napper.py").write_text(NODE)

    def begin(*values, enclave=""):
        words = [word for value in values for word in ("-p", value)] + ["--enclave", enclave] * bool(enclave)
        command = [sys.executable, str(tmp_path / "napper.py"), *(["--ros-args", *words] if words else [])]
        return spawn(command, stdout=subprocess.PIPE)

    return begin


def test_a_signal_ends_a_node_in_order(start):
    process = start()
    assert any("fastdds_large.xml" in line for line in process.stdout)  # DDS may complain of others first
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE)
    assert time.monotonic() - began < LIMIT
    assert process.returncode == 0
    assert out == "clean\n"
    assert "Traceback" not in err


def test_a_busy_callback_does_not_hold_up_the_end(start):
    process = start("nap:=60.0")
    process.stdout.readline()
    began = time.monotonic()
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=PATIENCE)
    assert time.monotonic() - began < 30.0  # half of the nap, also on a busy machine
    assert process.returncode == 0
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("value", "line"),
    [
        ("nap:=-1.0", "napper: nap: expected at least 0.0, found -1.0"),
        ("file:=rig.yaml", "cannot start: rig.yaml: field x: expected 1, found 2"),
    ],
)
def test_what_cannot_start_says_why_in_one_line(start, value, line):
    process = start(value)
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.strip().endswith(line)


def test_the_users_profile_is_kept(start, monkeypatch, tmp_path):
    profile = share_file("config/fastdds_large.xml")
    mine = tmp_path / "mine.xml"
    mine.write_text(profile.read_text())
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(mine))
    process = start("is_done:=true")
    out, _ = process.communicate(timeout=PATIENCE)
    assert out.startswith(f"ready {mine}")


# --- SROS2: the files of an enclave, as `ros2 security create_enclave` names them
FILES = ["identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"]


@pytest.mark.parametrize("names", [FILES[:3], FILES], ids=["half of them", "no keys in them"])
def test_enforced_security_is_never_left_out_and_the_reason_is_one_line(start, monkeypatch, tmp_path, names):
    enclave = tmp_path / "keystore" / "enclaves" / "vehicle"
    enclave.mkdir(parents=True)
    for name in names:
        (enclave / name).write_text("no key")
    for name, value in {"KEYSTORE": str(tmp_path / "keystore"), "ENABLE": "true", "STRATEGY": "Enforce"}.items():
        monkeypatch.setenv(f"ROS_SECURITY_{name}", value)
    process = start("is_done:=true", enclave="/vehicle")
    out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out) == (2, "")
    assert "Traceback" not in err
    assert "napper: cannot start: " in err.splitlines()[-1]
    assert "secur" in err.splitlines()[-1].lower()


# --- memory
MEMORY = """
import numpy as np
from sphere_nav.ros.run import return_large_blocks

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

return_large_blocks()
del_first = np.ones(20_000_000)  # 160 MB, freed: by itself glibc now keeps blocks of up to 32 MB
del del_first
before, kept = resident_mb(), []
for _ in range(20):
    large = np.ones(1_000_000)
    kept.append(np.ones(1_000))  # lies behind it
    del large
    kept.append(np.ones(1_500_000)[:1].copy())
print(resident_mb() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="what other C libraries do is theirs")
def test_what_is_freed_leaves_the_process():
    done = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 8.0
