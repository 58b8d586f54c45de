# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.materials.folders import (config_folder as config_folder,
    is_recording as is_recording)
from haptic_accel.materials.texture_files import (read_npz as read_npz,
    write_texture as write_texture)
