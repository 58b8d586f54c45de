# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tests of protocols as files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import ODD_TEXTS, accepted, fuzz, mutated
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits import study
from haptic_accel.kits.study.folder import templates
from haptic_accel.kits.study.protocol import Condition
from haptic_accel.kits.study.reading import KEYS, MEASURES, matching, read_protocol

PROTOCOL: dict[str, Any] = {
    "title": "Study",
    "task": "2ifc",
    "question": "Which was stronger?",
    "instructions": "Touch twice.",
    "consent": {"version": "1", "text": "I agree."},
    "factors": {"controller": ["none", "adaptive"], "surface": ["plywood", "vinyl"]},
}

LEVELS = {"factor": "gain", "reference": 1.0, "values": [1.1, 1.5, 2.0], "scale": "log"}

TEXTS = [path.read_text() for path in templates().values()]

TEST = {"name": "Test", "condition": "controller=adaptive"}

PREFER = {"task": "preference"}
PREFERRED = {"name": "Test", "measure": "preferred"}
LATENCIES = LEVELS | {"factor": "latency"}
GAINS = {"gain": [1, 2]}
MANY = {"gain": list(range(11)), "latency": list(range(10))}
SAME = {"reference": "gain=1", "comparison": "gain=1"}
STAIRCASE, QUEST, WILLIAMS = ({"kind": kind} for kind in ("staircase", "quest_plus", "williams"))
STEPLESS = STAIRCASE | {"step_up": 1.0}
CHOSEN = {"levels": LEVELS, "procedure": QUEST}


def blocked(factor: str) -> dict[str, str]:
    return {"kind": "blocked", "block_by": factor}


def written(folder: Path, **changes: Any) -> Path:
    """Write a protocol with changes; None removes a key."""
    path = folder / "study.yaml"
    content = {key: each for key, each in (PROTOCOL | changes).items() if each is not None}
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def refusal(path: Path) -> str:
    with pytest.raises(ParameterError) as caught:
        read_protocol(path)
    return str(caught.value).removeprefix(f"{path}:")


def test_conditions_are_all_combinations_of_the_factors(tmp_path: Path) -> None:
    found = read_protocol(written(tmp_path))
    assert [str(each) for each in found.conditions] == [
        "controller=none surface=plywood",
        "controller=none surface=vinyl",
        "controller=adaptive surface=plywood",
        "controller=adaptive surface=vinyl",
    ]
    assert len(found.pairs) == 6


def test_conditions_and_pairs_can_be_listed(tmp_path: Path) -> None:
    listed = ["controller=none surface=vinyl", "surface=vinyl controller=adaptive"]
    pair = {"reference": "controller=none", "comparison": "controller=adaptive"}
    found = read_protocol(written(tmp_path, conditions=listed, pairs=[pair]))
    assert [each["controller"] for each in found.conditions] == ["none", "adaptive"]
    assert [(each.reference, each.comparison) for each in found.pairs] == [found.conditions]


def test_levels_are_compared_with_their_reference_in_each_other_condition(tmp_path: Path) -> None:
    factors = {"surface": ["plywood", "vinyl"]}
    found = read_protocol(written(tmp_path, factors=factors, levels=LEVELS))
    assert found.factors["gain"] == (1.0, 1.1, 1.5, 2.0)
    assert len(found.conditions) == 8
    assert [each.level for each in found.pairs] == [1.1, 1.5, 2.0] * 2
    assert {each.reference["gain"] for each in found.pairs} == {1.0}
    assert all(each.reference["surface"] == each.comparison["surface"] for each in found.pairs)


@pytest.mark.parametrize("name", [*sorted(KEYS), *MEASURES, "gain", "network"])
def test_each_key_task_and_factor_is_documented(name: str) -> None:
    page = Path(study.__path__[0], "protocol.md").read_text()
    assert re.search(rf"^\|.*`{name}[`.]", page, re.MULTILINE)


@pytest.mark.parametrize("task", ["rating", "identification"])
def test_a_task_with_one_stimulus_has_no_pairs(task: str, tmp_path: Path) -> None:
    assert read_protocol(written(tmp_path, task=task)).pairs == ()


def test_sections_that_are_not_given_have_their_defaults(tmp_path: Path) -> None:
    found = read_protocol(written(tmp_path, timing={"seconds": 3}))
    assert (found.timing.seconds, found.timing.gap) == (3.0, 0.5)
    assert found.procedure.kind == "constant"


def test_values_of_the_graph_become_words(tmp_path: Path) -> None:
    graph = {"latency": 2, "rate": 1000.0, "coupling": "passive"}
    found = read_protocol(written(tmp_path, graph=graph)).graph
    assert found == {"latency": "2", "rate": "1000", "coupling": "passive"}


def test_the_digest_is_that_of_the_content_without_comments(tmp_path: Path) -> None:
    path = written(tmp_path)
    first = read_protocol(path).digest
    path.write_text("# a comment\n" + path.read_text())
    assert read_protocol(path).digest == first
    assert read_protocol(written(tmp_path, title="Other")).digest != first


