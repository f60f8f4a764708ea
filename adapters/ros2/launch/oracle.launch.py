"""Attach the graph to an oracle server: `ros2 launch oracle_ros2 oracle.launch.py spec:=battery_uav`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """One monitor; its arguments are those of `python3 -m oracle_ros2`."""
    arguments = {"oracle": "http://127.0.0.1:8642", "spec": "", "session": "", "monitor": "monitor", "namespace": ""}
    given = [text for name in arguments for text in (f"--{name}", LaunchConfiguration(name))]
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name, default_value=value) for name, value in arguments.items()),
            Node(package="oracle_ros2", executable="monitor", output="screen", arguments=given),
        ]
    )
