from __future__ import annotations

import re

import pytest

from verbs import refusal, status_of


@pytest.mark.parametrize("verb", ["teleop", "experiment"])
def test_help_lists_every_argument_with_default_and_unit(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(verb, "--help") == 0
    # A description may go on in the next line.
    text = re.sub(r"\n {4,}", " ", capsys.readouterr().out)
    names = ["controller", "surface", "master", "slave", "rate", "duration", "record"]
    for name in [*names, "bag", "config", "seed"]:
        assert re.search(rf"^  {name} .*\(default: ", text, re.MULTILINE), text
    assert "[Hz] (default: 1000.0)" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "a verb is missing; there are teleop, control, "),
        (["dance"], "dance: no such verb; there are teleop, "),
        (["telepo"], "telepo: no such verb (did you mean teleop?); there are teleop, "),
        (["bench", "latncy"], "latncy: no such verb (did you mean latency?); there are latency"),
        (["teleop", "--fast"], "No such option '--fast'"),
        (["experiment", "--lokstep"], "No such option '--lokstep'. Did you mean '--lockstep'?"),
        (["experiment", "--seeds"], "Option '--seeds' requires an argument."),
        (["experiment", "--seeds", "two"], "Invalid value for '--seeds': 'two' is not a valid"),
        (["bench", "sweep", "--rates", "1,b"], "Invalid value for '--rates': '1,b': must be"),
        (["teleop", "fast"], "'fast': must have the form key:=value"),
        (["teleop", "surfce:=text"], "surfce: no such argument (did you mean surface?); there"),
        (["teleop", "controller:=dynamc"], "controller = 'dynamc': must be one of none, "),
        (["bag", "repair"], "Missing argument 'BAG...'."),
    ],
)
def test_wrong_words_are_answered_in_one_line_with_the_nearest(
    words: list[str], message: str
) -> None:
    assert refusal(*words).replace(". (Did", ". Did").startswith(message)
