"""Commands by their words, which need not be texts."""

from __future__ import annotations

from sphere_nav_tools.cli.main import main


def call(*words: object) -> int:
    """Return the exit status of a command."""
    return main([str(word) for word in words])
