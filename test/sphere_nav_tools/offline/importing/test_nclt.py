"""A session of NCLT in small, made as its documentation says."""

import cv2
import numpy as np

from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.ros.conversions import camera_from_info, image_to_array, message_to_cloud, pose_to_se3
from sphere_nav_tools.offline.importing.nclt import open_nclt

WIDTH, HEIGHT = 96, 72
STAMPS_US = [1_326_030_975_726_043 + 200_000 * i for i in range(3)]
K = np.array([[24.0, 0.0, 50.0], [0.0, 25.0, 36.0], [0.0, 0.0, 1.0]])
POSES = {  # of the cameras in the Ladybug, as the set's files have them: m, deg
    5: (0.041862, -0.001905, -0.000212, 160.868615, 89.914152, 160.619894),
    0: (0.0, 0.0, 0.06, 0.0, 0.0, 0.0),
}


def table(path, rows, separator=","):
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, np.atleast_2d(rows), delimiter=separator, fmt="%.9f")


def session(folder):
    """Make a session: two cameras, a lens that shifts by two columns and one row, a cloud, and a true drive ahead."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    for number, pose in POSES.items():
        images = folder / "lb3" / f"Cam{number}"
        images.mkdir(parents=True)
        for i, stamp in enumerate(STAMPS_US):
            cv2.imwrite(
                str(images / f"{stamp}.tiff"), np.dstack([columns + i, rows, 0 * rows + number]).astype(np.uint8)
            )
        table(folder.parent / "cam_params" / f"K_cam{number}.csv", K)
        table(folder.parent / "cam_params" / f"x_lb3_c{number}.csv", pose)
        lines = np.stack([rows, columns, rows + 1.0, columns + 2.0], axis=-1).reshape(-1, 4)
        name = folder.parent / "U2D" / f"U2D_Cam{number}_1616X1232.txt"
        table(name, lines, " ")
        name.write_text(f"width/cols = {WIDTH} , height/rows = {HEIGHT}\n" + name.read_text())
    cloud = np.zeros(2, [("place", "<u2", 3), ("intensity", "u1"), ("laser", "u1")])
    cloud["place"] = np.round((np.array([[5.0, 1.0, -0.5], [10.0, -2.0, 0.0]]) + 100.0) / 0.005)
    (folder / "velodyne_sync").mkdir()
    (folder / "velodyne_sync" / f"{STAMPS_US[1]}.bin").write_bytes(cloud.tobytes())
    truth = [
        [s - 50_000 + 100_000 * j, 3.0 + i, 4.0, -0.5, 0.0, 0.0, np.pi / 2]
        for i, s in enumerate(STAMPS_US)
        for j in (0, 1)
    ]
    truth = [[STAMPS_US[0] - 90_000, *[np.nan] * 6], *truth]  # the first rows of the set's files have no pose
    path = folder / f"groundtruth_{folder.name}.csv"
    path.write_text("\n".join(",".join([str(row[0]), *map(str, row[1:])]) for row in truth) + "\n")
    return folder


def test_a_session(tmp_path):
    recording = open_nclt(session(tmp_path / "2012-01-08"))
    assert [instant.stamp_ns for instant in recording.instants] == [1000 * stamp for stamp in STAMPS_US]
    assert [list(instant.others) for instant in recording.instants] == [[], ["points"], []]
    topics = dict(recording.frame(1))
    image, lens = topics["cameras/cam5/image_raw"], topics["cameras/cam5/camera_info"]
    assert (camera_from_info(lens).fx, camera_from_info(lens).fy) == (24.0, 25.0)
    assert lens.header.frame_id == image.header.frame_id == "cam5_optical"
    assert image_to_array(image)[10, 20].tolist() == [20 + 2 + 1, 10 + 1, 5]  # column + 2, row + 1 of image 1
    assert not image_to_array(image)[:, WIDTH - 1].any()  # what the lens does not see
    np.testing.assert_allclose(message_to_cloud(topics["points"]), [[5.0, -1.0, 0.5], [10.0, 2.0, 0.0]], atol=1e-4)
    # north, east, down and a heading of 90 deg: looks east, which is -y of a world of x north, y west, z up
    T_map_base = pose_to_se3(topics["ground_truth/odometry"].pose.pose)
    expected = SE3.from_parts(so3.exp([0.0, 0.0, -np.pi / 2]), [4.0, -4.0, 0.5])
    np.testing.assert_allclose(T_map_base.matrix, expected.matrix, atol=1e-6)


def test_a_rig_of_nclt_looks_ahead_and_up(tmp_path):
    open_nclt(session(tmp_path / "2012-01-08")).write_beside(tmp_path)
    rig = read_rig(tmp_path / "rig.yaml")
    assert rig.names == ("cam5", "cam0")
    ahead = rig.camera("cam5").T_rig_camera
    np.testing.assert_allclose(ahead.rotation[:, 2], [1.0, 0.0, 0.0], atol=0.02)
    np.testing.assert_allclose(ahead.rotation[:, 0], [0.0, 0.0, -1.0], atol=0.02)  # on its side: columns go down
    np.testing.assert_allclose(ahead.translation, [0.0768, -0.0043, 1.2296], atol=5e-4)
    up = rig.camera("cam0").T_rig_camera  # turned as the Ladybug is on the body
    np.testing.assert_allclose(up.rotation[:, 2], np.radians([0.23, -0.07, 90.0]) / [1, 1, np.pi / 2], atol=1e-4)
    np.testing.assert_allclose(up.rotation[:, 0], [1.0, -np.radians(0.5), -np.radians(0.23)], atol=1e-4)
    np.testing.assert_allclose(up.translation, [0.0352, -0.0021, 1.29], atol=1e-4)
    mask = cv2.imread(rig.camera("cam5").mask, cv2.IMREAD_GRAYSCALE)
    assert mask.shape == (HEIGHT, WIDTH)
    np.testing.assert_array_equal(np.argwhere(mask == 255).max(axis=0), [HEIGHT - 17, WIDTH - 18])  # 15 px less
