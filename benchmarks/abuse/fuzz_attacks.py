"""Wrong inputs by those who know the format: pipes, links, control characters, deep nesting.

Each is made from a valid sample, with a number or a name of its own, and must be refused in one line or be read.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.abuse.fuzz_samples import Samples
from benchmarks.abuse.mutations import mutate_bytes
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.service import one_line

Readers = dict[str, tuple[Path, Callable[[Path], Any]]]
TEXTS = (".yaml", ".yml", ".json", ".geojson", ".csv", ".txt", ".tum")
Attempt = Callable[[np.random.Generator, Path], None]
FIELDS = (b"\x1b[2J", b"\x00", b"\r", b"\x7f", "\u202e".encode(), b"\n", b"%s%n", b"../../etc/passwd", b"a" * 5000)


def make_attacks(samples: Samples, readers: Readers) -> list[tuple[str, Attempt, float]]:
    """Return name, attempt and share of all attacks on readers of files."""
    texts = {name: pair for name, pair in readers.items() if pair[0].suffix in TEXTS}
    readers = readers | {"bag": (samples.bag, _read_bag), "sqlite3": (samples.foreign_bags[0], _read_bag)}
    return [
        ("no regular file", partial(_no_file, readers), 1.0),
        ("characters and nesting", partial(_texts, texts), 2.0),
    ]


def _read_bag(path: Path) -> None:
    with BagReader(path, is_empty_allowed=True) as bag:
        for topic, _, _ in bag.raw():
            assert topic.isprintable(), f"accepted the topic {topic!r}"


def _no_file(readers: Readers, rng: np.random.Generator, folder: Path) -> None:
    """Pipes, sockets, folders, links in a circle, to devices, to nothing; names that a terminal would obey."""
    sample, read = list(readers.values())[rng.integers(len(readers))]
    name = ["odd", "odd\x1b[2J", "odd\nname", "odd\u202e", "-odd", "odd'\";rm"][rng.integers(6)]
    path = folder / f"{name}{sample.suffix}"
    kind = int(rng.integers(8))
    try:
        match kind:
            case 0:
                os.mkfifo(path)
            case 1:
                path.mkdir()
            case 2:
                path.symlink_to(path)
            case 3:
                path.symlink_to(["/dev/zero", "/dev/stdin", "/proc/self/mem", "/proc/kmsg"][rng.integers(4)])
            case 4:
                path.symlink_to(folder / "nothing")
            case 5:
                os.link(sample, path)
            case 6:
                path.touch()
                os.truncate(path, int(rng.choice([1, 1 << 20, 1 << 33, 1 << 40])))  # a file with a hole
            case _:
                path.write_bytes(mutate_bytes(sample.read_bytes(), rng))
        read(path)
    except (ValueError, OSError) as error:
        line = one_line(error)
        assert line.isprintable(), f"a line that a terminal obeys: {line!r}"
        raise ValueError(line) from None
    finally:
        with suppress(FileNotFoundError):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _texts(texts: Readers, rng: np.random.Generator, folder: Path) -> None:
    """Characters that a terminal or a parser would obey; lists in lists, aliases of aliases, numbers without end."""
    sample, read = list(texts.values())[rng.integers(len(texts))]
    deep, many, data = int(2 ** rng.integers(1, 16)), int(rng.integers(2, 12)), sample.read_bytes()
    anchors = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * many) if i else '1'}]\n" for i in range(many))
    nested = ["[" * deep, "{a: " * deep, "[" * deep + "]" * deep, '{"a":' * deep + "1" + "}" * deep, anchors]
    nested += ["? " * deep, "- " * deep, "9" * deep, "1:" * deep + "1", "<<: " * min(deep, 99), "&a [*a]"]
    nested += ["!!binary " + "A" * deep, "!!set {" + ",".join(map(str, range(min(deep, 3000)))) + "}"]
    words = [*FIELDS, *(text.encode() for text in nested)]
    for _ in range(int(rng.integers(1, 4))):
        places = [place + 1 for place, byte in enumerate(data) if byte in b":,=[ "] or [0]
        place = places[rng.integers(len(places))] if rng.random() < 0.7 else int(rng.integers(len(data) + 1))
        data = data[:place] + words[rng.integers(len(words))] + data[place:]
    path = folder / f"texts{sample.suffix}"
    path.write_bytes(words[rng.integers(len(words))] if rng.random() < 0.1 else data)
    read(path)
