# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Licence header of the source files, for ament_copyright, which recognizes no SPDX header."""

from types import SimpleNamespace

HEADER = "{copyright}\nSPDX-License-Identifier: Apache-2.0\n"

SPDX_APACHE = SimpleNamespace(name="Apache-2.0", spdx="Apache-2.0", file_headers=[HEADER])
SPDX_APACHE.license_files = SPDX_APACHE.contributing_files = []
