"""Transports of datagrams: between processes of one host, and between two hosts."""
