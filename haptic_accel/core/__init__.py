"""What computes: models, filters, controllers, rig and metrics, without ROS and in lockstep."""
