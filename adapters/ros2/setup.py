"""How setuptools and colcon install the adapter."""

from setuptools import setup

setup(
    name="oracle_ros2",
    version="0.1.0",
    packages=["oracle_ros2"],
    package_data={"oracle_ros2": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/oracle_ros2"]),
        ("share/oracle_ros2", ["package.xml"]),
        ("share/oracle_ros2/launch", ["launch/oracle.launch.py"]),
    ],
    install_requires=["setuptools", "oracle-adapter"],
    zip_safe=True,
    maintainer="The oracle-server developers",
    maintainer_email="maintainers@oracle-server.dev",
    description="Observes, filters and proxies ROS 2 topics and services as an oracle server decides.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["monitor = oracle_ros2.__main__:main"]},
)
