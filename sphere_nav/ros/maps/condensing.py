"""Key spheres as a map stores them, condensed (`spheres/condensed.py`): as they are written, and what they take."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import zstandard
from sphere_nav_msgs.msg import AugmentedSphere

from sphere_nav.ros.bags.serialization import serialize_to_store
from sphere_nav.ros.conversions import message_to_sphere, sphere_to_message
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.ros.maps.writer import SPHERE_FRAME, Stored
from sphere_nav.spheres.condensed import condensed_sphere


def condense(stored: Iterable[Stored], ids: Collection[int]) -> Iterator[Stored]:
    """Yield all key spheres, some of them condensed; the small ones are as they were."""
    for whole, small in stored:
        yield condense_message(whole) if int(whole.id) in ids else whole, small


def condense_message(message: AugmentedSphere) -> AugmentedSphere:
    """Return a key sphere condensed; one that is so already stays as it is."""
    sphere = condensed_sphere(message_to_sphere(message))
    return sphere_to_message(sphere, SPHERE_FRAME, int(message.id), is_png=True)


def count_bytes(base: MapReader, sphere_id: int, is_condensed: bool) -> float:
    """Return what a key sphere of a map takes of its file, as it is or condensed, with its share of all else."""
    whole = base.count_bytes(sphere_id)
    if is_condensed:
        whole = count_compressed(condense_message(base.load_message(sphere_id)))
    return whole + base.num_other_bytes / len(base.graph)


def count_compressed(message: AugmentedSphere) -> int:
    """Return what a key sphere would take, without what is told of it elsewhere."""
    return len(zstandard.ZstdCompressor().compress(serialize_to_store(message)))
