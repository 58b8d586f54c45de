"""Bags: how they are written, read back and mended. No ROS is needed for any of it."""
