"""The ROS 2 package sphere_nav: its Python packages, data files and executables."""

from glob import glob

from setuptools import find_packages, setup

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

setup(
    name="sphere_nav",
    version="0.1.0",
    description="Teach a vehicle a place once, then drive there by itself with one camera.",
    license="Apache-2.0",
    maintainer="sphere_nav maintainers",
    maintainer_email="maintainers@sphere-nav.example",
    packages=find_packages(include=[pattern for name in PACKAGES for pattern in (name, f"{name}.*")]),
    package_data={"mcl_depth": ["likeness/weights.npz"]},  # of the learned likeness
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/sphere_nav"]),
        ("share/sphere_nav", ["package.xml"]),
        ("share/sphere_nav/launch", sorted(glob("launch/*.launch.py"))),
        ("share/sphere_nav/config", sorted(glob("config/*.*"))),
        ("share/sphere_nav/config/cameras", sorted(glob("config/cameras/*.yaml"))),
    ],
    python_requires=">=3.11",
    install_requires=["setuptools"],  # the rest: package.xml for rosdep, requirements.txt for wheels
    # without pytest colcon runs unittest, finds nothing and reports success
    extras_require={"test": ["pytest"], "view": ["viser>=1.1,<2"], "cluster": ["distributed"]},
    zip_safe=False,
    entry_points={
        "console_scripts": ["sphere_nav = sphere_nav_tools.cli.main:main"]
        + [f"{name} = sphere_nav.ros.shared_files:main" for name in EXECUTABLES if name != "sphere_nav"],
        "sphere_nav.nodes": [f"{name} = {module}:main" for name, module in EXECUTABLES.items()],
    },
)
