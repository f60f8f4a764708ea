"""Installs the nodes where `ros2 run` and `ros2 launch` look for them."""

from setuptools import setup

setup(
    name="navigation",
    version="0.1.0",
    description="A mobile base with a docked arm, and its mission, for ROS 2",
    maintainer="Oracle Server maintainers",
    maintainer_email="maintainers@example.org",
    license="Apache-2.0",
    packages=["navigation"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/navigation"]),
        ("share/navigation", ["package.xml"]),
        ("share/navigation/launch", ["launch/navigation.launch.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "arm = navigation.arm:main",
            "base = navigation.base:main",
            "mission = navigation.mission:main",
        ],
    },
)
