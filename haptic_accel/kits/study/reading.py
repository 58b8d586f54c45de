# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reading of protocols from YAML files, and checks of their design; no other file is read.

Errors name the file, the line, the value and what is allowed.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from haptic_accel import Checked, ParameterError
from haptic_accel.core.document import Document, read_yaml_document
from haptic_accel.core.parameters import Specification, own_schema, schema
from haptic_accel.kits.study import protocol as protocols
from haptic_accel.kits.study.procedures import TASKS, Plan, rows, written
from haptic_accel.kits.study.protocol import Condition, Levels, Pair, PlannedTest, Protocol, Value
from haptic_accel.setup.arguments import ConditionArguments, DeviceArguments

_PARTS: list[tuple[str, Any]] = [(each.name, each.default_factory) for each in fields(Protocol)]

SECTIONS: Mapping[str, type[Checked]] = {
    name: kind for name, kind in _PARTS if isinstance(kind, type) and issubclass(kind, Checked)
}
"""Keys whose values are the fields of a dataclass."""

TEXTS = ("title", "task", "question", "instructions")
"""Keys of texts that every protocol has."""

KEYS = {each.name for each in fields(Protocol)} - {"digest", "source", "content"}
"""All keys of a protocol."""

MEASURES: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(TASKS, ("correct", "d_prime", "threshold")),
    **{"same_different": ("correct", "d_prime"), "identification": ("correct",)},
    **{"rating": ("rating",), "similarity": ("rating",), "preference": ("preferred",)},
}
"""Measures of `PlannedTest` for each task; a threshold needs levels."""

ARGUMENTS = (
    *(*schema(ConditionArguments), *schema(DeviceArguments)),
    *("coupling", "rate", "latency", "frame", "params_file"),
)
"""Arguments of the graph that a protocol may set; a session sets the others itself."""

GAIN, NETWORK = "gain", "network"
"""Factors that are not arguments of the graph."""

FACTORS = (*ARGUMENTS, GAIN, NETWORK)
"""Factors that a protocol may vary."""

WHOLE = ("latency", "frame", "seed")
"""Factors that are whole numbers."""

MOST_CONDITIONS = 100
"""Maximum number of combinations of factors, more than a participant can compare."""

MOST_RATINGS = 101
"""Maximum number of ratings on a scale."""

_NUMBER = Specification("number")

_AGAINST = re.compile(r"-?\d+(\.\d*)?")
"""Pattern of a number as the reference of a planned test."""


def read_protocol(path: Path) -> Protocol:
    """Read a protocol, and check its design.

    Parameters
    ----------
    path : Path
        YAML file; see haptic_accel/kits/study/protocol.md.

    Raises
    ------
    ParameterError
        The file cannot be read, a key is unknown, a value is not allowed, or the design is not
        consistent.
    """
    file = read_yaml_document(path)
    file.check_keys(*sorted(KEYS))
    texts: dict[str, Any] = {name: _text(file.at(name)) for name in TEXTS}
    file.at("task").choice(TASKS)
    levels = _levels(file)
    factors = _factors(file, levels)
    conditions = _conditions(file, factors)
    protocol = Protocol(
        **texts,
        **{name: _section(file.get(name, {}), kind) for name, kind in SECTIONS.items()},
        consent=protocols.Consent(*_required(file.at("consent"), "version", "text")),
        language=file.get("language", Protocol.language).text(),
        graph=_graph(file.get("graph", {})),
        factors=factors,
        conditions=conditions,
        levels=levels,
        pairs=_pairs(file, conditions, levels) if TASKS[texts["task"]].paired else (),
        scale=_scale(file),
        strengths=_strengths(file.get("strengths", {}), conditions),
        tests=tuple(_section(each, PlannedTest) for each in file.get("tests", []).items()),
        # The digest includes the order of the keys, which determines the conditions' names.
        digest=hashlib.sha256(json.dumps(file.value, default=str).encode()).hexdigest(),
        source=path,
        content=file.source,
    )
    _check_design(file, protocol)
    for each, test in zip(file.get("tests", []).items(), protocol.tests, strict=True):
        _check_test(each, test, protocol)
    return protocol


