# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bag that all tests of exports read."""

from __future__ import annotations

import pytest
from exported import Recorded, write_bag


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Return a bag of the paper's rig on plywood, three seconds long."""
    path = tmp_path_factory.mktemp("bags") / "plywood"
    return Recorded(path, write_bag(path))
