"""The ROS graph: arguments, parameters, processes and their supervision."""
