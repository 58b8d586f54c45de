# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Registry of configurations, members of all devices, and the rule by which a class is found."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

C = TypeVar("C", bound=type)


@dataclass(kw_only=True)
class Config:
    """Configuration that is chosen by its type."""

    id: str | None = None
    calibration_dir: str | None = None

    choices: ClassVar[dict[str, type]]

    @classmethod
    def register_subclass(cls, name: str) -> Callable[[C], C]:
        def register(kind: C) -> C:
            cls.choices[name] = kind
            return kind

        return register

    @classmethod
    def get_known_choices(cls) -> dict[str, type]:
        return cls.choices

    @classmethod
    def get_choice_class(cls, name: str) -> type:
        return cls.choices[name]

    @classmethod
    def get_choice_name(cls, kind: type) -> str:
        return next(name for name, each in cls.choices.items() if each is kind)

    @classmethod
    def default_choice_name(cls) -> str | None:
        return None


def make_device(config: Any) -> Any:
    """Build the device whose class is named as its configuration's, in the same module."""
    kind = type(config)
    assert kind.__name__.endswith("Config")
    module = importlib.import_module(kind.__module__)
    return getattr(module, kind.__name__.removesuffix("Config"))(config)


class Device(ABC):
    """Members that robots and teleoperators have in common."""

    def __init__(self, config: Config) -> None:
        self.id = config.id
        self.calibration: dict[str, Any] = {}

    @property
    @abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def is_connected(self) -> bool: ...

    @abstractmethod
    def connect(self, calibrate: bool = True) -> None: ...

    @property
    @abstractmethod
    def is_calibrated(self) -> bool: ...

    @abstractmethod
    def calibrate(self) -> None: ...

    @abstractmethod
    def configure(self) -> None: ...

    @abstractmethod
    def disconnect(self) -> None: ...