def matching(conditions: Iterable[Condition], words: str) -> tuple[Condition, ...]:
    """Return the conditions that match all ``factor=value`` texts; all conditions for none.

    Examples
    --------
    >>> both = [Condition((("controller", name), ("gain", 1.0))) for name in ("none", "adaptive")]
    >>> [str(each) for each in matching(both, "controller=adaptive")]
    ['controller=adaptive gain=1']
    """
    asked = set(words.split())
    return tuple(each for each in conditions if asked <= set(str(each).split()))


def word(value: Value) -> str:
    """Return a value as text of ``key:=value``."""
    return f"{value:.12g}" if isinstance(value, float) else value


def _section(section: Document, kind: type[Checked]) -> Any:
    section.check_keys(*own_schema(kind))
    return section.build(kind)


def _required(section: Document, *names: str) -> list[str]:
    """Return the texts of a section."""
    section.check_keys(*names)
    return [_text(section.at(name)) for name in names]


def _text(given: Document) -> str:
    if not (text := given.text().strip()):
        given.wrong("must be text")
    return text


def _value(given: Document) -> Value:
    """Parse a word or a number."""
    if isinstance(given.value, str) and given.value.split() == [given.value]:
        return given.text()
    if not isinstance(given.value, (int, float)):
        given.wrong("must be a word without spaces, or a number")
    return given.number()


def _values(listed: Document) -> tuple[Value, ...]:
    values = tuple(_value(each) for each in listed.items())
    if not values or len(set(map(written, values))) < len(values):
        listed.wrong("must be different values, at least one")
    return values


def _graph(section: Document) -> dict[str, str]:
    section.check_keys(*ARGUMENTS)
    return {name: word(_value(each)) for name, each in section.members()}


def _levels(file: Document) -> Levels | None:
    if "levels" not in file:
        return None
    section = file.at("levels")
    section.check_keys("factor", "reference", "values", "scale")
    reference = section.at("reference").number()
    listed = section.at("values")
    _values(listed)
    values = tuple(each.number() for each in listed.items())
    if min(values) <= reference <= max(values):
        listed.wrong(f"must be all above or all below the reference, {reference:g}")
    scale = section.get("scale", Levels.scale).choice({name: name for name in ("linear", "log")})
    return Levels(
        section.at("factor").choice({name: name for name in FACTORS}), reference, values, scale
    )


def _factors(file: Document, levels: Levels | None) -> dict[str, tuple[Value, ...]]:
    """Return the values of each factor; those of levels start with the reference."""
    section = file.get("factors", {})
    section.check_keys(*FACTORS)
    if levels and levels.factor in section:
        section.refuse(f"{levels.factor}: must be in levels alone", levels.factor)
    factors = {name: _values(each) for name, each in section.members()}
    for name in factors:
        if name in file.get("graph", {}):
            file.get("graph").refuse(f"{name}: must be in factors alone", name)
    return factors | ({levels.factor: (levels.reference, *levels.values)} if levels else {})


def _conditions(file: Document, factors: Mapping[str, tuple[Value, ...]]) -> tuple[Condition, ...]:
    """Return all combinations of the factors, or those that are listed."""
    if not 2 <= (count := math.prod(map(len, factors.values()))) <= MOST_CONDITIONS:
        allowed = f"must give 2 to {MOST_CONDITIONS} conditions, not {count}"
        file.refuse(f"factors: {allowed}", "factors")
    combined = itertools.product(*factors.values())
    every = tuple(Condition(tuple(zip(factors, each, strict=True))) for each in combined)
    listed = file.get("conditions", list(map(str, every)))
    found = tuple(_one(each, every) for each in listed.items())
    if len(found) < 2 or len(set(found)) < len(found):
        listed.wrong("must be different conditions, at least two")
    return found


def _one(given: Document, conditions: Iterable[Condition]) -> Condition:
    """Return the only condition that matches ``factor=value`` texts."""
    found = matching(conditions, given.text())
    if len(found) != 1:
        given.wrong(f"must be one of {', '.join(map(str, conditions))}")
    return found[0]


def _pairs(
    file: Document, conditions: tuple[Condition, ...], levels: Levels | None
) -> tuple[Pair, ...]:
    """Return the listed pairs, the pairs of levels with their reference, or all pairs."""
    if "pairs" in file:
        pairs = tuple(_pair(each, conditions) for each in file.at("pairs").items())
        if levels or not pairs or len(set(pairs)) < len(pairs):
            file.at("pairs").wrong("must be different pairs, at least one, or levels")
        return pairs
    if not levels:
        return tuple(itertools.starmap(Pair, itertools.combinations(conditions, 2)))
    name = levels.factor
    return tuple(
        Pair(first, second, float(second[name]))
        for first, second in itertools.product(conditions, conditions)
        if first[name] == levels.reference != second[name] and _same_but(name, first, second)
    )


