"""The simulated Cycab; with `map` also the localiser and the path follower, so that it drives by its camera.

ros2 launch sphere_nav simulation.launch.py mode:=teach record:=drive
ros2 launch sphere_nav simulation.launch.py map:=town trajectory:=taught.tum
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "mode": ("drive", "who drives: drive (the topic cmd_vel) or teach (the simulator itself)"),
    "seed": ("1", "decides the town and every noise"),
    "world": ("town", "where it drives: town, city, corridor or ramp"),
    "traffic": ("false", "cars, a tram, cyclists and pedestrians in the streets"),
    "map": ("", "map to localise in; empty: the simulator alone"),
    "trajectory": ("", "file of the trajectory to follow"),
    "record": ("", "bag to record everything into; empty: none"),
    "params": (
        PathJoinSubstitution([FindPackageShare("sphere_nav"), "config", "cycab_sim.yaml"]),
        "parameter file of the simulator",
    ),
}


def typed(name, kind):
    """Return an argument as a parameter of this type, whatever its text looks like."""
    return ParameterValue(LaunchConfiguration(name), value_type=kind)


def generate_launch_description():
    """Return what to start."""
    values = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    simulator = Node(
        package="sphere_nav",
        executable="cycab_sim",
        output="screen",
        parameters=[
            values["params"],
            {
                "mode": typed("mode", str),
                "seed": typed("seed", int),
                "world": typed("world", str),
                "traffic.is_on": typed("traffic", bool),
                "has_stamped_command": True,  # a command says which image it answers: lock-step
            },
        ],
    )
    recorder = Node(
        package="sphere_nav",
        executable="bag_recorder",
        output="screen",
        condition=IfCondition(NotEqualsSubstitution(values["record"], "")),
        parameters=[{"output": typed("record", str), "topic_set": "all", "use_sim_time": True}],
    )
    drivers = IncludeLaunchDescription(
        PathJoinSubstitution([ThisLaunchFileDir(), "localisation.launch.py"]),
        condition=IfCondition(NotEqualsSubstitution(values["map"], "")),
        launch_arguments={
            "map": values["map"],
            "trajectory": values["trajectory"],
            "drive": "true",
            "use_sim_time": "true",
            "stamped_cmd_vel": "true",
        }.items(),
    )
    declared = [DeclareLaunchArgument(n, default_value=d, description=t) for n, (d, t) in ARGUMENTS.items()]
    return LaunchDescription([*declared, simulator, recorder, drivers])
