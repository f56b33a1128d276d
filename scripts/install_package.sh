#!/bin/sh
# install_package.sh ENVIRONMENT: install the package sphere_nav, not editable: only so is the environment a complete
# ament prefix. `ros2 run` looks for executables in lib/sphere_nav, hence the links.
set -eu
environment=$1
python=$environment/bin/python
rm -rf build/lib # would keep modules that are gone from the tree
"$python" -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation --force-reinstall .

# numba recompiles (minutes) what looks newer than its cache. An installation is no reason to; an edit of any kernel is,
# also for those in other files that call it: all kernels get the time of the newest.
site=$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
kernels=$(find ./*/ -name kernels.py -not -path './build/*' -not -path './install/*')
# shellcheck disable=SC2086  # a list of words
newest=$(ls -t $kernels | head -n 1)
for kernel in $kernels; do
    touch -r "$newest" "$site/$kernel"
done

links=$environment/lib/sphere_nav
rm -rf "$links"
mkdir -p "$links"
"$python" - <<'PYTHON' | while read -r name; do ln -s "../../bin/$name" "$links/$name"; done
from importlib.metadata import distribution

for entry in distribution("sphere_nav").entry_points:
    if entry.group == "console_scripts":
        print(entry.name)
PYTHON
