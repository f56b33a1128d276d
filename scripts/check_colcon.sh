#!/bin/sh
# Check that colcon takes both packages for what they are: a manifest with a mistake in it is demoted to a plain Python
# or CMake package without a word.
set -eu
command -v colcon >/dev/null 2>&1 || {
    echo "colcon: expected it on the PATH (the wheels of requirements-test.txt have it), found none" >&2
    exit 1
}
found=$(COLCON_DEFAULTS_FILE=colcon_defaults.yaml colcon --log-base /dev/null list)
for expected in 'sphere_nav .*(ros.ament_python)' 'sphere_nav_msgs .*(ros.ament_cmake)'; do
    echo "$found" | tr '\t' ' ' | grep -q "^$expected" || {
        echo "colcon list: expected a line '$expected', found: $found" >&2
        exit 1
    }
done
