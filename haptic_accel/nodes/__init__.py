"""The ROS 2 nodes: they move data between topics, devices and the core."""
