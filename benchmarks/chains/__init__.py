"""What the benchmarks on ROS 1 and ROS 2 share: the chains, the run, and the table."""
