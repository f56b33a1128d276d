"""Images that are published at the rate of a camera, stamped when they are sent."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

SECOND = 1_000_000_000
PAUSE = 1.0  # s before the first and after the last image: whoever listens has made its connections, and has answered


def play_images(
    periods: Sequence[float],
    info: tuple[Any, Callable[[int], Any]],
    outputs: Sequence[Any],
    messages_of: Callable[[int], Sequence[Any]],
) -> tuple[list[int], float]:
    """Wait for subscriptions, then publish image after image; return the stamps, and by how many s one was late.

    Stamps are as even as a camera's: a player that is late makes images old, not motions uneven.
    `periods`: from each image to the next, s. `info`: a publisher and its message of a stamp, sent before the images
    `messages_of(number)`, one for each of `outputs`.
    """
    publisher, info_of = info
    while not all(output.get_subscription_count() for output in (*outputs, publisher)):
        time.sleep(0.1)
    time.sleep(PAUSE)
    stamps, due, late = [], time.monotonic(), 0.0
    before_ns = time.time_ns() - round(due * SECOND)  # of the one clock to the other
    for number, period in enumerate(periods):
        late = max(late, time.monotonic() - due)
        time.sleep(max(0.0, due - time.monotonic()))
        stamps.append(before_ns + round(due * SECOND))
        publisher.publish(info_of(stamps[-1]))
        for output, message in zip(outputs, messages_of(number), strict=True):
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamps[-1], SECOND)
            output.publish(message)
        due += period
    time.sleep(PAUSE)
    return stamps, late
