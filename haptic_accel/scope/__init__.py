"""The live scope: the latest seconds of the signals and the page that shows them (no ROS)."""
