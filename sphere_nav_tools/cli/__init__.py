"""The `sphere_nav` command: one file a subcommand, listed in `main.py`."""

from sphere_nav.ros.shared_files import use_one_thread

use_one_thread()
