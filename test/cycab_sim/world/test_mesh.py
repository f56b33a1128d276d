import numpy as np

from cycab_sim.world.mesh import Finish, MeshBuilder, moved, placed

PLAIN = Finish(3, (0.5, 0.4, 0.3), params=(0.2, 7.0))


def builder():
    return MeshBuilder(np.random.default_rng(3))


def test_a_box_is_closed_and_faces_outwards():
    mesh = builder()
    mesh.box([1.0, 2.0, 0.0], [2.0, 4.0, 3.0], PLAIN, placed(1.0, -2.0, 0.7))
    built = mesh.build()
    middle = moved(np.array([2.0, 4.0, 1.5]), placed(1.0, -2.0, 0.7))
    outward = built.triangles.mean(axis=1) - middle
    assert built.triangles.shape == (12, 3, 3)
    assert np.all(np.sum(outward * built.normals, axis=1) > 0)
    edges = built.triangles[:, 1:] - built.triangles[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2
    assert np.isclose(area, 2 * (2 * 4 + 2 * 3 + 4 * 3), rtol=1e-5)


def test_a_frame_maps_its_panel_to_u_along_and_v_up():
    corners = moved(np.array([[0, 0, 1], [3, 0, 1], [3, 0, 3], [0, 0, 3]], float), placed(4.0, 5.0, 1.1))
    mesh = builder()
    mesh.panels(corners, PLAIN)
    frame = mesh.build().frames[0]
    local = corners @ frame[:, :3].T + frame[:, 3]
    np.testing.assert_allclose(local, [[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0]], atol=1e-5)
