"""The live scope: the last seconds of the signals, and the page that shows them (no ROS)."""
