"""Position-position coupling of the two arms (paper, section II)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, parameter


@dataclass(frozen=True)
class CouplingParameters(Checked):
    """Gains of the coupling; defaults from the paper (0.25 N/mm each way)."""

    k_m: float = parameter(250.0, "stiffness felt at the master", "N/m", 0, 5000.0)
    k_sl: float = parameter(250.0, "stiffness driving the slave", "N/m", 0, 5000.0)
    damping: float = parameter(
        0.0, "damping of the difference of velocities, both ways", "N s/m", 0, 50.0
    )
    scale: float = parameter(1.0, "slave motion per master motion", low=0.01, high=100.0)
    max_force: float = parameter(
        3.3, "limit of each arm's force (Phantom Omni: 3.3 N)", "N", 0, 100.0
    )


class PositionPositionCoupling:
    """A spring, and optionally a damper, between the motions of master and slave.

    The positions at the moment of engaging are each other's counterparts, so that engaging
    gives zero force wherever the arms are. Until `engage` is called every force is zero.
    """

    def __init__(self, parameters: CouplingParameters) -> None:
        self._parameters = parameters
        self._origins: tuple[Vector, Vector] | None = None

    @property
    def engaged(self) -> bool:
        """The arms are coupled."""
        return self._origins is not None

    def engage(self, master: Vector, slave: Vector) -> None:
        """Couple the arms where they are, positions in m."""
        self._origins = (master, slave)

    def disengage(self) -> None:
        """Uncouple: forces are zero until the next `engage`."""
        self._origins = None

    def forces(
        self,
        master: Vector,
        slave: Vector,
        master_velocity: Vector = ZERO,
        slave_velocity: Vector = ZERO,
    ) -> tuple[Vector, Vector]:
        """Return the forces for the arms of master and slave.

        Parameters
        ----------
        master, slave : tuple of float
            Positions, m.
        master_velocity, slave_velocity : tuple of float
            Velocities, m/s; used where there is damping.

        Returns
        -------
        master_force, slave_force : tuple of float
            Forces, N, each limited in magnitude.
        """
        if self._origins is None:
            return ZERO, ZERO
        p = self._parameters
        master_origin, slave_origin = self._origins
        # Lag of the slave behind the master, in the master's scale.
        lag = tuple(
            (m - m0) - (s - s0) / p.scale
            for m, m0, s, s0 in zip(master, master_origin, slave, slave_origin, strict=True)
        )
        slip = tuple(m - s / p.scale for m, s in zip(master_velocity, slave_velocity, strict=True))
        on_master = [-p.k_m * d - p.damping * v for d, v in zip(lag, slip, strict=True)]
        on_slave = [p.scale * (p.k_sl * d + p.damping * v) for d, v in zip(lag, slip, strict=True)]
        return _limited(on_master, p.max_force), _limited(on_slave, p.max_force)


def _limited(force: list[float], limit: float) -> Vector:
    """Shorten a force to its limit, keeping its direction; no force where it is not finite."""
    x, y, z = force
    magnitude = math.sqrt(x * x + y * y + z * z)
    if not math.isfinite(magnitude):
        return ZERO
    if magnitude <= limit:
        return x, y, z
    ratio = limit / magnitude
    return x * ratio, y * ratio, z * ratio