def test_conditions_are_found_by_some_of_their_words() -> None:
    one, two = (Condition((("controller", "none"), ("gain", gain))) for gain in (1.0, 2.0))
    assert matching((one, two), "gain=2") == (two,)
    assert matching((one, two), "controller=none") == matching((one, two), "") == (one, two)
    assert matching((one, two), "controller=constant") == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"title": None}, "title = nothing: must be given"),
        ({"title": " "}, "title = ' ': must be text"),
        ({"consent": {"version": 1, "text": "x"}}, "consent.version = 1: must be text"),
        ({"task": "afc"}, f"task = 'afc': must be one of {', '.join(MEASURES)}"),
        ({"facotrs": {}}, "facotrs: unknown (did you mean factors?)"),
        ({"timing": {"second": 1}}, "timing.second: unknown (did you mean seconds?)"),
        ({"timing": {"seconds": 0}}, "timing.seconds = 0: must be from 0.2 to 60 s"),
        ({"graph": {"bag": "x"}}, "graph.bag: unknown"),
        ({"graph": {"surface": "vinyl"}}, "graph.surface: must be in factors alone"),
        ({"factors": {"colour": ["red"]}}, "factors.colour: unknown"),
        ({"factors": {"controller": ["none"]}}, "factors: must give 2 to 100 conditions, not 1"),
        ({"factors": MANY}, "factors: must give 2 to 100 conditions, not 110"),
        (
            {"factors": {"gain": [1, 1.0]}},
            "factors.gain = [1, 1.0]: must be different values, at least one",
        ),
        (
            {"factors": {"surface": ["my wood.yaml"]}},
            "factors.surface.0 = 'my wood.yaml': must be a word without spaces, or a number",
        ),
        ({"conditions": ["gain=1"]}, "conditions.0 = 'gain=1': must be one of controller=none"),
        (
            {"pairs": [SAME]},
            "pairs.0.reference = 'gain=1': must be one of controller=none surface=ply",
        ),
        (
            {"factors": GAINS, "pairs": [SAME]},
            "pairs.0.comparison = 'gain=1': must differ from the reference",
        ),
        (
            {"levels": LEVELS | {"values": [0.5, 2.0]}},
            "levels.values = [0.5, 2.0]: must be all above or all below the reference, 1",
        ),
        ({"levels": LEVELS | {"factor": "hue"}}, "levels.factor = 'hue': must be one of contro"),
        ({"factors": GAINS, "levels": LEVELS}, "factors.gain: must be in levels alone"),
        (
            {"levels": LEVELS, "pairs": []},
            "pairs = []: must be different pairs, at least one, or levels",
        ),
        ({"procedure": STAIRCASE}, "procedure.kind = 'staircase': needs levels"),
        (
            {**CHOSEN, **PREFER},
            "procedure.kind = 'quest_plus': must be constant for task 'preference'",
        ),
        ({"procedure": {"down": 3}}, "procedure.down: unknown: must be one of kind, repeats"),
        (
            {"levels": LEVELS, "procedure": STEPLESS},
            "procedure.step = 1: must be above 1 as a factor",
        ),
        (
            {**CHOSEN, "order": WILLIAMS},
            "order.kind = 'williams': must be random, as answers choose the levels",
        ),
        (
            {"levels": LATENCIES, "procedure": STAIRCASE},
            "levels.factor = 'latency': must not be whole numbers for a staircase",
        ),
        (
            {"order": blocked("grip")},
            "order.block_by = 'grip': must be one of controller, surface",
        ),
        (
            {"order": blocked("surface")},
            "order.block_by = 'surface': must be the same within each pair",
        ),
        ({"order": {"block_by": "grip"}}, "order.block_by = 'grip': must be given if the order"),
        (
            {"task": "rating", "order": WILLIAMS, "rules": {"participants": 10}},
            "rules.participants = 10: must be a multiple of 4, the rows of a Williams square",
        ),
        (
            {"task": "rating", "scale": [0, 10, 20]},
            "scale = [0, 10, 20]: must be lowest rating, highest rating and step, which give",
        ),
        ({"task": "rating", "scale": [0, 9, 0.001]}, "scale = [0, 9, 0.001]: must be lowest rat"),
        ({"task": "rating", "extras": {"catch_every": 9}}, "extras.catch_every = 9: must be 0 wi"),
        ({"strengths": {"gain=1": 0.0}}, "strengths.gain=1: unknown"),
        ({"tests": [{}]}, "tests.0.name = nothing: must be given"),
        (
            {"tests": [TEST | {"measure": "rating"}]},
            "tests.0.measure = 'rating': must be one of correct, d_prime",
        ),
        ({"tests": [TEST | {"condition": "gain=9"}]}, "tests.0.condition = 'gain=9': must be wor"),
        (
            {"tests": [TEST | {"against": "nothing"}]},
            "tests.0.against = 'nothing': must be words of controller=none",
        ),
        (
            {**PREFER, "tests": [PREFERRED]},
            "tests.0.condition = nothing: must be given for preferred",
        ),
        (
            {"tests": [TEST | {"alternative": "equivalent"}]},
            "tests.0.margin = 0: must be above 0 for equivalent",
        ),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    _, _, found = refusal(written(tmp_path, **changes)).partition(": ")
    assert found.startswith(message)
    assert "\n" not in found


def test_an_error_has_the_line_of_its_value(tmp_path: Path) -> None:
    path = written(tmp_path, timing={"gap": 0.5, "seconds": 0.0})
    line = 1 + path.read_text().splitlines().index("  seconds: 0.0")
    assert refusal(path) == f"{line}: timing.seconds = 0.0: must be from 0.2 to 60 s"


def test_a_number_can_be_what_a_test_is_against(tmp_path: Path) -> None:
    (test,) = read_protocol(written(tmp_path, tests=[TEST | {"against": "-1"}])).tests
    assert test.against == "-1"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="no.yaml: must be a readable file: No such file"):
        read_protocol(tmp_path / "no.yaml")


@fuzz
@given(mutated(st.sampled_from(TEXTS), st.sampled_from(ODD_TEXTS)))
def test_a_damaged_protocol_is_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.yaml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    accepted(lambda: read_protocol(path))
