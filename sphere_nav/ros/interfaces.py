"""Message types by name: the class, the full text of the definition, and its hash, from the installed interfaces."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from sphere_nav.ros.conversions.headers import plain_frames
from sphere_nav.ros.shared_files import share_folders


def type_name(kind: type[Any]) -> str:
    """Return `package/msg/Type` of a generated message class."""
    package, folder = kind.__module__.split(".")[:2]
    return f"{package}/{folder}/{kind.__name__}"


def from_bytes(data: bytes, kind: type[Any], max_bytes: int | None = None) -> Any:
    """Return the message of bytes; ValueError where they are none of that type, or too many to be converted."""
    if max_bytes is not None and len(data) > max_bytes:
        raise ValueError(f"expected at most {max_bytes} bytes, found {len(data)}")
    try:
        return plain_frames(deserialize_message(data, kind))
    except Exception as error:  # the type support raises whatever it likes
        found = f"{len(data)} bytes that are none: {' '.join(str(error).split())}"
        raise ValueError(f"expected {type_name(kind)}, found {found}") from None


@cache
def message_class(name: str) -> type[Any]:
    """Return the class of `package/msg/Type`; ValueError where the package is not installed."""
    package, folder, kind = _parts(name)
    _definition(name)  # a name in a file must not import whatever it likes
    try:
        found: type[Any] = getattr(import_module(f"{package}.{folder}"), kind)
    except (ImportError, AttributeError):
        raise ValueError(f"{name}: message type is not installed here") from None
    return found


@cache
def schema_text(name: str) -> str:
    """Return the .msg text followed by those of all types it uses, as `ros2msg` schemas have it."""
    names = [name]
    for user in names:  # which grows
        names += [used for used in dict.fromkeys(_used_types(user)) if used not in names]
    others = (f"{'=' * 80}\nMSG: {one.replace('/msg/', '/')}\n{_definition(one)}" for one in names[1:])
    return "\n".join([_definition(name), *others])


@cache
def type_store(name: str) -> Any:
    """Return the library's types that a message is made of."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # a tenth of a second, for files alone

    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema_text(name), name))
    return store


@cache
def type_hash(name: str) -> str:
    """Return the REP-2011 hash (RIHS01_...) of a type, or an empty string where it is not installed."""
    try:
        return str(type_store(name).hash_rihs01(name))
    except ValueError:
        return ""


def _used_types(name: str) -> list[str]:
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_msg

    ((_, fields),) = get_types_from_msg(_definition(name), name).values()
    many = Nodetype.ARRAY, Nodetype.SEQUENCE
    kinds: list[Any] = [kind[1][0] if kind[0] in many else kind for _, kind in fields]
    return [str(what) for node, what in kinds if node == Nodetype.NAME]


@cache
def _definition(name: str) -> str:
    package, folder, kind = _parts(name)
    path = _share(package, f"{folder}/{kind}.msg")
    if path is None:
        raise ValueError(f"{name}: message type is not installed here: no share/{package}/{folder}/{kind}.msg")
    return path.read_text()


def _share(package: str, name: str) -> Path | None:
    spec = find_spec(package)  # imports nothing: the name of a package has no dots
    code = Path(spec.origin).resolve().parent if spec is not None and spec.origin else None
    places = (folder / name for folder in share_folders(package, code))
    return next(filter(Path.is_file, places), None)


def _parts(name: str) -> tuple[str, str, str]:
    parts = name.split("/")
    if len(parts) != 3 or not all(part.isidentifier() for part in parts):
        raise ValueError(f"message type: expected package/msg/Type, found {name!r}")
    return parts[0], parts[1], parts[2]
