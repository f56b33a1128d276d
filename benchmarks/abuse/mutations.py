"""Valid files and messages made wrong, and messages of nothing but lies: bits, lengths, numbers, text, fields."""

from __future__ import annotations

import array
import copy
import importlib
import re
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from rosidl_parser import definition as d

WORDS = (
    *(b"nan", b"inf", b"-inf", b"0", b"-0.0", b"-1", b"1e400", b"-1e308", b"1e16", b"1e-400", b"99999999999999999999"),
    *(b"2147483648", b"1700000000000000000", b"9" * 5000, b"", b"null", b"true", b"[]", b"{}", b"*a", b"&a [*a]"),
    *(b"<<: {a: 1}", b"!!python/object:os.system", b"2026-99-99", b"0x" + b"f" * 100, b"1:2:3:4", b"\x00", b"\xff\xfe"),
    *("é²٣".encode(), b"a" * 70_000, b"[" * 3000, b'"', b"'", b"#", b",", b":", b"-", b"\n", b"\t", b"%YAML 1.0\n"),
)
TEXT_FILES = (".yaml", ".yml", ".json", ".geojson", ".csv", ".txt", ".tum")
CONTROLS = (b"\x1b[2J", b"\x00", b"\r", b"\x7f", "\u202e".encode(), b"\n", b"%s%n", b"../../etc/passwd", b"a" * 5000)
INTEGERS = (0, 1, 2, 127, 128, 255, 256, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**33, 2**63 - 1, 2**64 - 1)
SMALL = (0, 1, 1, 2, 3, 4, 77)
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.5, 3.0, 1e-30, 1e9, 1e30, float("nan"), float("inf"), float("-inf"))
DOUBLES = (1e-300, 1e300, -1e300)
MARK, NO_UTF8 = "MARK", b"\xff\xfe\x80\xc0"  # where text stands that becomes bytes that are none
TEXTS = (
    *("", "x", "~", "map", "odom", "/map", "base_link", "mono8", "rgb8", "bayer_rggb8", "yuv422", "16UC1", "32FC1"),
    *("png", "log16_zstd", "a\nb", "%s%n", "\u0000", "x\u0000y", "\ufffd", "\U0001f697" * 8, "\u202egnp.exe"),
    *("é" * 300, "../x", "[" * 40, "{}: !!x", "\x1b[2J", "x" * 5000, MARK),
)
LENGTHS = (0, 0, 1, 2, 3, 9, 36, 1000)
MAX_DEEP = 3  # elements of sequences of messages, each of which is filled
CHANCE_OF_NOW = 0.4  # of a stamp: otherwise most messages are refused for it alone
NUMBER = re.compile(rb"[-+]?\d[\d.eE+-]*|[A-Za-z_]\w*")
MOST = 3  # changes of one input
PARTS = {"SendGoal": "SendGoalService", "GetResult": "GetResultService", "FeedbackMessage": "FeedbackMessage"}


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
    match int(rng.integers(8)):
        case 0:
            return data[:place] + bytes([data[place] ^ 1 << int(rng.integers(8))]) + data[place + 1 :]
        case 1:
            return data[:place]
        case 2:
            return data[:place] + data[end:]
        case 3:
            return data[:end] + data[place:end] * int(rng.integers(1, 4)) + data[end:]
        case 4:
            return data[:place] + rng.bytes(end - place) + data[end:]
        case 5:
            width = int(rng.choice([1, 2, 4, 8]))
            number = INTEGERS[rng.integers(len(INTEGERS))] % 2 ** (8 * width)
            return data[:place] + number.to_bytes(width, "little") + data[place + width :]
        case 6:
            return data[:place] + WORDS[rng.integers(len(WORDS))] + data[place:]
        case _:
            found = NUMBER.search(data, place) or NUMBER.search(data)
            begin, end = found.span() if found else (place, end)
            return data[:begin] + WORDS[rng.integers(len(WORDS))] + data[end:]


def attack_texts(
    readers: dict[str, tuple[Path, Callable[[Path], Any]]], rng: np.random.Generator, folder: Path
) -> None:
    """Read a text file with what a terminal or a parser would obey: characters, lists in lists, numbers without end."""
    texts = [pair for pair in readers.values() if pair[0].suffix in TEXT_FILES]
    sample, read = texts[rng.integers(len(texts))]
    deep, many, data = int(2 ** rng.integers(1, 16)), int(rng.integers(2, 12)), sample.read_bytes()
    anchors = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * many) if i else '1'}]\n" for i in range(many))
    nested = ["[" * deep, "{a: " * deep, "[" * deep + "]" * deep, '{"a":' * deep + "1" + "}" * deep, anchors]
    nested += [
        "? " * deep,
        "- " * deep,
        "9" * deep,
        "1:" * deep + "1",
        "<<: " * min(deep, 99),
        "!!binary " + "A" * deep,
    ]
    words = [*CONTROLS, *(text.encode() for text in nested)]
    for _ in range(int(rng.integers(1, MOST + 1))):
        places = [place + 1 for place, byte in enumerate(data) if byte in b":,=[ "] or [0]
        place = places[rng.integers(len(places))] if rng.random() < 0.7 else int(rng.integers(len(data) + 1))
        data = data[:place] + words[rng.integers(len(words))] + data[place:]
    path = folder / f"texts{sample.suffix}"
    path.write_bytes(data)
    read(path)


