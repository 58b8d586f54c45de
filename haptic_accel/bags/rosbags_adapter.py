"""Names that rosbags does not document, imported nowhere else.

`setup.py` admits the versions of rosbags that have them, and a test imports each: a release that
moves one is noticed here. The writer of rosbags keeps all data in memory until it is closed; what
it is built of need not.
"""

import sys

from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos
from rosbags.rosbag2.storage_mcap import (
    DECOMPRESSORS,
    Channel,
    McapWriter,
    PendingChunk,
    Schema,
    write_channel,
    write_string,
)

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # as rosbags has it

__all__ = ["DECOMPRESSORS", "Channel", "McapWriter", "PendingChunk", "Schema", "dump_qos_v9"]
__all__ += ["parse_qos", "write_channel", "write_string", "zstd"]
