# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.scope.connections import LOCAL_HOST as LOCAL_HOST, Access as Access
from haptic_accel.scope.state import SCENE as SCENE
from haptic_accel.scope.windows import (CONTROLLER_CHANGE_TIME as CONTROLLER_CHANGE_TIME,
    INTERVAL_MARGIN as INTERVAL_MARGIN, Windows as Windows, late_percent as late_percent,
    measure as measure)
from haptic_accel.scope.server import (CommandError as CommandError, ScopeServer as ScopeServer,
    Touched as Touched, check_choice as check_choice)
from haptic_accel.scope.state import LEVELS as LEVELS