def mutate_message(message: Any, rng: np.random.Generator) -> Any:
    """Return a copy of a ROS message with one to three fields wrong."""
    message = copy.deepcopy(message)
    for _ in range(int(rng.integers(1, MOST + 1))):
        _change_field(message, rng)
    return message


def _change_field(message: Any, rng: np.random.Generator) -> None:
    number = int(rng.integers(len(message.SLOT_TYPES)))
    name, slot = list(message.get_fields_and_field_types())[number], message.SLOT_TYPES[number]
    found = getattr(message, name)
    if isinstance(slot, d.NamespacedType):
        return _change_field(found, rng)
    if isinstance(found, list) and found and isinstance(slot.value_type, d.NamespacedType) and rng.random() < 0.7:
        return _change_field(found[rng.integers(len(found))], rng)
    with suppress(AssertionError, ValueError, OverflowError, TypeError):  # what the message class itself refuses
        setattr(message, name, _wrong_sequence(found, slot, rng) if len(np.shape(found)) else Liar(rng).value(slot))


def _wrong_sequence(found: Any, slot: Any, rng: np.random.Generator) -> Any:
    if isinstance(found, array.array) and found.typecode == "B":
        return array.array("B", mutate_bytes(found.tobytes(), rng))
    changed = copy.deepcopy(found)
    if len(changed) and rng.random() < 0.6:
        changed[int(rng.integers(len(changed)))] = Liar(rng).value(slot.value_type)
        return changed
    if isinstance(slot, d.Array):  # its length is its type's
        return Liar(rng).value(slot)
    return Liar(rng).value(slot) if rng.random() < 0.5 else changed[: int(rng.integers(len(changed) + 1))]


def interface_class(name: str) -> type[Any]:
    """Return the class of a type by its name, `std_msgs/msg/String`; the parts of an action, too."""
    package, kind, word = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    if kind == "action" and not hasattr(module, word):
        name, _, part = word.partition("_")
        action = getattr(module, name)
        implied: type[Any] = getattr(action.Impl, PARTS[part]) if part in PARTS else getattr(action, part)
        return implied
    found: type[Any] = getattr(module, word)
    return found


class Liar:
    """Makes messages whose every field is a lie; the same seed makes the same ones, but for stamps of now."""

    def __init__(self, rng: np.random.Generator, *, is_now: bool = False) -> None:
        """`is_now`: some stamps are of now; `words` are names that mean something to who is lied to."""
        self._rng, self._is_now = rng, is_now
        self.words: list[str] = []

    def message(self, kind: type[Any]) -> Any:
        """Return a message of this class."""
        made = kind()
        if kind is Time and self._is_now and self._rng.random() < CHANCE_OF_NOW:
            made.sec, made.nanosec = divmod(time.time_ns(), 10**9)
            return made
        for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
            setattr(made, name, self.value(slot))
        return made

    def raw(self, message: Any) -> bytes:
        """Return a message as bytes: with text that is no UTF-8, some bytes changed, or its end missing."""
        data = serialize_message(message).replace(MARK.encode(), NO_UTF8)
        return mutate_bytes(data, self._rng) if self._rng.random() < 0.6 else data

    def value(self, slot: Any) -> Any:
        """Return what a field of this type may hold."""
        if isinstance(slot, d.BasicType):
            return self._basic(slot.typename)
        if isinstance(slot, d.AbstractGenericString):
            text = self._pick((*TEXTS, *self.words) if self._rng.random() < 0.6 or not self.words else self.words)
            return text[: slot.maximum_size] if slot.has_maximum_size() else text
        if isinstance(slot, d.NamespacedType):
            return self.message(interface_class("/".join(slot.namespaced_name())))
        inner, length = slot.value_type, slot.size if isinstance(slot, d.Array) else self._pick(LENGTHS)
        if isinstance(slot, d.BoundedSequence):
            length = min(length, slot.maximum_size)
        if not isinstance(slot, d.Array) and not isinstance(inner, d.BasicType):
            length = min(length, MAX_DEEP)
        if not isinstance(slot, d.Array) and getattr(inner, "typename", "") == "uint8":
            return array.array("B", self._rng.bytes(length))
        return [self.value(inner) for _ in range(length)]

    def _pick(self, values: Sequence[Any]) -> Any:
        return values[int(self._rng.integers(len(values)))]

    def _basic(self, name: str) -> Any:
        if name == "boolean":
            return bool(self._rng.random() < 0.5)
        if name == "octet":
            return bytes([int(self._rng.integers(256))])
        if name in ("float", "double"):
            return self._pick(FLOATS if name == "float" else FLOATS + DOUBLES)
        bits = int(re.sub(r"\D", "", name) or 8)
        low, high = (0, 2**bits) if name.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        return int(self._pick((low, high - 1, max(-1, low), *(n for n in (*SMALL, *INTEGERS) if n < high))))
