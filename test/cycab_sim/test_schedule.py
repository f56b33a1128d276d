from cycab_sim.params import CameraRigParams, CaptureParams, OdometryParams, SimCameraParams, SimParams, SphereParams
from cycab_sim.simulator import Schedule

MS = 1_000_000


def due(schedule, milliseconds, way=0.0):
    found = []
    for t in range(0, milliseconds + 1, 10):
        found += [(t, name) for name in schedule.take(t * MS)]
        schedule.advance(way)
    return found


def test_outputs_come_by_their_period_and_are_counted():
    params = SimParams(camera=SimCameraParams(period=0.1), odometry=OdometryParams(period=0.05))
    schedule = Schedule(params)
    found = due(schedule, 200)
    assert [t for t, name in found if name == "camera"] == [0, 100, 200]
    assert [t for t, name in found if name == "odom"] == [0, 50, 100, 150, 200]
    assert schedule.count == {"odom": 4, "camera": 2, "imu": -1, "scan": -1, "sphere": -1, "rig": -1}


def test_spheres_come_by_the_way_in_the_teaching_drive_only():
    schedule = Schedule(SimParams(mode="teach"))
    assert [t for t, name in due(schedule, 1000, way=0.02) if name == "sphere"] == [0, 250, 500, 750, 1000]
    assert "sphere" not in [name for _, name in due(Schedule(SimParams()), 1000, way=0.02)]
    none = Schedule(SimParams(mode="teach", sphere=SphereParams(width=0)))
    assert "sphere" not in [name for _, name in due(none, 1000, way=0.02)]


def test_the_rig_comes_with_the_spheres_and_is_off_without_cameras():
    rig, capture = CameraRigParams(kind="ring"), CaptureParams(when="always", distance=0.3)
    found = due(Schedule(SimParams(rig=rig, capture=capture)), 1000, way=0.02)
    for kind in ("rig", "sphere"):
        assert [t for t, name in found if name == kind] == [0, 150, 300, 450, 600, 750, 900]
    assert "rig" not in [name for _, name in due(Schedule(SimParams(rig=rig)), 1000, way=0.02)]
    assert "rig" not in [name for _, name in due(Schedule(SimParams(mode="teach")), 500, way=0.02)]
