"""Valid files and messages made wrong: bits, bytes, lengths and numbers of files; fields of messages."""

from __future__ import annotations

import array
import copy
import re
from contextlib import suppress
from typing import Any

import numpy as np

WORDS = (
    *(b"nan", b"inf", b"-inf", b"0", b"-0.0", b"-1", b"1e400", b"-1e308", b"1e16", b"1e-400", b"99999999999999999999"),
    *(b"2147483648", b"1700000000000000000", b"9" * 5000, b"", b"null", b"true", b"[]", b"{}", b"*a", b"&a [*a]"),
    *(b"<<: {a: 1}", b"!!python/object:os.system", b"2026-99-99", b"0x" + b"f" * 100, b"1:2:3:4", b"\x00", b"\xff\xfe"),
    *("é²٣".encode(), b"a" * 70_000, b"[" * 3000, b'"', b"'", b"#", b",", b":", b"-", b"\n", b"\t", b"%YAML 1.0\n"),
)
INTEGERS = (0, 1, 2, 127, 128, 255, 256, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**33, 2**63 - 1, 2**64 - 1)
FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-300, 1e9, 1e30, 1e300, -1e300, float("nan"), float("inf"), float("-inf"))
TEXTS = ("", "x", "map", "mono8", "rgb8", "bayer_rggb8", "yuv422", "16UC1", "32FC1", "png", "log16_zstd", "x" * 1000)
NUMBER = re.compile(rb"[-+]?\d[\d.eE+-]*|[A-Za-z_]\w*")
MOST = 3  # changes of one input


def mutate_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes of a file with one to three things wrong."""
    for _ in range(int(rng.integers(1, MOST + 1))):
        data = _changed(data, rng)
    return data


def _changed(data: bytes, rng: np.random.Generator) -> bytes:
    if not data:
        return WORDS[rng.integers(len(WORDS))]
    place = int(rng.integers(len(data)))
    end = min(place + int(rng.integers(1, 1 + int(2 ** rng.integers(1, 12)))), len(data))
    match int(rng.integers(9)):
        case 0:
            return data[:place] + bytes([data[place] ^ 1 << int(rng.integers(8))]) + data[place + 1 :]
        case 1:
            return data[:place] + bytes([int(rng.integers(256))]) + data[place + 1 :]
        case 2:
            return data[:place]
        case 3:
            return data[:place] + data[end:]
        case 4:
            return data[:end] + data[place:end] * int(rng.integers(1, 4)) + data[end:]
        case 5:
            return data[:place] + rng.bytes(end - place) + data[end:]
        case 6:
            width = int(rng.choice([1, 2, 4, 8]))
            number = INTEGERS[rng.integers(len(INTEGERS))] % 2 ** (8 * width)
            return data[:place] + number.to_bytes(width, "little") + data[place + width :]
        case 7:
            return data[:place] + WORDS[rng.integers(len(WORDS))] + data[place:]
        case _:
            found = NUMBER.search(data, place) or NUMBER.search(data)
            begin, end = found.span() if found else (place, end)
            return data[:begin] + WORDS[rng.integers(len(WORDS))] + data[end:]


def mutate_message(message: Any, rng: np.random.Generator) -> Any:
    """Return a copy of a ROS message with one to three fields wrong."""
    message = copy.deepcopy(message)
    for _ in range(int(rng.integers(1, MOST + 1))):
        _change_field(message, rng)
    return message


def _change_field(message: Any, rng: np.random.Generator) -> None:
    kinds = message.get_fields_and_field_types()
    name = list(kinds)[rng.integers(len(kinds))]
    found = getattr(message, name)
    if hasattr(found, "get_fields_and_field_types"):
        _change_field(found, rng)
        return
    if isinstance(found, list) and found and hasattr(found[0], "get_fields_and_field_types") and rng.random() < 0.7:
        _change_field(found[rng.integers(len(found))], rng)
        return
    with suppress(AssertionError, ValueError, OverflowError, TypeError):  # what the message class itself refuses
        setattr(message, name, _wrong(found, kinds[name], rng))


def _wrong(found: Any, kind: str, rng: np.random.Generator) -> Any:
    if isinstance(found, bool):
        return not found
    if isinstance(found, int):
        return INTEGERS[rng.integers(len(INTEGERS))] * int(rng.choice([1, 1, -1]))
    if isinstance(found, float):
        return FLOATS[rng.integers(len(FLOATS))]
    if isinstance(found, str):
        return TEXTS[rng.integers(len(TEXTS))]
    if isinstance(found, bytes):
        return bytes([int(rng.integers(256))])
    return _wrong_sequence(found, rng)


def _wrong_sequence(found: Any, rng: np.random.Generator) -> Any:
    if isinstance(found, array.array) and found.typecode == "B":
        return array.array("B", mutate_bytes(found.tobytes(), rng))
    changed = copy.deepcopy(found)
    if len(changed) and rng.random() < 0.6:
        index = int(rng.integers(len(changed)))
        changed[index] = _wrong(changed[index].item() if hasattr(changed[index], "item") else changed[index], "", rng)
        return changed
    if isinstance(found, np.ndarray):
        return changed
    return changed[: int(rng.integers(len(changed) + 1))] if rng.random() < 0.5 else changed + changed
