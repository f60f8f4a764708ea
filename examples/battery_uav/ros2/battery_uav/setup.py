"""Installs the nodes where `ros2 run` and `ros2 launch` look for them."""

from setuptools import setup

setup(
    name="battery_uav",
    version="0.1.0",
    description="A UAV's battery, its supervisor and its LED panel, for ROS 2",
    maintainer="Oracle Server maintainers",
    maintainer_email="maintainers@example.org",
    license="Apache-2.0",
    packages=["battery_uav"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/battery_uav"]),
        ("share/battery_uav", ["package.xml"]),
        ("share/battery_uav/launch", ["launch/battery_uav.launch.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "battery = battery_uav.battery:main",
            "supervisor = battery_uav.supervisor:main",
            "led_panel = battery_uav.led_panel:main",
        ],
    },
)
