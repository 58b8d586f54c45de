# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Bags: writing, reading and repair, without ROS."""

NO_ROSBAGS = "bags need rosbags: pip install 'rosbags>=0.11.9,<0.12'"
"""Message if rosbags is missing. No distribution packages rosbags; only recording needs it."""

OF_ROSBAGS = ("rosbags", "lz4", "backports")
"""Modules installed with rosbags."""
