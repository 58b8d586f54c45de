"""Files of textures, taps, materials and scenes: read and written, with nothing of ROS."""
