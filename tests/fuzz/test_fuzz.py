"""Spoiled inputs of every kind, and missions: a few of those that ``make fuzz`` tries."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.fuzz import harness, vehicles
from tests.fuzz.harness import Draw, Target, Try, run
from tests.fuzz.mutants import damaged, spoiled
from tests.fuzz.targets import TARGETS

WHOLE = {3, 5, 6, 8}  # ports of attitude, log, localisation, high level: less is nothing


@pytest.mark.extended
@pytest.mark.parametrize("target", [t for t in TARGETS if t.few], ids=lambda target: target.name)
def test_no_input_breaks_a_reader(target: Target, tmp_path: Path) -> None:
    report = run(target, tmp_path, target.few, seed=0)
    assert not report.defects, "\n".join(text for _number, text in report.defects.values())
    assert report.outcomes.total() == target.few
    assert len(report.outcomes) > 1, report.outcomes  # some are refused, and some are not


@pytest.mark.parametrize("packet", [packet for packet in vehicles.GOOD if packet[0] >> 4 in WHOLE])
def test_a_datagram_that_is_cut_off_changes_nothing(packet: bytes) -> None:
    with vehicles.flying() as fleet:
        before = fleet.simulator.drones[0].copy()
        for length in range(1, len(packet)):
            fleet.handle(0, packet[:length])
        assert fleet.simulator.drones[0] == before


@pytest.mark.parametrize("spoil", [spoiled, damaged])
def test_the_same_seed_makes_the_same_input(spoil: Callable[[bytes, Draw], bytes]) -> None:
    content = b"star: 1\nname: x\nswarm: {cf1: {start: [0, 0, 0]}}\n" * 5
    made = [[spoil(content, draw_of(i)) for i in range(30)] for _ in range(2)]
    assert made[0] == made[1]
    assert len(set(made[0])) > 20


def draw_of(seed: int | str) -> Draw:
    return random.Random(seed)  # noqa: S311 -- no secret


def outcomes(attempt: Try, folder: Path, count: int) -> harness.Report:
    @contextmanager
    def opened(_folder: Path) -> Iterator[Try]:
        yield attempt

    return run(Target("mine", 1, 1, opened), folder, count, seed=0)


def test_what_a_reader_raises_is_a_defect_with_its_first_input(tmp_path: Path) -> None:
    def attempt(draw: Draw) -> str:
        if draw.random() < 0.5:
            raise KeyError("lost")
        return "good"

    report = outcomes(attempt, tmp_path, 50)
    assert report.outcomes["DEFECT"] > 10
    ((number, text),) = report.defects.values()
    assert report.outcomes.total() == 50
    assert "KeyError: 'lost'" in text
    assert draw_of(f"mine-0-{number}").random() < 0.5


def test_an_input_that_takes_too_long_is_a_defect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(harness, "MAX_WALL", 0.05)

    def attempt(_draw: Draw) -> str:
        time.sleep(30)
        return "good"

    report = outcomes(attempt, tmp_path, 1)
    assert report.outcomes == {"DEFECT": 1}
