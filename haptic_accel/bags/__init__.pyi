# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.bags.delivery import AGE_OF as AGE_OF
from haptic_accel.bags.reading import (Signal as Signal, messages_of as messages_of,
    read_bag_with_warnings as read_bag_with_warnings)
from haptic_accel.bags.spooling import spooled_bags as spooled_bags

NO_ROSBAGS: str
OF_ROSBAGS: tuple[str, ...]
