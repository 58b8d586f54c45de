# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Folder in which the wrong command lines of a kit are given."""

from __future__ import annotations

from pathlib import Path

import pytest

from refusals import written


@pytest.fixture(scope="module")
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the command lines name: `FILES` of the test's module."""
    return written(tmp_path_factory.mktemp("folder"), getattr(request.module, "FILES", {}))
