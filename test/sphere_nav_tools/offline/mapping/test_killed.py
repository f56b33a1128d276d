"""Whatever ends `sphere_nav map`, what is mapped is a map once `map-verify --salvage` gave it an index."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import pytest

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.maps.writer import MapWriter
from sphere_nav_tools.cli.main import main
from worlds.room import wide_room

pytestmark = pytest.mark.dds

CAMERA = Spherical(128, 64)
NUM_SPHERES = 6
LOST = 3  # key spheres since the last graph, at most
SETTINGS = ("--set", "mapper.key.max_parallax_whole=0.05", "--experience", "dusk")  # all become key spheres
# A process makes one run after the other, each to the end that it is told: what is to be killed, in a fork that has all
# that the first one loaded. An end is (end, number of the call of MapWriter.add, or of finish, at which it comes).
RUNS = """
import json, os, resource, signal, sys
from sphere_nav_tools.cli.main import main
from sphere_nav.ros.maps.writer import MapWriter

calls = {"add": 0, "finish": 0}

def counted(name, limit):
    method = getattr(MapWriter, name)
    def call(self, *words, **named):
        done = method(self, *words, **named)
        calls[name] += 1
        if calls[name] == limit:
            os.kill(os.getpid(), signal.SIGKILL)
        return done
    setattr(MapWriter, name, call)

for line in sys.stdin:
    name, limit, words = json.loads(line)
    if name == "full":
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        status = main(words)
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    else:
        pid = os.fork()
        if pid == 0:
            try:
                counted(name, limit)
                main(words)
            finally:
                os._exit(1)
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    print("ended", status, flush=True)
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    room, path = wide_room(), tmp_path_factory.mktemp("remains") / "bag"
    with BagWriter(path, chunk_size=1) as writer:  # a chunk for each message
        for number in range(NUM_SPHERES):
            stamp_ns = 1_000_000_000 * (number + 1)
            sphere = room.sphere(SE3.from_planar(-0.8 + 0.3 * number, 0.1, 0.05 * number), CAMERA, 1)
            message = sphere_to_message(replace(sphere, stamp_ns=stamp_ns), "base_link")
            writer.write("sphere", message, stamp_ns)
    return path


def call(command, *words):
    return main([command, *map(str, words), *(SETTINGS if command == "map" else ())])


def test_killed_or_out_of_disk_it_leaves_a_map(bag, tmp_path):
    """With a limit of the size of files; while the drive is mapped; when it is mapped, but not the map."""
    ends = [("full", 70_000, 1, 1, ".partial"), ("add", 5, -9, 5, ".partial"), ("finish", 1, -9, 6, "")]
    outputs = [tmp_path / f"map_{number}" for number in range(len(ends))]
    lines = [
        json.dumps([*end[:2], ["map", str(bag), "-o", str(path), *SETTINGS]]) + "\n"
        for end, path in zip(ends, outputs, strict=True)
    ]
    runs = [sys.executable, "-c", RUNS]
    done = subprocess.run(runs, input="".join(lines), capture_output=True, text=True, timeout=240, check=True)
    ended = [line for line in done.stdout.splitlines() if line.startswith("ended ")]
    assert ended == [f"ended {end[2]}" for end in ends], done.stderr
    told = next(line for line in done.stderr.splitlines() if "key spheres stay" in line)
    assert "File too large" in told
    assert told.endswith(f"stay: sphere_nav map-verify {outputs[0]}.drive.partial --salvage OUT")
    for end, path in zip(ends, outputs, strict=True):
        left = f"{path}.drive{end[4]}"
        assert call("map-verify", left, "--salvage", tmp_path / "mended") == 0
        assert call("map-verify", tmp_path / "mended") == 0
        with open_map(tmp_path / "mended") as reader:
            assert len(reader.graph) >= end[3] - LOST
            assert len(reader.graph.edges) >= len(reader.graph) - 1
        shutil.rmtree(tmp_path / "mended")


def test_interrupted_it_says_what_stays(bag, tmp_path, monkeypatch, capsys):
    add, added = MapWriter.add, []

    def interrupted(self, *words):
        add(self, *words)
        added.append(words)
        if len(added) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(MapWriter, "add", interrupted)
    assert call("map", bag, "-o", tmp_path / "map") == 130
    remains = tmp_path / "map.drive.partial"
    command = f"sphere_nav map-verify {remains} --salvage"
    assert f"sphere_nav map: interrupted; 2 key spheres stay: {command} OUT" in capsys.readouterr().err
    monkeypatch.undo()
    assert call("map", bag, "-o", tmp_path / "map") == 2  # it is not overwritten
    assert f"{remains}: " in capsys.readouterr().err


def test_where_nothing_can_be_written_nothing_is_left(bag, tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(MapWriter, "add", full)
    assert call("map", bag, "-o", tmp_path / "map") == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
