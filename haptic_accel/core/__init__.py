"""Algorithms without ROS: models, filters, controllers, virtual rig, metrics, lockstep trials."""
