"""Conditions: when they hold, how long they wait, and what cannot be meant."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_core import Event
from star_core.conditions import ConditionContext
from star_core.testing import estimate, health
from star_yaml import conditions, schema
from star_yaml.conditions import parse, problems

NAMES = ("cf1", "cf2", "cf3")
GROUPS = {"pair": ["cf2", "cf3"], "all": [*NAMES]}


def now(**changes: Any) -> ConditionContext:
    """Three agents on a line, 1 m apart, of which the step has the first two; it began 10 s ago."""
    line = np.array([[0.0, 0, 1], [1.0, 0, 1], [2.0, 0, 1]])
    context = ConditionContext(
        rows=(0, 1),
        begun=5.0,
        time=15.0,
        estimate=estimate(line, time=15.0),
        health=replace(health(3), battery=np.array([3.9, 3.6, 3.1])),
        names=NAMES,
        targets={"survivor": "cf1", "bag": "cf3"},
        events=[
            Event(4.0, "safety", "slow", "cf1"),
            Event(7.0, "found", "there", "cf3"),
            Event(8.0, "step", "goto begins", None, {"agents": ["cf1", "cf2"]}),
        ],
    )
    return replace(context, **changes)


@pytest.mark.parametrize(
    "condition",
    [
        {"elapsed": 10},
        {"found": 2},
        {"found": "bag"},
        {"near": {"point": [0.5, 0, 1], "within": 0.5}},
        {"near": {"agent": "cf3", "within": 2}},
        {"battery_below": 3.7},
        {"event": "found"},
        {"any": [{"elapsed": 11}, {"found": 1}]},
        {"all": [{"elapsed": 1}, {"found": 1}]},
        {"not": {"elapsed": 11}},
        {"time": 15},
        {"found": 1, "agents": "cf3"},
        {"found": 2, "agents": "all"},
        {"found": 1, "agents": {"all": ["cf1", "cf3"]}},
        {"found": "bag", "agents": ["cf2", "cf3"]},
        {"near": {"point": [2, 0, 1], "within": 0.5}, "agents": "cf3"},
        {"near": {"point": [2, 0, 1], "within": 0.5}, "agents": {"any": "all"}},
        {"battery_below": 3.2, "agents": "pair"},
        {"battery_below": 3.7, "agents": {"all": "pair"}},
        {"event": "found", "agents": "cf3"},
        {"event": "step", "agents": {"all": ["cf1", "cf2"]}},
        {"all": [{"found": 1, "agents": "cf1"}, {"not": {"event": "found", "agents": "cf1"}}]},
    ],
    ids=str,
)
def test_a_condition_holds(condition: dict[str, Any]) -> None:
    assert parse(condition, GROUPS).holds(now())


@pytest.mark.parametrize(
    "condition",
    [
        {"elapsed": 10.01},
        {"found": 3},
        {"found": "cat"},
        {"near": {"point": [0.5, 0, 1], "within": 0.49}},
        {"near": {"agent": "cf3", "within": 1.9}},  # cf1 is 2 m away
        {"battery_below": 3.5},  # cf3 is not of the step
        {"event": "safety"},  # that was before the step
        {"any": [{"elapsed": 11}, {"found": 3}]},
        {"all": [{"elapsed": 11}, {"found": 1}]},
        {"not": {"elapsed": 10}},
        {"time": 15.1},
        {"found": 2, "agents": "cf3"},
        {"found": 1, "agents": {"all": "pair"}},  # cf2 found none
        {"found": "bag", "agents": "cf1"},
        {"near": {"point": [2, 0, 1], "within": 0.5}, "agents": "pair"},
        {"battery_below": 3.7, "agents": "cf1"},
        {"battery_below": 3.2, "agents": {"all": "pair"}},
        {"event": "found", "agents": "cf1"},
        {"event": "safety", "agents": "cf1"},  # that was before the step
        {"event": "step", "agents": {"all": "all"}},
    ],
    ids=str,
)
def test_a_condition_does_not_hold(condition: dict[str, Any]) -> None:
    assert not parse(condition, GROUPS).holds(now())


def test_an_agent_that_is_nowhere_is_near_nothing() -> None:
    nowhere = np.full((3, 3), np.nan)
    context = now(estimate=estimate(nowhere, time=15.0))
    assert not parse({"near": {"point": [0, 0, 1], "within": 99}}).holds(context)


def test_a_battery_that_is_not_reported_is_not_low() -> None:
    unknown = now(health=replace(health(3), battery=np.full(3, np.nan)))
    assert not parse({"battery_below": 9}).holds(unknown)


@pytest.mark.parametrize(
    ("condition", "time"),
    [
        ({"elapsed": 3}, 3.0),
        ({"found": 3}, 0.0),
        ({"any": [{"found": 1}, {"all": [{"elapsed": 7}, {"elapsed": 2}]}]}, 7.0),
        ({"not": {"elapsed": 4}}, 4.0),
        ({"all": [{"time": 9}, {"elapsed": 7}]}, 9.0),
    ],
    ids=str,
)
def test_how_long_a_condition_waits_is_the_longest_time_in_it(
    condition: dict[str, Any], time: float
) -> None:
    assert parse(condition).longest_wait == time


def test_near_conditions_may_refer_to_unreachable_points() -> None:
    near = {"near": {"point": [3, 0, 0], "within": 1}}

    def mistakes(metres: float) -> list[Any]:
        return list(problems(parse(near), NAMES, (), outside=lambda _: metres))

    assert mistakes(1.0) == []
    assert [problem.path for problem in mistakes(1.1)] == [("near", "point")]


def test_an_agent_among_others_may_be_near_itself_but_not_alone() -> None:
    near = {"near": {"agent": NAMES[0], "within": 1}}
    assert list(problems(parse(near), NAMES, (), of_step=NAMES[:2])) == []
    (problem,) = problems(parse(near), NAMES, (), of_step=NAMES[:1])
    assert problem.path == ("near", "agent")
    assert problem.code == "agent-conflict"


def test_problems_of_conditions_have_their_path() -> None:
    near = {"near": {"agent": "cf9", "within": 1}}
    (problem,) = problems(parse({"any": [{"found": 1}, {"not": near}]}), NAMES, ("bat", "survivor"))
    assert problem.path == ("any", 1, "not", "near", "agent")
    assert problem.code == "unknown-agent"


# Times and clauses

leaves = st.sampled_from(
    [{"found": 1}, {"elapsed": 3.0}, {"elapsed": 9.0}, {"event": "x"}, {"battery_below": 3.5},
     {"near": {"point": [0, 0, 1], "within": 0.5}}, {"near": {"agent": "a", "within": 0.5}},
     {"found": "survivor"}]
)  # fmt: skip
written = st.recursive(
    leaves,
    lambda inner: (
        st.builds(lambda clause: {"not": clause}, inner)
        | st.builds(lambda kind, some: {kind: some}, st.sampled_from(["any", "all"]),
                    st.lists(inner, min_size=1, max_size=3))
    ),
)  # fmt: skip


@given(written)
def test_time_conditions_hold_no_later_than_their_longest_wait(source: dict[str, Any]) -> None:
    condition = parse(source)
    whatever, at_least = condition.holds_from(math.inf), condition.holds_from(0.0)
    assert whatever in {3.0, 9.0, math.inf}
    assert at_least <= whatever
    if "not" not in str(source) and whatever < math.inf:
        assert whatever <= condition.longest_wait


@given(written)
def test_every_condition_is_a_clause(source: dict[str, Any]) -> None:
    assert "{" not in str(parse(source))


def test_every_kind_of_the_schema_is_tried_here() -> None:
    kinds = schema.load("mission")["$defs"]["condition"]["properties"]
    assert {*kinds} == {
        *("any", "all", "not", "elapsed", "time", "found", "near", "battery_below", "event"),
        "agents",
    }


# Events

CORE = Path(__file__).parents[4] / "star_core"
REPORTING = ("star_faults", "star_metrics")  # plugins that report events
REPORTED = re.compile(
    r"""(?:\b(?:event|report|self\._report|Report)\(|\bEvent\([\w.]+,)\s*"(\w+)"|"""
    r"""partial\(observers\.event, "(\w+)"\)"""
)


def kinds() -> list[str]:
    """The kinds of events that a condition may ask for."""
    names = schema.load("mission")["$defs"]["condition"]["properties"]["event"]["enum"]
    return list(names)


def test_a_condition_may_ask_for_every_kind_of_event() -> None:
    folders = CORE, *(CORE.parent / "plugins/observers" / name for name in REPORTING)
    files = [file for folder in folders for file in folder.rglob("*.py")]
    reported = {a or b for f in files for a, b in REPORTED.findall(f.read_text("utf-8"))}
    assert reported == {*kinds()}


def test_the_docs_list_the_kinds_of_events() -> None:
    text = (CORE.parent / "docs" / "missions.md").read_text("utf-8")
    table = text[text.index("### Kinds of events") :].split("\n\n")[1]
    assert re.findall(r"^\| `(\w+)`", table, re.MULTILINE) == kinds()


@pytest.mark.parametrize(
    ("condition", "needs"),
    [
        ({"found": 1}, True),
        ({"event": "found"}, True),
        ({"event": "safety"}, False),
        ({"not": {"found": 1}}, False),
        ({"any": [{"found": 1}, {"elapsed": 3}]}, False),
        ({"any": [{"found": 1}, {"all": [{"elapsed": 3}, {"found": "red"}]}]}, True),
    ],
)
def test_a_condition_that_cannot_hold_without_a_find_is_known(
    condition: dict[str, Any],
    needs: bool,  # noqa: FBT001 -- what is expected
) -> None:
    assert conditions.needs_find(parse(condition)) is needs
