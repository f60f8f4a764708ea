"""How catkin installs the adapter; pip goes by pyproject.toml."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["oracle_ros1"], package_dir={"": "."}))
