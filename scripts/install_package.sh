#!/bin/sh
# install_package.sh ENVIRONMENT: install the package sphere_nav, not editable: only so is the environment a complete
# ament prefix. `ros2 run` looks for executables in lib/sphere_nav, hence the links.
set -eu
environment=$1
python=$environment/bin/python
"$python" -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation --force-reinstall \
    --config-settings=messages=no .

links=$environment/lib/sphere_nav
rm -rf "$links"
mkdir -p "$links"
"$python" - <<'PYTHON' | while read -r name; do ln -s "../../bin/$name" "$links/$name"; done
from importlib.metadata import distribution

for entry in distribution("sphere_nav").entry_points:
    if entry.group == "console_scripts":
        print(entry.name)
PYTHON