def _same_but(factor: str, *conditions: Condition) -> bool:
    """Return whether two conditions have equal values of all other factors."""
    first, second = ({**dict(each.settings), factor: 0.0} for each in conditions)
    return first == second


def _pair(given: Document, conditions: tuple[Condition, ...]) -> Pair:
    given.check_keys("reference", "comparison")
    reference = _one(given.at("reference"), conditions)
    comparison = _one(given.at("comparison"), conditions)
    if reference == comparison:
        given.refuse(f"comparison = {str(comparison)!r}: must differ from the reference")
    return Pair(reference, comparison)


def _scale(file: Document) -> tuple[float, float, float]:
    if "scale" not in file:
        return Protocol.scale
    low, high, step = file.at("scale").vector(_NUMBER)
    if not 0 < step <= high - low < step * MOST_RATINGS:
        allowed = f"lowest rating, highest rating and step, which give at most {MOST_RATINGS}"
        file.at("scale").wrong(f"must be {allowed}")
    return low, high, step


def _strengths(section: Document, conditions: tuple[Condition, ...]) -> dict[str, float]:
    section.check_keys(*map(str, conditions))
    return {name: each.number() for name, each in section.members()}


def _check_test(given: Document, test: PlannedTest, protocol: Protocol) -> None:
    """Refuse a test that the task cannot answer, or that names no condition."""
    measures = set(MEASURES[protocol.task]) - (set() if protocol.levels else {"threshold"})
    _text(given.at("name"))
    given.get("measure", test.measure).choice(dict.fromkeys(sorted(measures)))
    known = protocol.conditions
    if protocol.pairs and test.measure != "preferred":  # a pair has the name of its comparison
        known = tuple(dict.fromkeys(pair.comparison for pair in protocol.pairs))
    for key, text in (("condition", test.condition), ("against", test.against)):
        if not (matching(known, text) or (key == "against" and _AGAINST.fullmatch(text))):
            given.get(key).wrong(f"must be words of {', '.join(map(str, known))}")
    if test.measure == "preferred" and not test.condition:
        given.refuse("condition = nothing: must be given for preferred", "condition")
    if test.alternative == "equivalent" and not test.margin:
        given.refuse("margin = 0: must be above 0 for equivalent", "margin")


def _check_design(file: Document, protocol: Protocol) -> None:
    """Refuse an order or a procedure that does not suit the protocol."""
    order, kind, block_by = file.get("order", {}), protocol.order.kind, protocol.order.block_by
    procedure = protocol.procedure.kind
    known = {name: each.text for name, (_, each) in own_schema(protocols.Procedure).items()}
    # The description of a key for only some procedures starts with their names.
    used = [name for name, text in known.items() if procedure in text or ":" not in text]
    file.get("procedure", {}).check_keys(*used)
    if procedure != "constant" and protocol.levels and protocol.levels.factor in WHOLE:
        file.get("levels").get("factor").wrong(f"must not be whole numbers for a {procedure}")
    if kind != "random" and procedure != "constant":
        order.get("kind").wrong("must be random, as answers choose the levels")
    if bool(block_by) != (kind == "blocked"):
        order.get("block_by", "").wrong("must be given if the order is blocked, and only then")
    if block_by:
        order.get("block_by").choice(protocol.factors)
        if any(each.reference[block_by] != each.comparison[block_by] for each in protocol.pairs):
            order.get("block_by").wrong("must be the same within each pair")
    try:
        Plan(protocol, seed=0, row=0)
    except ParameterError as error:
        location, _, problem = str(error).partition(" = ")
        section, _, name = location.rpartition(".")
        (file.get(section, {}) if section else file).refuse(f"{name} = {problem}", name)
    participants, balanced = protocol.rules.participants, rows(protocol)
    if participants % balanced:
        allowed = f"must be a multiple of {balanced}, the rows of a Williams square"
        file.get("rules", {}).get("participants", participants).wrong(allowed)
