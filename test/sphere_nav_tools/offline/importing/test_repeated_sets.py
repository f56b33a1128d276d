"""EuRoC, 4Seasons, OpenLORIS and ROVER in small, made as their documentation says."""

import cv2
import numpy as np

from sphere_nav.geometry import SE3, Fisheye, Pinhole
from sphere_nav.ros.conversions import camera_from_info, depth_to_meters, pose_to_se3, stamp_ns
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing.stereo import MUNICH, open_euroc

WIDTH, HEIGHT, COUNT = 32, 24, 3
START, STEP = 1_403_636_579_763_555_584, 50_000_000
STAMPS = [START + i * STEP for i in range(COUNT)]
T_BODY_LEFT = SE3.exp([0.1, 0.02, -0.03, 0.0, 0.0, 1.5])
T_LEFT_RIGHT = SE3.exp([0.11, 0.0, 0.0, 0.0, 0.01, 0.0])


def write_images(folder, names, value=0, depth=None):
    folder.mkdir(parents=True, exist_ok=True)
    for i, name in enumerate(names):
        image = (
            np.full((HEIGHT, WIDTH), value + i, np.uint8)
            if depth is None
            else np.full((HEIGHT, WIDTH), depth, np.uint16)
        )
        cv2.imwrite(str(folder / f"{name}.png"), image)


