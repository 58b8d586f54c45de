"""Bags: written, read and repaired, without ROS."""
