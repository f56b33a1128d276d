"""Pose and path in, speed and steering of a car out (M15 section 6.4.2).

READ FIRST `follower.py`: predict the pose, locate it on the path, form the errors, apply the law, watch over safety,
limit to what the car can do. `path.py` is the reference trajectory, `taught.py` makes it from a taught drive,
`law.py` is eq. 25, `vehicle.py` the car, `safety.py` the reasons to stop.
"""
