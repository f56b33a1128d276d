"""The `sphere_nav` command: one file a subcommand, listed in `main.py`."""
