"""Coupling of two hosts over a network: packets, sessions, clocks, playout."""
