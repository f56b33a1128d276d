"""What the commands that localise a recording write, count and refuse."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.localization.status import Reason, State, Status
from sphere_nav.ros.bags.recorded import BagError, Recorded
from sphere_nav.ros.conversions import pose_with_covariance_to_se3, se3_to_pose_with_covariance, status_to_message
from sphere_nav_tools.offline.localizing import give_initial_pose, usable, write_poses


def status(state, reason="", milliseconds=0.0, remedy=""):
    return Recorded(
        "/status", 0, status_to_message(Status(state, str(reason), 0, 0, remedy, milliseconds=milliseconds), 5, "map")
    )


def pose(second, x):
    return Recorded(
        "/pose", 0, se3_to_pose_with_covariance(SE3.from_planar(x, 2.0, 0.5), 1e-4 * np.eye(6), second * 10**9, "map")
    )


def arguments(folder, **values):
    return SimpleNamespace(**({"output": str(folder / "out.tum"), "json": None, "overwrite": False} | values))


NEWS = [
    status(State.SEARCHING, Reason.AMBIGUOUS, 8.0), status(State.TRACKING, "", 10.0), pose(1, 1.0),
    status(State.LOST, Reason.TIMEOUT, 99.0), status(State.TRACKING, "", 12.0), pose(2, 1.5), status(State.TRACKING),
]  # fmt: skip


def test_poses_and_figures_are_written(tmp_path, capsys):
    assert write_poses(arguments(tmp_path, json=str(tmp_path / "out.json")), iter(NEWS)) == 0
    found = read_tum(tmp_path / "out.tum")
    np.testing.assert_array_equal(found.stamps_ns, [10**9, 2 * 10**9])
    np.testing.assert_allclose(found.positions, [[1.0, 2.0, 0.0], [1.5, 2.0, 0.0]], atol=1e-6)
    assert json.loads((tmp_path / "out.json").read_text()) == {
        "images": 4,  # what is said between two images is no answer to one
        "poses": 2,
        "states": {"SEARCHING": 1, "TRACKING": 3},
        "reasons": {"AMBIGUOUS": 1},
        "milliseconds": {"median": 10.0, "p99": pytest.approx(np.percentile([8.0, 10.0, 12.0], 99))},
    }
    told = capsys.readouterr().out.splitlines()
    assert told[0] == f"4 images, 2 poses -> {tmp_path / 'out.tum'}"
    assert told[1:3] == ["states  SEARCHING 1, TRACKING 3", "reasons AMBIGUOUS 1"]
    assert told[3] == "time    median 10.0 ms, p99 12.0 ms an image"


def test_no_pose_is_a_failure(tmp_path):
    assert write_poses(arguments(tmp_path), iter(NEWS[:1])) == 1
    with pytest.raises(ValueError, match="expected poses, found none"):
        read_tum(tmp_path / "out.tum")


def test_a_file_that_is_there_is_replaced_only_when_told(tmp_path):
    for there in ["out.tum", "out.json"]:
        for file in tmp_path.iterdir():
            file.unlink()
        (tmp_path / there).write_text("mine")
        given = {"json": str(tmp_path / "out.json")}
        with pytest.raises(ValueError, match=f"{there}: expected no such file, found one: --overwrite replaces it"):
            write_poses(arguments(tmp_path, **given), iter(NEWS))
        assert (tmp_path / there).read_text() == "mine"
        assert write_poses(arguments(tmp_path, overwrite=True, **given), iter(NEWS)) == 0
        assert (tmp_path / there).read_text() != "mine"


def test_images_that_are_all_refused_are_an_error_at_the_end():
    for reason in [Reason.BAD_INFO, Reason.MAP_ERROR, Reason.BAD_STAMP, Reason.TF_STALE]:
        bad = status(State.NOT_LOCALISED, reason, remedy="calibrate")
        with pytest.raises(BagError, match="drive: every image refused: calibrate"):
            list(usable(iter([bad, bad]), "drive"))
        assert len(list(usable(iter([bad, NEWS[0], bad]), "drive"))) == 3  # one could be compared
        with pytest.raises(BagError, match="drive: no image answered"):
            list(usable(iter([pose(1, 0.0)]), "drive"))


def test_an_initial_pose_is_given_with_its_signs():
    given = []
    node = SimpleNamespace(params=SimpleNamespace(map_frame="yard"), on_initial_pose=given.append)
    T = SE3.exp([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    give_initial_pose(node, ",".join(map(str, [*T.translation, *T.quaternion])))
    assert given[0].header.frame_id == "yard"
    found, covariance = pose_with_covariance_to_se3(given[0])
    np.testing.assert_allclose(found.matrix, T.matrix, atol=1e-9)
    assert not covariance.any()
    for text in ("1,2,3", "1,2,3,0,0,0,x", "1,2,3,0,0,0,0", "1,2,3,0,0,0,1,5"):
        with pytest.raises(ValueError, match="--initial-pose: expected x,y,z,qx,qy,qz,qw"):
            give_initial_pose(node, text)


def test_a_clock_that_is_set_back_costs_no_pose(tmp_path, caplog):
    hour = 3600
    news = [pose(hour + 1, 1.0), pose(hour + 2, 2.0), pose(1, 3.0), pose(2, 4.0), pose(2, 5.0)]
    assert write_poses(arguments(tmp_path), iter(news)) == 0
    found = read_tum(tmp_path / "out.tum")
    assert (found.stamps_ns // 10**9).tolist() == [1, 2, hour + 1, hour + 2]
    np.testing.assert_allclose(found.positions[:, 0], [3.0, 5.0, 1.0, 2.0])
    assert "stamps go back 2 times" in caplog.text
