"""What the verbs' arguments have in common."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeAlias, TypeVar

T = TypeVar("T")
Verbs: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def take_words(verb: argparse.ArgumentParser) -> None:
    """Let a verb take the ``key:=value`` words of the graph."""
    verb.add_argument("words", nargs="*", metavar="key:=value", help="arguments of the graph")


def take_json(verb: argparse.ArgumentParser) -> None:
    """Let a verb write its figures for a program."""
    verb.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")


def listed_words(text: str) -> list[str]:
    """Read words with commas between."""
    return text.split(",")


def as_words(arguments: argparse.Namespace, names: Iterable[str]) -> list[str]:
    """Return options that have the meaning of an argument of the graph as such."""
    given = {name: getattr(arguments, name) for name in names}
    return [f"{name}:={value}" for name, value in given.items() if value is not None]


def numbers(kind: Callable[[str], T]) -> Callable[[str], list[T]]:
    """Return what reads numbers with commas between."""

    def read(text: str) -> list[T]:
        return [kind(word) for word in text.split(",")]

    return read


def listed(numbers: Iterable[float]) -> str:
    """Write numbers with commas between."""
    return ",".join(f"{number:g}" for number in numbers)
