"""The library that every node and command stands on, in rooms on floors (docs/architecture.md); and a way in.

`import sphere_nav` gives the names of `PUBLIC`, for a script or a notebook; docs/library.md begins with examples. They
are loaded when they are asked for, so that a room alone stays light; nothing in the package takes them from here.
"""

from importlib import import_module
from typing import Any

PUBLIC = (
    "SE3",
    "Camera",
    "Estimate",
    "Localizer",
    "Map",
    "Registration",
    "RgbdView",
    "Sphere",
    "Trajectory",
    "evaluate",
    "localize_bag",
    "mcl",
    "open_map",
    "read_bag",
    "read_images",
    "read_trajectory",
    "register",
    "render",
)


def __getattr__(name: str) -> Any:
    """Return one of the public names (PEP 562)."""
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("sphere_nav_tools.library"), name)


def __dir__() -> list[str]:
    """Return what completes."""
    return [*globals(), *PUBLIC]
