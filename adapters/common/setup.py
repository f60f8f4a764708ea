"""How pip, colcon and catkin install the half of the adapters that knows no ROS."""

from setuptools import setup

setup(
    name="oracle_adapter",
    version="0.1.0",
    packages=["oracle_adapter"],
    package_dir={"": "."},
    package_data={"oracle_adapter": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/oracle_adapter"]),
        ("share/oracle_adapter", ["package.xml"]),
    ],
    python_requires=">=3.8",
    install_requires=["websockets>=9.1"],
    zip_safe=False,
    maintainer="The oracle-server developers",
    maintainer_email="maintainers@oracle-server.dev",
    description="The link from a ROS adapter to an oracle server, free of ROS",
    license="Apache-2.0",
)
