"""`python -m sphere_nav.params module:Class [--node NAME] [--markdown]`: commented YAML, or a list, of parameters."""

from __future__ import annotations

import argparse
import importlib
import sys

from sphere_nav.params.render import to_markdown, to_yaml


def main() -> int:
    """Print the YAML file, or the Markdown table, of the class named on the command line."""
    parser = argparse.ArgumentParser(prog="python -m sphere_nav.params", description=__doc__)
    parser.add_argument("cls", metavar="module:Class")
    parser.add_argument("--node", default="/**", help="name of the node in the YAML file")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    module, _, name = arguments.cls.partition(":")
    try:
        cls = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        parser.error(f"{arguments.cls}: expected module:Class of a parameters class, found {error}")
    sys.stdout.write(to_markdown(cls) if arguments.markdown else to_yaml(cls, node=arguments.node))
    return 0


if __name__ == "__main__":
    sys.exit(main())
