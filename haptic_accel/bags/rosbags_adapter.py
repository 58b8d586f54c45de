# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Undocumented names of rosbags; other modules import them from here only.

`setup.py` permits the rosbags versions with these names. A test imports each name, and thus
detects a release that moves it. The compression libraries are those of rosbags.
"""

import sys

from lz4 import frame as lz4  # type: ignore[import-untyped]
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # named as in rosbags

__all__ = ["dump_qos_v9", "lz4", "parse_qos", "zstd"]