def write_lines(path, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")


def pose(i):
    return SE3.exp([1.0 + i, 2.0, 0.5, 0.0, 0.0, 0.2])


def quaternion(T, order):
    q = dict(zip("xyzw", T.quaternion, strict=True))
    return [q[name] for name in order]


def euroc(folder, model="radial-tangential"):
    for k, T in enumerate((T_BODY_LEFT, T_BODY_LEFT @ T_LEFT_RIGHT)):
        camera = folder / "mav0" / f"cam{k}"
        write_images(camera / "data", STAMPS, 10 * k)
        write_lines(camera / "data.csv", ["#timestamp [ns],filename", *(f"{s},{s}.png" for s in STAMPS)])
        numbers = ", ".join(map(str, T.matrix.ravel()))
        write_lines(camera / "sensor.yaml", [
            "#Default imu sensor yaml file", "sensor_type: camera", "T_BS:", "  cols: 4", "  rows: 4",
            f"  data: [{numbers}]", "rate_hz: 20", f"resolution: [{WIDTH}, {HEIGHT}]", "camera_model: pinhole",
            "intrinsics: [20.0, 21.0, 15.0, 11.0] #fu, fv, cu, cv", f"distortion_model: {model}",
            f"distortion_coefficients: [-0.1, 0.01, {0.001 * k}, 0.0]",
        ])  # fmt: skip
    rows = ["#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], ..."]
    for i, stamp in enumerate(STAMPS):
        T = pose(i)
        rows.append(",".join(map(str, [stamp, *T.translation, *quaternion(T, "wxyz"), 0.1, 0.2, 0.3])))
    write_lines(folder / "mav0" / "state_groundtruth_estimate0" / "data.csv", rows)
    return folder


def test_euroc(tmp_path, imported):
    topics, tree = imported("euroc", euroc(tmp_path / "MH_01_easy"))
    assert [stamp_ns(message) for message in topics["/left/image_raw"]] == STAMPS
    assert topics["/right/image_raw"][2].data[0] == 12
    left = camera_from_info(topics["/left/camera_info"][0])
    assert left == Pinhole(WIDTH, HEIGHT, 20.0, 21.0, 15.0, 11.0, (-0.1, 0.01, 0.0, 0.0, 0.0))
    assert camera_from_info(topics["/right/camera_info"][0]).distortion[2] == 0.001
    np.testing.assert_allclose(tree.lookup("left_optical", "right_optical").matrix, T_LEFT_RIGHT.matrix, atol=1e-9)
    found = pose_to_se3(topics["/ground_truth/pose"][1].pose)
    np.testing.assert_allclose(found.matrix, (pose(1) @ T_BODY_LEFT @ T_BODY_OPTICAL.inverse()).matrix, atol=1e-6)


def test_an_asl_folder_of_fisheyes_and_a_truth_with_gaps(tmp_path):
    folder = euroc(tmp_path / "room1", "equidistant")
    mav = folder / "mav0"
    (mav / "state_groundtruth_estimate0").rename(mav / "mocap0")
    rows = (mav / "mocap0" / "data.csv").read_text().splitlines()
    words = rows[2].split(",")
    write_lines(mav / "mocap0" / "data.csv", [rows[0], rows[1], ",".join([*words[:4], "0", "0", "0", "0"]), rows[3]])
    recording = open_euroc(mav)
    assert isinstance(recording.views["left"].camera, Fisheye)
    assert recording.truth == "mocap0"
    # the target was out of sight: between the rows before and after
    between = recording.instants[1].T_map_link @ T_BODY_OPTICAL
    np.testing.assert_allclose(between.translation, (pose(1) @ T_BODY_LEFT).translation, atol=1e-3)


def four_seasons(folder):
    names = ("cam0", "cam1")
    for k, name in enumerate(names):
        write_images(folder / "undistorted_images" / name, STAMPS, 10 * k)
        size = f"{WIDTH} {HEIGHT}"
        lens = ["Pinhole 20.5 20.5 15.0 11.0 0.0 0.0 0.0 0.0", size, "crop", size]
        write_lines(folder.parent / "calibration" / f"undistorted_calib_{k}.txt", lens)
    matrix = SE3.from_parts(np.eye(3), [0.3, 0.0, 0.0]).matrix
    stereo = [" ".join(map(str, row)) for row in matrix]
    write_lines(folder.parent / "calibration" / "undistorted_calib_stereo.txt", stereo)
    # one image is lost
    write_lines(folder / "times.txt", [f"{s} {s * 1e-9:.9f} 1.5" for s in [*STAMPS, START + 9 * STEP]])
    return folder


def transformations(T_e_gpsw, T_w_gpsw, T_S_AS):
    lines = []
    named = {"transform_S_AS": T_S_AS, "TS_cam_imu": T_BODY_LEFT, "transform_w_gpsw": T_w_gpsw,
             "transform_gps_imu": SE3.identity(), "transform_e_gpsw": T_e_gpsw}  # fmt: skip
    for name, T in named.items():
        values = ",".join(f"{value:.9f}" for value in [*T.translation, *quaternion(T, "xyzw")])
        lines += [f"# {name}: translation vector, rotation quaternion", values, ""]
    return [*lines, "# GNSS scale", "0.969397"]


def test_four_seasons(tmp_path, imported):
    folder = four_seasons(tmp_path / "recording_2020-03-24_17-36-22")
    latitude, longitude = np.radians(MUNICH[:2])
    up = np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    T_e_gpsw = SE3.from_parts(np.stack([east, np.cross(up, east), up], axis=1), [4_177_000.0, 855_800.0, 4_727_900.0])
    T_w_gpsw, T_S_AS = SE3.exp([0.3, -0.1, 0.2, 0.0, 0.0, 0.4]), SE3.exp([0.0, 0.0, 0.0, 0.01, 0.0, 0.0])
    write_lines(folder / "Transformations.txt", transformations(T_e_gpsw, T_w_gpsw, T_S_AS))
    rows = ["# frame_id, translation, rotation, scale, fusion_quality, v3"]
    for i in (0, 2):  # key frames alone
        T = pose(i)
        rows.append(",".join(map(str, [STAMPS[i], *(T.translation / 1.1), *quaternion(T, "xyzw"), 1.1, 0, 0])))
    write_lines(folder / "GNSSPoses.txt", rows)
    topics, tree = imported("four_seasons", folder)
    assert [stamp_ns(message) for message in topics["/left/image_raw"]] == STAMPS
    assert camera_from_info(topics["/right/camera_info"][0]) == Pinhole(WIDTH, HEIGHT, 20.5, 20.5, 15.0, 11.0)
    np.testing.assert_allclose(tree.lookup("left_optical", "right_optical").translation, [0.3, 0.0, 0.0], atol=1e-12)
    found = [pose_to_se3(message.pose) for message in topics["/ground_truth/pose"]]
    T_gpsw_body = [T_w_gpsw.inverse() @ T_S_AS @ pose(i) @ T_BODY_OPTICAL.inverse() for i in range(COUNT)]
    assert len(found) == COUNT  # the one between two key frames, too
    for i in range(COUNT):
        here, expected = found[0].inverse() @ found[i], T_gpsw_body[0].inverse() @ T_gpsw_body[i]
        np.testing.assert_allclose(here.matrix, expected.matrix, atol=1e-6)
    assert np.linalg.norm(found[0].translation) < 5_000.0  # near the middle of Munich, in metres east, north and up
    np.testing.assert_allclose(found[0].rotation, T_gpsw_body[0].rotation, atol=1e-6)


def test_openloris(tmp_path, imported):
    folder = tmp_path / "office1-1"
    seconds = [f"{1_560_000_083 + 0.1 * i:.6f}" for i in range(COUNT)]
    write_images(folder / "color", seconds)
    write_images(folder / "aligned_depth", seconds, depth=1500)
    for name, sub in (("color.txt", "color"), ("aligned_depth.txt", "aligned_depth")):
        write_lines(folder / name, [f"{s} {sub}/{s}.png" for s in seconds])
    T_base_color = SE3.from_parts(T_BODY_OPTICAL.rotation, [0.23, -0.05, 0.92])
    write_lines(folder / "sensors.yaml", [
        "%YAML:1.0", "d400_color_optical_frame:", "   sensor_type: camera", "   fps: 30", f"   width: {WIDTH}",
        f"   height: {HEIGHT}", "   model: pinhole", "   intrinsics: !!opencv-matrix", "      rows: 1", "      cols: 4",
        "      dt: d", "      data: [ 2.05e+01, 1.5e+01,", "          2.06e+01, 1.1e+01 ]",
        "   distortion_model: radial-tangential", "   distortion_coefficients: !!opencv-matrix", "      rows: 1",
        "      cols: 5", "      dt: d", "      data: [ 0., 0., 0., 0., 0. ]",
    ])  # fmt: skip
    values = ", ".join(f"{value:.12f}" for value in T_base_color.matrix.ravel())
    write_lines(folder / "trans_matrix.yaml", [
        "%YAML:1.0", "trans_matrix:", "   -", "      parent_frame: d400_color_optical_frame",
        "      child_frame: d400_depth_optical_frame", "      matrix: !!opencv-matrix", "         rows: 4",
        "         cols: 4", "         dt: d",
        "         data: [1.,0.,0.,0.015, 0.,1.,0.,0., 0.,0.,1.,0., 0.,0.,0.,1.]", "   -",
        "      parent_frame: base_link", "      child_frame: d400_color_optical_frame",
        "      matrix: !!opencv-matrix", "         rows: 4", "         cols: 4", "         dt: d",
        f"         data: [{values}]",
    ])  # fmt: skip
    rows = [" ".join(map(str, [s, *pose(i).translation, *pose(i).quaternion])) for i, s in enumerate(seconds)]
    write_lines(folder / "groundtruth.txt", ["#Time px py pz qx qy qz qw", *rows])
    topics, tree = imported("openloris", folder)
    assert camera_from_info(topics["/camera_info"][0]) == Pinhole(WIDTH, HEIGHT, 20.5, 20.6, 15.0, 11.0)
    np.testing.assert_allclose(depth_to_meters(topics["/depth/image_raw"][0]), 1.5)
    np.testing.assert_allclose(tree.lookup("base_link", "camera_optical").matrix, T_base_color.matrix, atol=1e-9)
    found = pose_to_se3(topics["/ground_truth/pose"][2].pose)
    expected = pose(2) @ T_base_color @ T_BODY_OPTICAL.inverse()  # the truth is that of the robot
    np.testing.assert_allclose(found.matrix, expected.matrix, atol=1e-6)
