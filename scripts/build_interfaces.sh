#!/bin/sh
# build_interfaces.sh FOLDER ENVIRONMENT: build one interface package with the rosidl generators of the wheels and
# install it into the environment, so that it imports without any set-up file.
set -eu
folder=$1
environment=$(cd "$2" && pwd)
build=$environment/build/$(basename "$folder")
PATH=$environment/bin:$PATH # ament runs `python3`, which must be the environment's
export PATH
mkdir -p "$build"
log=$build.log
{
    cmake -S "$folder" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF \
        -DCMAKE_PREFIX_PATH="$environment" -DCMAKE_INSTALL_PREFIX="$environment" \
        -DCMAKE_PROJECT_INCLUDE="$PWD/cmake/wheel_includes.cmake" &&
        cmake --build "$build" --parallel "$(nproc)" &&
        cmake --install "$build"
} >"$log" 2>&1 || {
    tail -n 20 "$log" >&2
    echo "$folder: not built, see $log" >&2
    exit 1
}
