"""The ROS 2 package sphere_nav: its Python packages, data files and executables."""

from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup

PACKAGES = (
    "sphere_nav",
    "rig_calibration",
    "sphere_mapping",
    "dense_localizer",
    "mcl_depth",
    "path_follower",
    "cycab_sim",
    "sphere_nav_tools",
)
EXECUTABLES = {
    "sphere_nav": "sphere_nav_tools.cli.main",
    "sphere_stitcher": "sphere_mapping.acquisition.ros.node",
    "sphere_mapper": "sphere_mapping.ros.node",
    "dense_localizer": "dense_localizer.ros.node",
    "mcl_depth": "mcl_depth.ros.node",
    "path_follower": "path_follower.ros.node",
    "route_navigator": "path_follower.ros.navigator_node",
    "command_guard": "path_follower.ros.guard_node",
    "cycab_sim": "cycab_sim.ros.node",
    "bag_recorder": "sphere_nav.ros.bags.recorder_node",
    "bag_player": "sphere_nav.ros.bags.player_node",
}

MESSAGES = "build/messages"  # a prefix with the interface packages, while scripts/wheel_backend.py makes a wheel


def interfaces() -> dict[str, Path]:
    """Return the folders of the interface packages, and of all in them, by name; none but in a wheel."""
    sites = Path(MESSAGES).glob("lib/python*/site-packages")
    return {name: site / name.replace(".", "/") for site in sites for name in find_packages(str(site))}


def data_files() -> list[tuple[str, list[str]]]:
    """Return the data of the interface packages by the folder that they go to."""
    files = [*Path(MESSAGES).glob("lib/*.so"), *Path(MESSAGES).glob("share/**/*")]
    return [(str(path.parent.relative_to(MESSAGES)), [str(path)]) for path in files if path.is_file()]


def wheels() -> list[str]:
    """Return what runs the package where no rosdep brings it: requirements.txt, but for what builds interfaces."""
    parts = Path("requirements.txt").read_text(encoding="utf-8").split("\n\n") if interfaces() else []
    lines = (line for part in parts if "# building" not in part for line in part.splitlines())
    return [line for line in lines if not line.startswith("#")]


class OfThisPlatform(Distribution):
    """A distribution with compiled parts, where the interface packages are in it."""

    def has_ext_modules(self) -> bool:
        """Whether there are any."""
        return bool(interfaces())


setup(
    name="sphere_nav",
    version="0.1.0",
    description="Teach a vehicle a place once, then drive there by itself with one camera.",
    license="Apache-2.0",
    maintainer="sphere_nav maintainers",
    maintainer_email="maintainers@sphere-nav.example",
    distclass=OfThisPlatform,
    packages=find_packages(include=[pattern for name in PACKAGES for pattern in (name, f"{name}.*")])
    + list(interfaces()),
    package_dir={name: str(folder) for name, folder in interfaces().items()},
    package_data={"mcl_depth": ["likeness/weights.npz"]}  # of the learned likeness
    | {name: ["*.so"] for name in interfaces()},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/sphere_nav"]),
        ("share/sphere_nav", ["package.xml"]),
        ("share/sphere_nav/launch", sorted(glob("launch/*.launch.py"))),
        ("share/sphere_nav/config", sorted(glob("config/*.*"))),
        ("share/sphere_nav/config/cameras", sorted(glob("config/cameras/*.yaml"))),
        *data_files(),
    ],
    python_requires=">=3.11",
    install_requires=["setuptools", *wheels()],  # without interfaces: package.xml for rosdep, requirements.txt
    # without pytest colcon runs unittest, finds nothing and reports success
    extras_require={"test": ["pytest"], "view": ["viser>=1.1,<2"], "cluster": ["distributed"]},
    zip_safe=False,
    entry_points={
        "console_scripts": ["sphere_nav = sphere_nav_tools.cli.main:main"]
        + [f"{name} = sphere_nav.ros.shared_files:main" for name in EXECUTABLES if name != "sphere_nav"],
        "sphere_nav.nodes": [f"{name} = {module}:main" for name, module in EXECUTABLES.items()],
    },
)
