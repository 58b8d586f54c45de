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

"""The ROS nodes: they move data between topics, devices and the core."""

import os

from haptic_accel.core.process import BLAS_THREADS

# A node computes on one thread. Threads of BLAS spin while they wait for each other, and a
# spinning real-time thread may keep the others from a core for ever.
for _variable in BLAS_THREADS:
    os.environ.setdefault(_variable, "1")
