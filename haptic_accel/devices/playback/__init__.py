"""Devices that play a recording."""
