# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names that rosbags does not document, imported nowhere else.

`setup.py` admits the versions of rosbags that have them, and a test imports each: a release that
moves one is noticed here. The compressions are those that rosbags brings along.
"""

import sys

from lz4 import frame as lz4  # type: ignore[import-untyped]
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # as rosbags has it

__all__ = ["dump_qos_v9", "lz4", "parse_qos", "zstd"]
