#!/bin/sh
# compile_kernels.sh ENVIRONMENT: compile the kernels of the installed package once, for everyone with the same kernels.
set -eu
environment=$1
log=$environment/build/kernels.log
mkdir -p "$environment/build"
"$environment/bin/python" -P -m sphere_nav_tools.cli.warm_up >"$log" 2>&1 || {
    tail -n 20 "$log" >&2
    echo "kernels: not compiled, see $log" >&2
    exit 1
}
