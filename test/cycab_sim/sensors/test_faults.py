import numpy as np
import pytest

from cycab_sim.sensors.faults import SECOND, Faults
from cycab_sim.vehicle import VehicleCommand


def test_a_fault_is_in_force_for_its_duration_and_without_times_from_now_until_cleared():
    faults = Faults()
    faults.add("camera", "noise", 5.0, 2.0, 3.0, now_ns=0)
    times = [1.9, 2.0, 4.9, 5.0]
    assert [faults.magnitude("camera", "noise", int(t * SECOND)) for t in times] == [None, 5.0, 5.0, None]
    assert faults.magnitude("sphere", "noise", 3 * SECOND) is None
    assert faults.described(6 * SECOND) == []
    faults = Faults()
    faults.add("odom", "slip", 0.3, 0.0, 0.0, now_ns=7 * SECOND)
    assert faults.magnitude("odom", "slip", 6 * SECOND) is None
    assert faults.magnitude("odom", "slip", 10**15) == 0.3
    assert faults.described(8 * SECOND) == [
        {"target": "odom", "kind": "slip", "magnitude": 0.3, "start": 7.0, "duration": 0.0}
    ]
    faults.clear()
    assert faults.magnitude("odom", "slip", 10**15) is None


def test_outputs_are_withheld_as_often_as_asked_for():
    faults = Faults()
    faults.add("camera", "intermittent", 0.25, 0.0, 0.0, 0)
    share = np.mean([faults.is_withheld("camera", index, 1) for index in range(2000)])
    assert share == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 2000))
    assert not faults.is_withheld("odom", 3, 1)
    faults.add("odom", "silent", 0.0, 0.0, 0.0, 0)
    assert all(faults.is_withheld("odom", index, 1) for index in range(5))


def test_cameras_of_a_rig_have_faults_of_their_own():
    faults = Faults(("front", "rear"))
    faults.add("rear", "intermittent", 0.5, 0.0, 0.0, 0)
    faults.add("front", "intermittent", 0.5, 0.0, 0.0, 0)
    dropped = [[faults.is_withheld(name, index, 1) for index in range(400)] for name in ("front", "rear")]
    assert np.mean(np.equal(*dropped)) == pytest.approx(0.5, abs=0.1)  # four standard errors: not the same images
    with pytest.raises(ValueError, match=r"fault\.target: .*steering, front, rear, found 'left'"):
        faults.add("left", "silent", 0.0, 0.0, 0.0, 0)


def test_a_wheel_that_is_off_is_off_to_the_same_side_backwards():
    faults = Faults()
    faults.add("steering", "bias", 0.1, 0.0, 0.0, 0)
    done = faults.alter_command(VehicleCommand(-1.0, -np.tan(0.2) / 1.5), VehicleCommand(), 1.5, 1)
    assert done.yaw_rate == pytest.approx(-np.tan(0.3) / 1.5)
