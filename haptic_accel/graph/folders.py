"""Location of the package's own files; light to import."""

from __future__ import annotations

from pathlib import Path


def share_folder() -> Path:
    """Return the folder that holds ``config`` and ``launch``.

    A checkout's own where the code runs from a checkout; otherwise the installed one.
    """
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "package.xml").is_file():
        return checkout
    from ament_index_python.packages import get_package_share_directory

    return Path(get_package_share_directory("haptic_accel"))


def config_folder() -> Path:
    """Return the folder of parameter files."""
    return share_folder() / "config"
