# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel doctor``: causes of timing jitter on this machine, with suggested fixes.

The command changes nothing. ``haptic-accel bench latency`` measures the graph itself.
``haptic-accel doctor audio`` finds the sound card and channel of a coil.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.markup import escape
from rich.text import Text

from haptic_accel.cli.options import arguments, json_option, one_of, verb
from haptic_accel.cli.output import StoppedError, check_writable, next_command, save
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.core.sampling import DEFAULT_RATE, HIGHEST_LATENCY
from haptic_accel.core.tables import ResultTable
from haptic_accel.core.tick import COMPILED, TICK
from haptic_accel.devices import audio
from haptic_accel.devices.interface import DeviceError
from haptic_accel.graph import machine
from haptic_accel.graph.domain import INSTALL_ROS, has_ros
from haptic_accel.graph.machine import Finding
from haptic_accel.setup import files
from haptic_accel.setup.arguments import POINTER

NO_CARD = (
    "no sound card with an output that can be used: stop JACK if it runs, plug a game controller"
    " in by a USB cable, or a card with an amplifier; in a container, let it have /dev/snd"
)

AGAIN = "r"
"""Answer that plays the tones again."""

TONE = 100.0
"""Frequency of the tones, Hz: coils of game controllers and exciters are strong at this frequency,
and a hand perceives it well."""

SOFT = 0.1
"""Amplitude of the tones, relative to full scale."""

TONE_TIME, FADE_TIME, PAUSE_TIME = 0.8, 0.2, 0.4
"""Length of a tone, of each of its two fades, and of the silence after it, s."""


@dataclass(frozen=True)
class AudioTrialArguments(Checked):
    """Sound card to try: ``doctor audio`` only."""

    device: str = parameter(
        "", "name of the sound card to try, or a part of it; without device and preset none is"
    )
    preset: str = like(audio.AudioParameters, "preset")
    file: str = parameter("audio.yaml", "parameter file to write, new or existing")


def examine(arguments: AudioTrialArguments, json_file: Path | None) -> None:
    """List the sound cards; if one is named, play on its channels and write its parameters."""
    path, is_tried = Path(arguments.file), arguments.device or arguments.preset
    if is_tried:
        check_writable(path, "file")
        files.check_updatable(path)
    try:
        cards = audio.sound_cards()
        save({"cards": [asdict(card) for card in cards]}, json_file)
        usable = [card for card in cards if card.server != audio.JACK]
        if not usable:
            raise StoppedError(NO_CARD)
        _print_cards(cards)
        if not is_tried:
            print(next_command("doctor", audio.AUDIO, _tried_next(usable)))
            return
        if preset := audio.PRESETS.get(arguments.preset):
            print(f"assumed: {preset.assumed}", f"to be identified: {preset.unknown}", sep="\n")
        named = audio.AudioParameters(preset=arguments.preset, device=arguments.device)
        _write(path, *_tested(named))
    except DeviceError as error:
        raise StoppedError(str(error)) from None
    except EOFError:
        raise StoppedError("the input ended before a channel was named: nothing written") from None
    print("a first touch, not a bench, until `identify actuator:=audio` has found the plant")
    assignments = (f"master:={POINTER}", "scope:=true", "scope_control:=true")
    print(next_command(*files.teleop_command("", path, *assignments)))


def _tried_next(cards: Sequence[audio.ListedCard]) -> str:
    """Return the argument for a preset's card, or else for a card without software between."""
    for name, preset in audio.PRESETS.items():
        last = max(audio.AudioParameters(preset=name).channels_of(1))
        if preset.device and any(preset.device in c.name and last <= c.channels for c in cards):
            return f"preset:={name}"
    card = next((each for each in cards if not each.server), cards[0])
    return f"device:={card.name}"


def _print_cards(cards: Sequence[audio.ListedCard]) -> None:
    rows = [
        (
            f"{card.name}{' (default)' if card.is_default else ''}",
            card.server or "nothing",
            f"{card.channels}",
            f"{card.rate:g}",
        )
        for card in cards
    ]
    headings = ("sound card", "in between", "channels", "rate, Hz")
    print_table(ResultTable(headings, rows, "Sound cards with outputs", left=2))


def _tested(parameters: audio.AudioParameters) -> tuple[audio.AudioParameters, audio.SoundCard]:
    """Play on each channel; return parameters with the perceived channels, and the card."""
    print("a soft tone comes on each channel: hold the handle, and start with the amplifier low")
    answer = AGAIN
    while True:
        if answer == AGAIN:
            card = _played_on_all(parameters)
        question = f"which one did you feel? Type it, or several as 3, 4; {AGAIN} to play again\n"
        if (answer := input(question).strip()) == AGAIN:
            continue
        found = replace(parameters, channels=answer or "none")
        try:
            if max(found.channels_of(1)) <= card.channels:
                return found, card
            print(f"audio.channels = {answer}: must be at most {card.channels}")
        except ParameterError as error:
            print(error)


