"""Observers: called in order, dropped when they raise, and never in the way of a flight."""

from __future__ import annotations

import json
import logging
from collections.abc import Generator, Mapping
from typing import Any

import pytest

from star_core import Event, Flight, Status, TaskOutput, Tick, hookimpl
from star_core.discovery import Source
from tests.core.conftest import Lab

WATCHING = (
    "star_mission_started",
    "star_ticked",
    "star_phase_changed",
    "star_event",
    "star_mission_ended",
)


class Watcher:
    """Records its calls, and raises at one hook."""

    def __init__(self, hook: str = "", error: BaseException | None = None) -> None:
        self.received: list[tuple[str, Any]] = []
        self._hook = hook
        self._error = error or RuntimeError("boom")

    def _note(self, hook: str, news: Any) -> None:
        self.received.append((hook, news))
        if hook == self._hook:
            raise self._error

    @property
    def hooks(self) -> list[str]:
        return [hook for hook, _ in self.received]

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        self._note("star_mission_started", flight)

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self._note("star_ticked", tick)

    @hookimpl
    def star_phase_changed(self, time: float, agent: str | None, phase: str) -> None:
        self._note("star_phase_changed", (time, agent, phase))

    @hookimpl
    def star_event(self, event: Event) -> None:
        self._note("star_event", event)

    @hookimpl
    def star_mission_ended(self, summary: Mapping[str, Any]) -> None:
        self._note("star_mission_ended", summary)


def watched(lab: Lab, watcher: object, name: str = "watch") -> None:
    lab.registry.add(watcher, Source(f"its-dist:{name}"))


