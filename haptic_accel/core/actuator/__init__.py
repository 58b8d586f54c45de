"""The voice coil: its limits, travel, friction and safety."""