def _played_on_all(parameters: audio.AudioParameters) -> audio.SoundCard:
    """Play on each channel of the card in turn; return the closed card."""
    count = channel = 1
    while channel <= count:
        print(f"channel {channel}", flush=True)
        card = audio.SoundCard(replace(parameters, channels=f"{channel}"), 1 / DEFAULT_RATE)
        with closing(card):
            card.open()
            _play(card)
        # A plug-in that supports any number of channels opens as many as requested.
        count, channel = card.channels if channel == 1 else count, channel + 1
    return card


def _play(card: audio.SoundCard) -> None:
    """Play a tone and a silence on an open card."""
    moments = np.arange(round((TONE_TIME + PAUSE_TIME) * card.rate)) / card.rate
    rise = np.clip(np.minimum(moments, TONE_TIME - moments) / FADE_TIME, 0.0, 1.0)
    samples = SOFT * (rise * np.sin(2 * np.pi * TONE * moments))[:, np.newaxis]
    card.play(samples)


def _write(path: Path, found: audio.AudioParameters, card: audio.SoundCard) -> None:
    """Write a card's parameters, and the latency that its blocks need at the default rate."""
    own = {name: getattr(found, name) for name in ("preset", "device", "channels")}
    latency = math.ceil(card.lead * DEFAULT_RATE) + 1
    if latency > HIGHEST_LATENCY:
        raise StoppedError(
            f"sound card {card.name}: needs latency:={latency} with {card.block} samples a block,"
            f" must be at most {HIGHEST_LATENCY}; name the card itself (hw:), without a server"
        )
    nodes: dict[str, dict[str, Any]] = {
        files.EVERY_NODE: {"latency": latency},
        "master_device": {"actuator_device": audio.AUDIO, audio.AUDIO: own},
    }
    files.update_parameter_file(path, nodes)
    print(f"parameters: {path}, for params_file:={path}")


COLOURS = {"ok": "green", "warning": "yellow", "problem": "red"}


@verb(
    "haptic-accel doctor",
    "haptic-accel doctor audio",
    "haptic-accel doctor audio preset:=dualsense",
)
@click.argument("part", required=False, type=one_of([audio.AUDIO]), metavar=f"[{audio.AUDIO}]")
@arguments(AudioTrialArguments)
@json_option
def doctor(part: str | None, arguments: AudioTrialArguments, json_file: Path | None) -> None:
    """Find causes of timing jitter on this machine and suggest fixes.

    Nothing is changed. An empty loop of two seconds shows whether this machine, now, can hold the
    default rate; haptic-accel bench latency measures the graph itself.

    With audio, list the sound cards, and what is in between. Play a soft tone on each channel of
    a card that device:=NAME or preset:=NAME names, ask which one is felt, and write file:=FILE.
    """
    if part:
        examine(arguments, json_file)
        return
    findings = [*machine.machine_findings(), tick_finding()]
    unusable = ""
    try:
        findings += ros_findings()
    except Exception as error:  # a broken installation may raise anything
        unusable = " ".join(f"{type(error).__name__}: {error}".split())
    _print(findings)
    save({"findings": [asdict(finding) for finding in findings]}, json_file)
    if unusable:
        raise StoppedError(f"rclpy cannot be used: {unusable}")


def tick_finding() -> Finding:
    """Report whether the tick is compiled or runs in plain Python."""
    if TICK == COMPILED:
        return Finding("tick", "ok", TICK)
    fix = "install a C compiler and Python's headers (gcc, python3-dev), then haptic_accel again"
    return Finding("tick", "warning", TICK, "a sample takes more processor time", fix)


def ros_findings() -> Iterator[Finding]:
    """Check ROS 2 in the environment of a node."""
    if not has_ros():
        meaning = "no graph runs here; lockstep, analysis, design and textures do"
        yield Finding("ROS 2", "warning", "not installed", meaning, INSTALL_ROS)
        return
    # This imports ROS, which may be broken.
    from haptic_accel.nodes.installation import node_findings

    yield from node_findings()


def _print(findings: Sequence[Finding]) -> None:
    rows = []
    for finding in findings:
        colour = COLOURS[finding.level]
        text = escape(finding.found)
        for label, line in (("meaning", finding.meaning), ("fix", finding.fix)):
            text += f"\n[bold]{label}:[/bold] {escape(line)}" if line else ""
        level = Text(finding.level, style=colour)
        rows.append((level, finding.name, Text.from_markup(text)))
    headings = ("", "check", "finding, meaning and fix")
    print_table(ResultTable(headings, rows, "Real time on this machine", left=3))
