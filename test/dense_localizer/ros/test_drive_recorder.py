"""What is kept of a drive, beside the map: bounded, named at the end, and nothing where there is nothing to see."""

import errno
import os
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.inputs import CameraImage
from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.ros.drive_recorder import DriveRecorder, drives_of
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags import BagReader, BagWriter

MIN_KEY_IMAGES = 6

CAMERA = Pinhole(32, 24, 30.0, 30.0, 15.5, 11.5)
SECOND = 1_000_000_000


@pytest.fixture
def reader(tmp_path):
    (tmp_path / "campus").mkdir()
    info = SimpleNamespace(map_id="abc", header=SimpleNamespace(frame_id="map"))
    return SimpleNamespace(path=tmp_path / "campus", info=info)


def follow(recorder, number, *, ncc=0.5, camera=CAMERA, step_m=1.0):
    candidate = SimpleNamespace(is_accepted=True, is_by_map=True, ncc=ncc, choice=SimpleNamespace(region_m=1.0))
    for k in range(number):
        status = Status(State.TRACKING, stamp_ns=(k + 1) * SECOND, references=(3,))
        pose = SE3.from_planar(step_m * k, 0.0, 0.0)
        said = CameraEstimate(status, pose, np.eye(6) * 1e-6, candidate=candidate)
        recorder.see([CameraImage(np.full((24, 32), k + 1, np.uint8), camera)], said)


def record(reader, number, **values):
    said = []
    recorder = DriveRecorder(reader, said.append, is_live=False)
    follow(recorder, number, **values)
    recorder.close()
    return said


def test_a_drive_is_a_bag_beside_the_map(reader):
    (line,) = record(reader, MIN_KEY_IMAGES)
    (drive,) = drives_of(reader.path).iterdir()
    assert drive == reader.path.parent / "campus.drives" / "19700101_000001"
    told = f"{drive}: the map explained 0 of {MIN_KEY_IMAGES} key images"
    assert line == f"{told}: sphere_nav map-learn {reader.path} learns from it"
    with BagReader(drive) as bag:
        counts = {name: info.count for name, info in bag.topics.items()}
        images = [item.message.data[0] for item in bag.messages(["/image_raw"])]
        status = next(iter(bag.messages(["/status"]))).message
    names = ("/camera_info", "/camera_pose", "/explained", "/image_raw", "/status")
    assert counts == dict.fromkeys(names, MIN_KEY_IMAGES)
    assert images == list(range(1, MIN_KEY_IMAGES + 1))
    assert (status.map_id, list(status.references)) == ("abc", [3])


def test_a_vehicle_that_stands_gives_one_image_and_none_waits_for_the_disk(reader, monkeypatch):
    kept, disk = [], threading.Event()
    monkeypatch.setattr(DriveRecorder, "_write", lambda _, images, estimate: kept.append(disk.wait(10.0)))
    for is_live, step_m in ((False, 0.0), (True, 1.0)):
        (disk.clear if is_live else disk.set)()
        recorder = DriveRecorder(reader, lambda line: None, is_live=is_live)
        follow(recorder, 3, step_m=step_m)
        disk.set()
        recorder.close()
    assert kept == [True, True]


def test_the_cameras_of_a_rig_are_kept_where_each_was(reader):
    recorder = DriveRecorder(reader, lambda line: None, is_live=False)
    on_body = SE3.from_planar(0.5, 0.0, np.pi / 2)
    recorder.see = lambda images, estimate: DriveRecorder.see(
        recorder, [replace(images[0], T_body_camera=on_body, name="left")], estimate
    )
    follow(recorder, MIN_KEY_IMAGES)
    recorder.close()
    (drive,) = drives_of(reader.path).iterdir()
    with BagReader(drive) as bag:
        said = [item.message.pose for item in bag.messages(["/camera_pose"])]
    poses = [one.pose for one in said]
    assert [round(pose.position.x, 9) for pose in poses] == [k + 0.5 for k in range(MIN_KEY_IMAGES)]
    assert poses[0].orientation.z == pytest.approx(np.sqrt(0.5))
    variances = np.diag(said[0].covariance.reshape(6, 6))[:3]
    np.testing.assert_allclose(variances, [1e-6, 1.25e-6, 1.25e-6])  # by an arm of 0.5 m along x


def test_too_few_images_leave_nothing_and_the_oldest_drives_go(reader, monkeypatch):
    assert record(reader, MIN_KEY_IMAGES - 1) == []
    assert list(drives_of(reader.path).iterdir()) == []
    for second in range(2):
        record(reader, MIN_KEY_IMAGES)
        (made,) = (one for one in drives_of(reader.path).iterdir() if one.name == "19700101_000001")
        made = made.rename(made.with_name(f"{second}"))
        os.utime(made, (second, second))
    size = sum(file.stat().st_size for file in made.iterdir())
    monkeypatch.setattr("dense_localizer.ros.drive_recorder.MAX_DRIVES_MB", 2.5e-6 * size)
    record(reader, MIN_KEY_IMAGES)
    assert sorted(one.name for one in drives_of(reader.path).iterdir()) == ["1", "19700101_000001"]


def test_a_full_disk_ends_the_drive_and_nothing_else(reader, monkeypatch):
    def write(self, topic, message, stamp, **_):
        raise OSError(errno.ENOSPC, "No space left on device", str(self.partial))

    monkeypatch.setattr(BagWriter, "write", write)
    said = record(reader, 3)
    assert len(said) == 1
    assert "No space left on device" in said[0]
