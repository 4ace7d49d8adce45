"""Drones come down softly whatever their links, their firmware or the operator do.

All flights are simulated on a virtual clock (`virtual_air`). Campaigns:
``pytest -m campaign tests/end_to_end/test_landings.py``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from star_core import Operator
from star_fleet.link_faults import LinkFaults
from tests.campaign.link_cuts import bad_link_flight, spoil_links
from tests.end_to_end.virtual_air import LINK_LOST, TAKEN_OFF, Air, Flown, flown

pytest.importorskip("cflib")

N = 3
LOSS = LinkFaults(loss=0.2)
JITTER = LinkFaults(delay=0.02, jitter=0.1)
HOVER = """\
  - takeoff: {height: 0.5}
  - hold: {for: 5}
  - land: {}
"""


class Script:
    """Does something to a flight when all drones have been up for a while.

    Args:
        times: After how long, s, each step is done.
    """

    def __init__(self, *times: float) -> None:
        self.times = times
        self.done: list[float] = []  # s of the fleet's time
        self._up: float | None = None

    def __call__(self, air: Air, operator: Operator) -> None:
        now = air.fleet.time
        if self._up is None and (air.height > TAKEN_OFF).all():
            self._up = now
        if self._up is None:
            return
        step = len(self.done)
        if step < len(self.times) and now >= self._up + self.times[step]:
            self.done.append(now)
            self.act(step, air, operator)
        if self.done:
            self.look(air)

    def act(self, step: int, air: Air, operator: Operator) -> None:
        """Do a step."""
        raise NotImplementedError

    def look(self, air: Air) -> None:
        """Look at the drones, after each cycle since the first step."""


def cuts(seed: int) -> list[LinkFaults]:
    """One cut of 0.35 to 1.5 s for each drone, at any time of the flight."""
    draw = np.random.default_rng(seed)
    begins, lengths = draw.uniform(0.0, 3.5, N), draw.uniform(0.35, 1.5, N)
    return [
        LinkFaults(cuts=((at, at + length),))
        for at, length in zip(begins.tolist(), lengths.tolist(), strict=True)
    ]


def falls(folder: Path, flights: int, faults: LinkFaults | None) -> list[tuple[int, list[int]]]:
    """Fly several short flights; return the seeds of those with falls, and which drones fell."""
    crashes = []
    for seed in range(flights):
        each = cuts(seed) if faults is None else [faults] * N
        flight = flown(folder, n=N, seed=seed, faults=each)
        if flight.fallen:
            crashes.append((seed, flight.fallen))
    return crashes


@pytest.mark.extended
@pytest.mark.parametrize("flights", [1, pytest.param(100, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("faults", [LOSS, JITTER, None], ids=["loss", "jitter", "cuts"])
def test_no_drone_falls_over_a_bad_link(
    tmp_path: Path, faults: LinkFaults | None, flights: int
) -> None:
    assert falls(tmp_path, flights, faults) == []


@pytest.mark.parametrize("length", [0.6, 1.0])
def test_a_drone_whose_link_was_cut_in_flight_lands(tmp_path: Path, length: float) -> None:
    faults = [LinkFaults(), LinkFaults(cuts=((1.0, 1.0 + length),)), LinkFaults()]
    flight = flown(tmp_path, steps=HOVER, faults=faults)
    assert flight.fallen == []


@pytest.mark.extended
@pytest.mark.parametrize(
    "seed", [39, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in (54, 89))]
)
def test_no_drone_falls_over_links_that_lose_and_delay_packets(seed: int) -> None:
    """With these seeds the first landings are confirmed too late."""
    outcome = bad_link_flight(seed)
    assert outcome.completed
    assert not outcome.fell
    assert not outcome.aloft


@pytest.mark.extended
@pytest.mark.parametrize(
    "seed", [2, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in (3, 6))]
)
def test_no_report_ends_over_udp_links_that_lose_packets(tmp_path: Path, seed: int) -> None:
    """No dongle polls: without any packet for 1 s the firmware deletes its log blocks."""
    flight = flown(tmp_path, seed=seed, polls=False, watch=spoil_links)
    assert flight.fallen == []
    assert flight.summary["outcome"] == "completed"


class _CutInTakeOff:
    """The link of the second drone is cut while it climbs.

    Args:
        length: Of the cut, s.
    """

    def __init__(self, length: float) -> None:
        self._length: float | None = length

    def __call__(self, air: Air, operator: Operator) -> None:
        if self._length is not None and air.height[1] > 0.2:
            now = air.fleet.time
            air.links.faults[1] = LinkFaults(cuts=((now, now + self._length),))
            self._length = None


@pytest.mark.extended
@pytest.mark.parametrize(
    "length", [0.6, *(pytest.param(s, marks=pytest.mark.campaign) for s in (1.5, 3.0)), 5.0]
)
def test_a_drone_whose_link_was_cut_in_its_take_off_lands(tmp_path: Path, length: float) -> None:
    """It hovers meanwhile: its firmware stops no motors that its own commander flies."""
    flight = flown(tmp_path, watch=_CutInTakeOff(length))
    assert flight.fallen == []
    texts = [event["text"] for event in flight.summary["events"]]
    assert ("cf2 is lost" in texts) == (length > 0.5)
    assert not any("rebooted" in text for text in texts)


@pytest.mark.extended
@pytest.mark.parametrize("length", [1.5, 1.7])
def test_no_drone_falls_when_all_links_are_cut_in_flight(tmp_path: Path, length: float) -> None:
    faults = [LinkFaults(cuts=((1.0, 1.0 + length),))] * N
    flight = flown(tmp_path, steps=HOVER, faults=faults)
    assert flight.fallen == []
    assert not any("rebooted" in event["text"] for event in flight.summary["events"])


class _Interrupted(Script):
    """The operator presses Ctrl-C twice."""

    motors_on = 0.0  # s, that motors ran later than 0.2 s after the second time

    def act(self, step: int, air: Air, operator: Operator) -> None:
        operator.stops = step + 1

    def look(self, air: Air) -> None:
        if len(self.done) > 1 and air.fleet.time > self.done[1] + 0.2:
            self.motors_on += 0.01 * bool(air.drones["mode"].any())


@pytest.mark.extended
@pytest.mark.parametrize("faults", [LinkFaults(), LOSS], ids=["perfect", "loss"])
def test_a_second_interrupt_stops_the_motors_and_they_stay_off(
    tmp_path: Path, faults: LinkFaults
) -> None:
    operator = _Interrupted(1.0, 2.0)
    flight = flown(tmp_path, steps=HOVER, faults=[faults] * N, watch=operator)
    assert flight.summary["reason"].endswith("stopped, motors off")
    assert len(operator.done) == 2
    assert operator.motors_on == (0.0 if faults == LinkFaults() else pytest.approx(0.0, abs=0.3))
    assert (flight.air.drones["mode"] == 0).all()


class _Gone(Script):
    """The second drone is heard no more."""

    down = float("inf")  # s, when the others were on the ground

    def act(self, step: int, air: Air, operator: Operator) -> None:
        air.links.faults[1] = LinkFaults(loss=1.0)

    def look(self, air: Air) -> None:
        if (air.height[[0, 2]] <= 0).all():
            self.down = min(self.down, air.fleet.time)


@pytest.mark.extended
def test_a_drone_that_is_gone_for_good_does_not_delay_the_end(tmp_path: Path) -> None:
    gone = _Gone(1.0)
    flight = flown(tmp_path, steps=HOVER, watch=gone, after=0.0)
    assert "cf2 did not report to be on the ground" in flight.summary["reason"]
    assert flight.air.fleet.time < gone.down + 5.0  # its landing ends 0.15 m below the floor


class _Rebooted(Script):
    """The second drone reboots."""

    motors_on = 0.0  # s, afterwards

    def act(self, step: int, air: Air, operator: Operator) -> None:
        air.fleet.reboot(1)

    def look(self, air: Air) -> None:
        self.motors_on += 0.01 * bool(air.drones["mode"][1] != 0)


@pytest.mark.extended
@pytest.mark.parametrize("changes", [[], [LINK_LOST]], ids=["fails", "goes on"])
def test_a_drone_that_rebooted_is_reported_and_not_started_again(
    tmp_path: Path, changes: list[str]
) -> None:
    reboot = _Rebooted(1.0)
    flight = flown(tmp_path, steps=HOVER, changes=changes, watch=reboot)
    assert reboot.done
    assert reboot.motors_on == 0.0
    texts = [event["text"] for event in flight.summary["events"]]
    assert "cf2 rebooted in flight: its motors stopped; it is not flown any more" in texts
    assert flight.fallen == [1]


class _TakeOffEnded(Script):
    """The operator ends the flight while the drones climb."""

    def __call__(self, air: Air, operator: Operator) -> None:
        if (air.height > 0.3).all():
            operator.stops = 1

    def act(self, step: int, air: Air, operator: Operator) -> None:
        pass


@pytest.mark.extended
@pytest.mark.parametrize("height", [0.5, 1.0])
def test_aborted_takeoffs_of_lagging_drones_end_softly(tmp_path: Path, height: float) -> None:
    steps = f"  - takeoff: {{height: {height}}}\n  - land: {{}}\n"
    flight = flown(tmp_path, steps=steps, watch=_TakeOffEnded(), feed_forward=False)
    assert flight.summary["outcome"] == "aborted"
    assert flight.air.impact.max() < 0.75


@pytest.mark.extended
def test_a_flight_is_the_same_in_every_run(tmp_path: Path) -> None:
    runs: list[Flown] = [flown(tmp_path, n=1, seed=5, faults=[LOSS]) for _ in range(2)]
    assert (runs[0].air.drones["position"] == runs[1].air.drones["position"]).all()
    assert runs[0].air.fleet.time == runs[1].air.fleet.time
