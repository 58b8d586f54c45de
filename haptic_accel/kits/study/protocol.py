# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protocol of a study: conditions, task, order of trials, bounds and planned tests.

Jones, Tan, "Application of psychophysical techniques to haptic research", IEEE Transactions on
Haptics 6(3), 2013; Hatzfeld et al., Multimodal Technologies and Interaction 1(4):28, 2017.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from haptic_accel import Checked, parameter

Value: TypeAlias = str | float
"""Value of a factor: a word, such as a controller, or a number, such as a gain."""


@dataclass(frozen=True)
class Condition:
    """Values of factors that hold while a stimulus is presented.

    Attributes
    ----------
    settings : tuple of (str, str or float)
        Factors and their values, in the order of the protocol.

    Examples
    --------
    >>> condition = Condition((("controller", "adaptive"), ("gain", 0.5)))
    >>> str(condition), condition["gain"]
    ('controller=adaptive gain=0.5', 0.5)
    """

    settings: tuple[tuple[str, Value], ...]

    def __getitem__(self, factor: str) -> Value:
        """Return the value of a factor."""
        return dict(self.settings)[factor]

    def __str__(self) -> str:
        """Return factors and values in one line."""
        return " ".join(
            f"{factor}={value:g}" if isinstance(value, float) else f"{factor}={value}"
            for factor, value in self.settings
        )


@dataclass(frozen=True)
class Pair:
    """Two conditions to be compared.

    Attributes
    ----------
    reference, comparison : Condition
    level : float or None
        Value of the varied factor in the comparison; None if no factor is varied.
    """

    reference: Condition
    comparison: Condition
    level: float | None = None


@dataclass(frozen=True)
class Timing(Checked):
    """Times of a trial."""

    seconds: float = parameter(2.0, "duration of a stimulus", "s", 0.2, 60.0)
    gap: float = parameter(0.5, "time without vibration between two stimuli", "s", 0.1, 10.0)


@dataclass(frozen=True)
class Procedure(Checked):
    """Rule by which the levels or pairs of the trials are chosen.

    A staircase with `down` steps after correct answers and one step up after a wrong one converges
    to a proportion correct (Levitt 1971); with different sizes of step it is weighted (Kaernbach
    1991). QUEST+ chooses the level of the least expected entropy (Watson 2017).
    """

    kind: str = parameter("constant", "procedure", choices=("constant", "staircase", "quest_plus"))
    repeats: int = parameter(
        10, "constant: number of presentations of each pair or condition", "", 1, 1000
    )
    trials: int = parameter(
        60, "quest_plus: number of trials; staircase: maximum number in a track", "", 5, 1000
    )
    down: int = parameter(2, "staircase: successive correct answers before a step down", "", 1, 5)
    step_up: float = parameter(
        2.0, "staircase: size of first step up (level's unit, or a factor)", "", 0, above=True
    )
    step_down: float = parameter(
        2.0, "staircase: size of first step down (level's unit, or a factor)", "", 0, above=True
    )
    reversals: int = parameter(8, "staircase: number of reversals that end a track", "", 2, 100)
    fine_after: int = parameter(
        2,
        "staircase: number of reversals after which steps are halved (factors: square root)",
        "",
        0,
        100,
    )
    tracks: int = parameter(2, "staircase: number of interleaved tracks", "", 1, 8)


@dataclass(frozen=True)
class Levels:
    """Factor that is varied in steps between reference and comparison.

    Attributes
    ----------
    factor : str
    reference : float
        Level of the reference.
    values : tuple of float
        Levels of the comparison, all above or all below the reference; a staircase or QUEST+
        stays between the smallest and the largest.
    scale : str
        ``linear``, or ``log`` where steps are factors and the psychometric function is one of the
        logarithm of the distance from the reference.
    """

    factor: str
    reference: float
    values: tuple[float, ...]
    scale: str = "linear"


@dataclass(frozen=True)
class Order(Checked):
    """Order of the trials of a constant procedure."""

    kind: str = parameter(
        "random",
        "order: random, in blocks of one value of a factor, or conditions in the rows of a"
        " Williams square",
        choices=("random", "blocked", "williams"),
    )
    block_by: str = parameter("", "factor whose values make the blocks")


@dataclass(frozen=True)
class Extras(Checked):
    """Practice trials, catch trials and breaks."""

    practice: int = parameter(4, "number of practice trials, which are not analysed", "", 0, 200)
    feedback: bool = parameter(True, "feedback on the answer after a practice trial")
    catch_every: int = parameter(
        0, "trials between two catch trials, whose answer is certain; 0 for none", "", 0, 1000
    )
    break_every: int = parameter(40, "trials between two breaks; 0 for none", "", 0, 1000)
    break_seconds: float = parameter(60.0, "minimum duration of a break", "s", 0, 3600)


@dataclass(frozen=True)
class Bounds(Checked):
    """Bounds within which a stimulus counts as delivered; a trial beyond them is repeated."""

    error: float = parameter(
        0.0, "largest error (NRMSE) of conditions with a controller; 0 for no bound", "%", 0, 1000
    )
    least_rms: float = parameter(0.3, "least RMS of the desired acceleration", "m/s^2", 0, 100)
    clipped: float = parameter(5.0, "largest share of time at the limit of force", "%", 0, 100)
    late: float = parameter(2.0, "largest share of time with a late force", "%", 0, 100)
    lost: float = parameter(1.0, "largest share of missing samples", "%", 0, 100)
    repeats: int = parameter(2, "maximum number of repeats of an undelivered trial", "", 0, 20)


