"""Arms of other ROS 2 nodes that speak CRTK."""
