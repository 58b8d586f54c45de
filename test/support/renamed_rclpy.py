# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""An rclpy that has renamed all that it does not document, as a later one may."""

from __future__ import annotations

from pathlib import Path

import pytest

RENAMED = '''
import re
from importlib.machinery import SourceFileLoader

METHODS = {
    "Publisher": ["publish_raw", "get_subscription_count"],
    "Subscription": ["take_message", "get_publisher_count"],
    "Service": ["service_take_request"],
    "EventHandle": ["take_event"],
    "": ["rclpy_logging_rcutils_log"],
}
PRIVATE = re.compile(
    r"\\b(publish_raw|take_message|service_take_request|take_event|rclpy_logging_rcutils_log"
    r"|rclpy_implementation|CallerId|_ready_to_take_data|_logger)\\b"
    r"|(?<=publisher\\.)(get_subscription_count)\\b|(?<=subscription\\.)(get_publisher_count)\\b"
    r"|\\b(__on_)(?=change_state|get_)"
)
RENAMING = """
for kind, names in METHODS.items():
    owner = getattr(rclpy_implementationrenamed, kind, rclpy_implementationrenamed)
    for name in names:
        setattr(owner, name + "renamed", getattr(owner, name))
        delattr(owner, name)
"""
read = SourceFileLoader.get_code

def get_code(self, name):
    if not name.startswith("rclpy."):
        return read(self, name)
    path = self.get_filename(name)
    source = PRIVATE.sub(lambda found: found[0] + "renamed", self.get_data(path).decode())
    if name.endswith(".implementation_singleton"):
        source += f"METHODS = {METHODS}" + RENAMING
    return self.source_to_code(source, path)

SourceFileLoader.get_code = get_code
'''
"""Program that Python runs at its start: it renames in rclpy's sources, and in its C library."""


def rename(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rename in the processes that a test starts from now on, by a new folder in a path."""
    folder = path / "renamed"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(RENAMED)
    monkeypatch.setenv("PYTHONPATH", str(folder))