@dataclass(frozen=True)
class Limits(Checked):
    """Limits of a session, for the participant's safety."""

    exposure: float = parameter(
        2.5,
        "largest daily exposure A(8) of hand and arm (Directive 2002/44/EC: action 2.5, limit 5)",
        "m/s^2",
        0.01,
        5.0,
    )
    minutes: float = parameter(60.0, "maximum session time without breaks", "min", 1, 480)


@dataclass(frozen=True)
class Masking(Checked):
    """Noise from the participant's page that masks the sound of the coils."""

    level: float = parameter(
        -100.0, "level of the noise (dB of full scale); -100 for none", "dB", -100, 0
    )


@dataclass(frozen=True)
class Rules(Checked):
    """Rules fixed before the first participant."""

    participants: int = parameter(12, "required number of complete participants", "", 1, 10_000)
    catch_correct: float = parameter(
        75.0, "least share of correct catch trials; below, a participant is excluded", "%", 0, 100
    )
    left_out: float = parameter(
        20.0, "largest share of trials left out; above, a participant is excluded", "%", 0, 100
    )


@dataclass(frozen=True)
class PlannedTest(Checked):
    """Test that is planned before the first participant."""

    name: str = parameter("", "name of the test in the report")
    measure: str = parameter(
        "correct",
        "value of each participant: proportion correct, d', threshold, preference or mean rating",
        choices=("correct", "d_prime", "threshold", "preferred", "rating"),
    )
    condition: str = parameter(
        "", "condition whose value is tested, as factor=value words; empty for all trials"
    )
    against: str = parameter("", "condition or number to compare with; empty for chance, or for 0")
    alternative: str = parameter(
        "two-sided",
        "alternative hypothesis",
        choices=("two-sided", "greater", "less", "equivalent"),
    )
    margin: float = parameter(0.0, "largest difference that counts as equivalent", "", 0)
    alpha: float = parameter(
        0.05, "significance level: probability of a type I error", "", 0, 0.5, above=True
    )


@dataclass(frozen=True)
class Observer(Checked):
    """Simulated observer, for `simulate`.

    Comparison tasks follow Thurstone: each stimulus causes a normally distributed sensation of
    standard deviation 1, with the mean `strength` of its condition, or of its level.
    """

    threshold: float = parameter(
        1.0,
        "distance of a level from the reference at which d' is 1, on the levels' scale",
        "",
        0,
        above=True,
    )
    slope: float = parameter(1.0, "exponent of d' over that distance", "", 0, 10, above=True)
    lapse: float = parameter(0.02, "share of random answers", "", 0, 1)
    spread: float = parameter(
        0.0, "standard deviation between observers of strengths, or of the log threshold", "", 0, 5
    )


@dataclass(frozen=True)
class Consent:
    """Text that a participant agrees to.

    Attributes
    ----------
    version : str
        Version that the ethics board approved; kept with the answer.
    text : str
    """

    version: str
    text: str


@dataclass(frozen=True)
class Protocol:
    """Protocol of a study.

    Attributes
    ----------
    title : str
    task : str
        One of `tasks.TASKS`.
    question : str
        Question on the page after the stimuli.
    graph : mapping
        Arguments of the graph that hold in all conditions, as for ``teleop``.
    factors : mapping
        Values of each factor: an argument of the graph, ``gain`` or ``network``.
    conditions : tuple of Condition
        All combinations of the factors, or the listed ones.
    pairs : tuple of Pair
        Comparisons; empty for tasks with one stimulus.
    levels : Levels or None
    scale : tuple of (float, float, float)
        Lowest and highest rating and its step.
    timing, procedure, order, extras, bounds, limits, masking, rules, observer
    strengths : mapping
        Mean sensation of a simulated observer by condition, as text.
    tests : tuple of PlannedTest
    consent : Consent
    instructions : str
    language : str
        Language of the page, or a file with its texts.
    digest : str
        SHA-256 of the content without comments, which identifies the version.
    source : Path
    content : str
        Text of the file, kept with each version.
    """

    title: str
    task: str
    question: str
    graph: Mapping[str, str]
    factors: Mapping[str, tuple[Value, ...]]
    conditions: tuple[Condition, ...]
    pairs: tuple[Pair, ...]
    consent: Consent
    instructions: str
    digest: str
    source: Path
    content: str
    levels: Levels | None = None
    scale: tuple[float, float, float] = (0.0, 100.0, 1.0)
    timing: Timing = field(default_factory=Timing)
    procedure: Procedure = field(default_factory=Procedure)
    order: Order = field(default_factory=Order)
    extras: Extras = field(default_factory=Extras)
    bounds: Bounds = field(default_factory=Bounds)
    limits: Limits = field(default_factory=Limits)
    masking: Masking = field(default_factory=Masking)
    rules: Rules = field(default_factory=Rules)
    observer: Observer = field(default_factory=Observer)
    strengths: Mapping[str, float] = field(default_factory=dict)
    tests: tuple[PlannedTest, ...] = ()
    language: str = "en"
