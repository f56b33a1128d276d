"""What happened on a drive: speed asked for, distance from the path, and what the localiser said, out of its bag.

python examples/timeline.py out/demo/drive timeline.png
"""

import argparse

import matplotlib.pyplot as plt

import sphere_nav


def main(bag: str, picture: str) -> None:
    """Draw speed, distance from the path and states over time."""
    speeds, errors, states = [], [], []
    for topic, stamp_ns, message in sphere_nav.read_bag(bag, ["cmd_vel", "tracking_error", "status"]):
        seconds = stamp_ns / 1e9
        if topic == "/cmd_vel":
            speeds.append((seconds, getattr(message, "twist", message).linear.x))
        elif topic == "/tracking_error":
            errors.append((seconds, 1000 * message.lateral))
        else:
            states.append((seconds, message.state))
    print(f"{len(speeds)} commands, {len(errors)} errors, states {sorted({state for _, state in states})}")
    figure, axes = plt.subplots(3, sharex=True, layout="constrained")
    for axis, rows, label in zip(axes, (speeds, errors, states), ("speed, m/s", "lateral, mm", "state"), strict=True):
        axis.plot(*zip(*rows, strict=True), ".", markersize=2)
        axis.set_ylabel(label)
    axes[-1].set_xlabel("s")
    figure.savefig(picture)


parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
for name in ("bag", "picture"):
    parser.add_argument(name)
try:
    main(**vars(parser.parse_args()))
except (OSError, ValueError) as error:
    parser.exit(2, f"{error}\n")