@pytest.mark.parametrize("hook", WATCHING)
@pytest.mark.parametrize(
    "error",
    [RuntimeError("boom"), SystemExit("boom"), BaseException("boom")],
    ids=["raise", "exit", "panic"],
)
def test_observers_that_raise_are_dropped_and_the_flight_goes_on(
    lab: Lab, hook: str, error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    watcher = Watcher(hook, error)
    watched(lab, watcher)
    summary = lab.fly()
    assert summary["outcome"] == "completed"
    kinds = [event["kind"] for event in summary["events"]]
    assert kinds.count("observer") == (hook != "star_mission_ended")
    why = f"{hook} raised {type(error).__name__}: boom"
    assert watcher.hooks.index(hook) == len(watcher.hooks) - 1  # not called after that
    assert lab.said("observer") == [f"its-dist:watch is dropped: {why}"]
    logged = [record.message for record in caplog.records if record.levelno == logging.WARNING]
    assert logged == [f"observer its-dist:watch is dropped for this flight: {why}"]


def test_why_an_observer_is_dropped_is_one_line(lab: Lab) -> None:
    watched(lab, Watcher("star_ticked", RuntimeError("too\nlong")))
    lab.fly()
    assert lab.said("observer") == [
        "its-dist:watch is dropped: star_ticked raised RuntimeError: too long"
    ]


def test_the_others_receive_what_an_observer_raised_at(lab: Lab) -> None:
    before, after = Watcher(), Watcher()
    watched(lab, before, "before")
    watched(lab, Watcher("star_ticked"), "bad")
    watched(lab, after, "after")
    lab.fly()
    ticks = len(lab.ticks)
    assert before.hooks.count("star_ticked") == after.hooks.count("star_ticked") == ticks


def test_two_observers_raising_at_one_event_are_dropped_once(lab: Lab) -> None:
    watchers = [Watcher("star_event"), Watcher("star_event")]
    for i, watcher in enumerate(watchers):
        watched(lab, watcher, f"watch{i}")
    lab.fly()
    assert [watcher.hooks.count("star_event") for watcher in watchers] == [1, 1]
    assert len(lab.said("observer")) == 2


def test_start_is_reported_first_and_end_last_once_each(lab: Lab) -> None:
    watcher = Watcher()
    watched(lab, watcher)
    summary = lab.fly()
    assert watcher.hooks[0] == "star_mission_started"
    assert watcher.received[-1] == ("star_mission_ended", summary)
    assert watcher.hooks.count("star_mission_started") == 1
    assert watcher.hooks.count("star_mission_ended") == 1


def test_nothing_has_moved_when_the_start_is_reported(lab: Lab) -> None:
    start_state: list[Any] = []

    class Early:
        @hookimpl
        def star_mission_started(self, flight: Flight) -> None:
            start_state.extend([flight.mission, lab.robots.commands + lab.robots.sent, lab.ticks])

    watched(lab, Early())
    mission = lab.load()
    lab.fly()
    assert start_state[0] == mission.name
    assert start_state[1] == []


@pytest.mark.parametrize("broken", [None, "planner"])
def test_end_is_reported_after_all_landed_and_links_closed(lab: Lab, broken: str | None) -> None:
    end_state: list[Any] = []

    class Last:
        @hookimpl
        def star_mission_ended(self) -> None:
            end_state.extend([lab.closed["transport"], lab.went("cf1")[-1], lab.went(None)[-1]])

    if broken:
        lab.spoil(broken, "plan", RuntimeError("boom"), range(20, 10**6))
    watched(lab, Last())
    lab.fly()
    assert end_state == [1, "landed", "failed" if broken else "completed"]


def test_every_event_is_reported_in_order_and_is_in_the_summary(lab: Lab) -> None:
    watcher = Watcher()
    watched(lab, watcher)
    summary = lab.fly()
    reported = [news for hook, news in watcher.received if hook == "star_event"]
    assert [event.text for event in reported] == [event["text"] for event in summary["events"]]
    assert [event.time for event in reported] == sorted(event.time for event in reported)


def test_an_event_is_one_line_whatever_its_text(lab: Lab) -> None:
    output = TaskOutput(status=Status.SUCCESS, messages=("it waits\nfor cf2\r\n",))
    lab.spoil("wait", "step", lambda *_: output)
    lab.fly("\n  - climb: {}\n  - wait: {agents: cf1, seconds: 1}")
    assert lab.said("task") == ["wait: it waits for cf2"]


def test_phases_are_reported_before_the_tick_they_are_seen_in(lab: Lab) -> None:
    watcher = Watcher()
    watched(lab, watcher)
    lab.fly()
    at = watcher.received.index(("star_phase_changed", (lab.phases[3][0], "cf1", "flying")))
    _, tick = next(item for item in watcher.received[at:] if item[0] == "star_ticked")
    assert tick.time == lab.phases[3][0]
    assert tick.health.phase[0] == 2


def test_an_interrupt_of_python_passes_through_an_observer(lab: Lab) -> None:
    watched(lab, Watcher("star_ticked", KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        lab.fly()


# As pluggy documents


class Wrapping:
    """Wraps one hook, and raises before or after the observers in it."""

    def __init__(self, log: list[str], before: str = "", after: str = "") -> None:
        self._log, self._before, self._after = log, before, after

    @hookimpl(wrapper=True)
    def star_ticked(self, tick: Tick) -> Generator[None]:
        self._log.append("before")
        if self._before:
            raise RuntimeError(self._before)
        result = yield
        self._log.append("after")
        if self._after:
            raise RuntimeError(self._after)
        return result


class Logging:
    """Writes a word at each tick."""

    def __init__(self, log: list[str], word: str) -> None:
        self._log, self._word = log, word

    @hookimpl
    def star_ticked(self) -> None:
        self._log.append(self._word)


def test_a_wrapper_runs_once_around_all_observers(lab: Lab) -> None:
    log: list[str] = []
    watched(lab, Logging(log, "a"), "a")
    watched(lab, Wrapping(log), "wrapping")
    watched(lab, Logging(log, "b"), "b")
    summary = lab.fly()
    assert log == ["before", "b", "a", "after"] * len(lab.ticks)
    assert "observer its-dist:wrapping" in summary["compute_s"]


@pytest.mark.parametrize("when", ["before", "after"])
def test_wrappers_that_raise_are_dropped_and_others_still_called(lab: Lab, when: str) -> None:
    log: list[str] = []
    watched(lab, Logging(log, "a"), "a")
    watched(lab, Wrapping(log, **{when: "boom"}), "wrapping")
    assert lab.fly()["outcome"] == "completed"
    assert lab.said("observer") == [
        "its-dist:wrapping is dropped: star_ticked raised RuntimeError: boom"
    ]
    assert log.count("before") == 1
    assert log.count("a") == len(lab.ticks)


def test_observers_raising_inside_a_wrapper_are_dropped_alone(lab: Lab) -> None:
    log: list[str] = []
    watched(lab, Watcher("star_ticked"), "bad")
    watched(lab, Wrapping(log), "wrapping")
    assert lab.fly()["outcome"] == "completed"
    assert [text.split()[0] for text in lab.said("observer")] == ["its-dist:bad"]
    assert log == ["before", "after"] * len(lab.ticks)


def test_tryfirst_trylast_and_specname_are_heeded(lab: Lab) -> None:
    log: list[str] = []

    class First:
        @hookimpl(tryfirst=True, specname="star_ticked")
        def first(self) -> None:
            log.append("first")

    class Last:
        @hookimpl(trylast=True)
        def star_ticked(self) -> None:
            log.append("last")

    watched(lab, First(), "first")
    watched(lab, Logging(log, "any"), "any")
    watched(lab, Last(), "last")
    lab.fly()
    assert log == ["first", "any", "last"] * len(lab.ticks)


class Counter:
    """A plugin that counts the ticks of each flight, and adds to its summary."""

    def __init__(self, measure: Any = None) -> None:
        self._measure = measure

    @hookimpl
    def star_mission_started(self) -> object:
        measure = self._measure

        class Ticks:
            count = 0

            @hookimpl
            def star_ticked(self) -> None:
                self.count += 1

            @hookimpl
            def star_summary(self) -> Any:
                return {"ticks": self.count} if measure is None else measure

        return Ticks()


def test_each_flight_has_an_observer_of_its_own(lab: Lab) -> None:
    watched(lab, Counter())
    first, second = lab.fly(), lab.fly()
    assert first["ticks"] == second["ticks"] > 10
    assert list(first)[-4:] == ["ticks", "targets", "steps", "events"]


@pytest.mark.parametrize(
    ("measure", "why"),
    [
        ({"outcome": "great"}, "ContractError: the summary has a key 'outcome' already"),
        ({"late_ticks": 0}, "ContractError: the summary has a key 'late_ticks' already"),
        ({"figure": float("nan")}, "ContractError: figure is not JSON: "),
        ({"figure": {1, 2}}, "ContractError: figure is not JSON: "),
        ([1], "TypeError: "),
    ],
    ids=str,
)
def test_an_observer_with_a_wrong_measure_is_named(lab: Lab, measure: Any, why: str) -> None:
    watched(lab, Counter(measure))
    summary = lab.fly()
    assert summary["outcome"] == "completed"
    (text,) = lab.said("observer")
    assert text.startswith(f"its-dist:watch is dropped: star_summary raised {why}")
    assert summary["events"][-1]["text"] == text
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_a_measure_is_returned_as_the_record_has_it(lab: Lab) -> None:
    watched(lab, Counter({"figure": {3: (1, 2)}}))
    assert lab.fly()["figure"] == {"3": [1, 2]}


def test_of_two_observers_with_one_key_the_second_is_named(lab: Lab) -> None:
    watched(lab, Counter())
    watched(lab, Counter(), "other")
    assert lab.fly()["ticks"] > 10
    (text,) = lab.said("observer")
    assert "star_summary raised ContractError: the summary has a key 'ticks' already" in text


def test_a_wrapper_passes_observers_and_measures_of_others_on(lab: Lab) -> None:
    class Wrapper:
        @hookimpl(wrapper=True)
        def star_mission_started(self) -> Generator[None, list[Any], list[Any]]:
            return (yield)

        @hookimpl(wrapper=True)
        def star_summary(self) -> Generator[None, list[Any], list[Any]]:
            measures = yield
            return [*measures, {"plugins": len(measures)}]

    watched(lab, Counter())
    watched(lab, Wrapper(), "wrapper")
    summary = lab.fly()
    assert summary["ticks"] > 10
    assert summary["plugins"] == 1
    assert lab.said("observer") == []


def test_an_observer_of_a_flight_with_an_unknown_hook_is_named(lab: Lab) -> None:
    class Misspelt:
        @hookimpl
        def star_tciked(self) -> None: ...

    class Plugin:
        @hookimpl
        def star_mission_started(self) -> object:
            return Misspelt()

    watched(lab, Plugin())
    assert lab.fly()["outcome"] == "completed"
    (text,) = lab.said("observer")
    assert "no hook named 'star_tciked'; did you mean 'star_ticked'?" in text
