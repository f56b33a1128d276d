"""What commands do with their words and figures, without bags and maps."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from rig_calibration.drive.drive_lens import Lens
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.spheres.experiences import Service, with_experience, with_service
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.cli import refine_camera
from sphere_nav_tools.cli.maps import map_export, map_info
from sphere_nav_tools.offline.tables import facts_as_lines

SECOND = 10**9
CAMERA = Pinhole(64, 48, 50.0, 51.0, 31.0, 23.0, (0.1, 0.2, 0.3, 0.4))


def sphere_map(tmp_path, length=0.0):
    """A map whose key spheres are not in the order of their stamps."""
    poses = [SE3.from_planar(x, 0.5 * x, 0.0) for x in (0.0, 1.0, 4.0)]
    radii = (0.0, 2.0, 6.0)
    nodes = [KeySphere(k, (10 - k) * SECOND, T, region_radius_m=radii[k]) for k, T in enumerate(poses)]
    edges = [Edge(0, 1, SE3.from_planar(1.0, 0.5, 0.0), np.eye(6)), Edge(1, 2, SE3.identity(), np.eye(6), is_loop=True)]
    graph = SphereGraph(nodes, edges)
    range_m = np.full((64, 128), 2.0, np.float32)
    range_m[:16] = np.nan
    sphere = Sphere(np.full((64, 128), 9, np.uint8), range_m, Spherical(128, 64))
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "a").write_bytes(bytes(3_000_000))
    texts = {"map_id": "id", "software": "s", "source": "drive", "rig": "r", "format_version": 2}
    info = SimpleNamespace(header=SimpleNamespace(frame_id="map"), length=length, **texts)
    return SimpleNamespace(
        graph=graph, info=info, origin="", path=tmp_path / "map", load_sphere=lambda sphere_id: sphere
    )


def test_a_map_is_as_large_dense_and_long_as_it_is_told(tmp_path):
    found = map_info.map_facts(sphere_map(tmp_path, length=12.0))
    assert found["megabytes"] == 3.0
    assert (found["key_spheres"], found["edges"], found["loops"], found["rig"]) == (3, 2, 1, True)
    assert found["extent_m"] == [4.0, 2.0, 0.0]
    assert found["region_radius_m"] == 2.0
    assert (found["first_stamp_s"], found["last_stamp_s"]) == (10.0, 8.0)
    assert (found["measured_share"], found["sphere_size"], found["whole_sphere"]) == (0.75, [128, 64], True)


def test_an_experience_counts_its_key_spheres_and_the_images_it_served(tmp_path):
    reader = sphere_map(tmp_path)
    night = Experience("night", "rgbd 64 x 48", "drive_2", 7_500_000_000)
    wide = reader.graph.with_nodes({2: {"region_radius_m": 7.0}})
    served = {0: Service(8, 20 * SECOND + SECOND // 4), 1: Service(3, 12 * SECOND)}
    reader.graph = with_service(with_experience(wide, night, [0, 1]), served)
    found = map_info.map_facts(reader)
    assert found["places_by_experiences"] == {"1": 2, "2": 1}  # a night's is 3.4 m, of 3.5 m, from the last
    second, first = found["experiences"]  # in the order of the key spheres
    assert first["last_served_s"] is None
    assert (first["name"], first["drive"], first["key_spheres"], first["images_served"]) == ("", "", 1, 0.0)
    assert second == {
        "name": "night", "drive": "drive_2", "camera": "rgbd 64 x 48", "first_stamp_s": 7.5, "key_spheres": 2,
        "images_served": 11.0, "last_served_s": 20.25,
    }  # fmt: skip


def test_trajectories_are_exported_by_stamp(tmp_path):
    reader = sphere_map(tmp_path)
    assert map_export.write_trajectory(reader, tmp_path / "a.tum", None) == "3 poses"
    found = read_tum(tmp_path / "a.tum")
    np.testing.assert_array_equal(found.stamps_ns, np.array([8, 9, 10]) * SECOND)
    np.testing.assert_allclose(found.positions[:, 0], [4.0, 1.0, 0.0])
    assert map_export.write_graph(reader, tmp_path / "a.g2o", None) == "3 vertices, 2 edges"
    lines = (tmp_path / "a.g2o").read_text().splitlines()
    assert [line.split()[:2] for line in lines[:3]] == [["VERTEX_SE3:QUAT", str(k)] for k in range(3)]
    assert lines[3].split()[:6] == ["EDGE_SE3:QUAT", "0", "1", "1", "0.5", "0"]
    with pytest.raises(ValueError, match=r"\.geojson: expected --datum"):
        map_export.write_geojson(reader, tmp_path / "a.geojson", SimpleNamespace(datum=""))


def test_a_gap_between_images_gives_no_velocity():
    poses = SE3(np.stack([SE3.from_planar(x, 0.0, -0.1 * x).matrix for x in (1.0, 1.2, 1.5, 1.9, 2.0)]))
    stamps = np.array([0, 100, 300, 699, 910]) * 10**6
    velocity = partial(refine_camera.velocity, Trajectory(stamps, poses))
    assert velocity(0) is None
    assert velocity(4) is None
    moved = (poses[0].inverse() @ poses[2]).log()
    np.testing.assert_allclose(velocity(1), moved / 0.3)
    assert velocity(1)[5] == pytest.approx(-0.05 / 0.3)
    assert velocity(2) is not None  # 0.599 s: two pauses of 0.3 s at most
    assert velocity(3) is None  # 0.61 s


def proven(unobserved=()):
    found = Lens.of(CAMERA, 0.0125)
    deviations = {name: (k + 1) / 8 for k, name in enumerate(found.names)}
    refined = SimpleNamespace(lens=found, deviations=deviations, states=[0] * 7, num_pixels=99, residual=2.25)
    figures = {"evidence": 9.5, "limit": 4.25, "moved_px": 2.5, "apart_px": 0.5}
    return SimpleNamespace(found=refined, unobserved=unobserved, **figures)


def test_a_refined_lens_is_read_by_ros_as_it_was_found():
    found = yaml.safe_load(refine_camera.text_of(proven(), "front", None))
    assert (found["image_width"], found["image_height"], found["camera_name"]) == (64, 48, "front")
    assert found["camera_matrix"] == {"rows": 3, "cols": 3, "data": [50.0, 0, 31.0, 0, 51.0, 23.0, 0, 0, 1.0]}
    assert found["distortion_coefficients"] == {"rows": 1, "cols": 5, "data": [0.1, 0.2, 0.3, 0.4, 0.0]}
    assert (found["projection_matrix"]["rows"], found["projection_matrix"]["cols"]) == (3, 4)
    assert (found["readout"], found["standard_deviations"]["fy"]) == (0.0125, 0.25)
    assert found["held_out"] == {"evidence": 9.5, "limit": 4.25, "moved_px": 2.5, "apart_px": 0.5}
    lines = list(refine_camera.report_camera(proven(("cx",))))
    assert lines[0] == "7 images, 99 pixels, residual 2.2 grey levels"
    assert lines[3].split()[:6] == ["cx", "31.00000", "+-", "0.37500", "NOT", "OBSERVED"]
    assert lines[-2].startswith("held-out halves of the drive: t 9.5 for it, more than 4.2 is proof")


def test_facts_are_words_with_units_and_no_reprs(tmp_path):
    reader = sphere_map(tmp_path, length=31.416)
    night = Experience("night", "", "n", 1_700_000_000 * SECOND)
    served = {0: Service(7, 1_700_000_000 * SECOND)}
    reader.graph = with_service(with_experience(reader.graph, night, [0]), served)
    lines = facts_as_lines(map_info.map_facts(reader))
    assert ["extent_m", "4,", "2,", "0"] in [line.split() for line in lines]
    second, first = sorted(line for line in lines if line.startswith("experiences"))
    assert "name none, drive none," in first
    assert "last_served_s none" in first
    assert "name night, drive n, camera none, first_stamp_s 2023-11-14 22:13:20 UTC, key_spheres 1," in second
    assert second.endswith("images_served 7, last_served_s 2023-11-14 22:13:20 UTC")
    text = "\n".join(lines)
    assert not set("{}[]'") & set(text)
    assert "None" not in text
