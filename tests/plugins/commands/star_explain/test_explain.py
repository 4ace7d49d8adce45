"""The command ``star explain``."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import pytest

from star_core import Registry, Status, TaskOutput, TaskSpec, hookimpl, load
from star_core.commands.main import main as star
from star_core.formats import check_file
from star_core.toolkit import Exclusive
from star_explain.origins import Origins
from star_explain.plan import plan
from star_explain.results import Group, StepResult, results
from star_explain.variants import MAX_REACTIONS
from tests.commands import Printed, command

main = command("explain")

MISSIONS = Path(__file__).parents[4] / "missions"
HEAD = """\
star: 1
name: hop
world: room.yaml
swarm: {cf1: {start: [0, 0, 0]}, cf2: {start: [1, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: {use: orca, radius: 0.2}
"""
WORLD = "star: 1\nname: room\nfence: {low: [-3, -3, 0], high: [3, 3, 2]}\n"

Write: TypeAlias = Callable[..., Path]
Explain: TypeAlias = Callable[..., str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a mission of these steps, with what stands beside them."""

    def written(steps: str, beside: str = "", world: str = WORLD) -> Path:
        (tmp_path / "room.yaml").write_text(world, encoding="utf-8")
        path = tmp_path / "hop.yaml"
        path.write_text(f"{HEAD}{beside}\nmission:\n{steps}", encoding="utf-8")
        return path

    return written


@pytest.fixture
def explain(write: Write, capsys: Printed) -> Explain:
    """What is printed of a mission of these steps."""

    def explained(steps: str, *arguments: str, beside: str = "", world: str = WORLD) -> str:
        assert main([str(write(steps, beside, world)), *arguments]) == 0
        return capsys.readouterr().out

    return explained


def told(path: Path, *plugins: object) -> Group:
    registry = Registry(*plugins)
    mission = load(path, registry)
    rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    return results(mission, registry, rehearsal, Origins(mission, registry, rehearsal))


def test_steps_are_reported_with_agents_options_and_times(explain: Explain) -> None:
    text = explain("  - takeoff: {height: 0.6}\n  - land: {agents: cf2}\n")
    assert text[text.index("plan:") :].splitlines() == [
        "plan: about 9.2 s, at most 25 s",
        "  1  takeoff cf1, cf2  height: 0.6",
        "     by default speed: 0.3",
        "     about 2.9 s, at most 11 s",
        "  2  land cf2",
        "     by default speed: 0.2",
        "     about 6.3 s, at most 14 s",
    ]


def test_time_outs_are_those_of_where_the_steps_before_lead(write: Write) -> None:
    path = write(
        "  - takeoff: {height: 1.0}\n"
        "  - goto: {agents: cf1, to: [0, 2, 1], speed: 0.5}\n"
        "  - goto: {agents: cf1, to: [0, 2, 1], speed: 0.5}\n"
    )
    _, transit, still = told(path).parts
    fence = load(path, Registry()).scene.world.fence
    crossing = math.dist(fence.low, fence.high) / 0.5  # by another agent
    assert transit.limit == pytest.approx(3 * 2 / 0.5 + 5 + crossing, abs=0.1)
    assert still.limit == pytest.approx(5.0 + crossing, abs=0.7)  # it ends within 0.1 m of its goal


def test_a_time_out_of_the_mission_goes_before(explain: Explain) -> None:
    assert "at most 40 s (given)" in explain("  - takeoff: {timeout: 40}\n")


def test_a_condition_that_waits_lengthens_the_time_out(write: Write) -> None:
    path = write("  - takeoff: {}\n  - wait: {until: {elapsed: 90}}\n")
    (_, wait) = told(path).parts
    assert wait.takes == pytest.approx(90.0)
    assert wait.limit == 95.0


def test_unpredictable_conditions_leave_the_time_open(explain: Explain) -> None:
    text = explain("  - takeoff: {}\n  - wait: {until: {battery_below: 3.5}, timeout: 7}\n")
    assert "as long as it takes, at most 7.0 s (given); until a battery is below 3.5 V" in text


def test_what_follows_a_failure_is_reported(explain: Explain) -> None:
    text = explain("  - takeoff: {on_failure: land}\n  - hold: {on_failure: continue}\n")
    assert "; if it fails, its agents land" in text
    assert "; if it fails, the next step begins" in text


def test_steps_at_once_take_as_long_as_the_longest(write: Write) -> None:
    path = write(
        "  - takeoff: {}\n"
        "  - parallel:\n      - hold: {agents: cf1, for: 2}\n      - hold: {agents: cf2, for: 7}\n"
    )
    (_, both) = told(path).parts
    assert both.takes == pytest.approx(7.0)
    assert both.limit == pytest.approx(26.0)


def test_steps_over_again_take_as_often_as_long(explain: Explain) -> None:
    steps = "  - takeoff: {}\n  - repeat: {times: 3, steps: [hold: {for: 2}]}\n"
    assert "2  3 times one after the other: about 6.2 s, at most 33 s" in explain(steps)


CHOICE = """\
  - takeoff: {height: 0.6}
  - if: {when: {battery_below: 3.0}, then: [hold: {for: 3}], else: [hold: {for: 1}]}
  - if: {when: {time: 60}, then: [hold: {for: 2}]}
"""


def test_both_outcomes_of_a_choice_are_reported_with_times(explain: Explain) -> None:
    lines = explain(CHOICE).splitlines()
    titles = [line for line in lines if " if " in line or "otherwise" in line]
    assert [title.strip().partition("  ")[2] for title in titles] == [
        "if a battery is below 3 V: about 1.0 s, at most 14 s",
        "if so: about 3.0 s, at most 14 s",
        "otherwise: about 1.0 s, at most 8.0 s",
        "if it is 60 s after the start: about 0.0 s, at most 11 s",
        "if so: about 2.0 s, at most 11 s",
    ]


def test_a_choice_is_drawn_with_its_two_ways(explain: Explain) -> None:
    chart = explain(CHOICE, "--mermaid")
    assert '{{"if a battery is below 3 V"}}' in chart
    assert chart.count('["if so"]') == 2
    assert chart.count(" -- otherwise --> ") == 1
    data = json.loads(explain(CHOICE, "--json"))["plan"]["in_order"]
    assert (data[1]["when"], len(data[1]["either"])) == ("if a battery is below 3 V", 2)
    types = [data[0]["type"], data[1]["type"], *(branch["type"] for branch in data[1]["either"])]
    assert types == ["step", "choice", "branch", "branch"]


def test_reactions_are_reported_after_the_steps(explain: Explain) -> None:
    more = "on: [{when: {battery_below: 3.0}, then: [hold: {agents: cf1, for: 3}]}]"
    steps = "  - takeoff: {height: 0.6}\n"
    lines = explain(steps, beside=more).splitlines()
    assert "  2  on a battery is below 3 V: about 3.0 s, at most 14 s" in lines
    assert any(line.startswith("    2.1  hold cf1") for line in lines)
    assert any(line.startswith("plan: about 2.9 s") for line in lines)
    data = json.loads(explain(steps, "--json", beside=more))["plan"]["in_order"]
    assert [part["type"] for part in data] == ["step", "reaction"]
    chart = explain(steps, "--mermaid", beside=more)
    assert '["on a battery is below 3 V"]' in chart
    assert '(["at any time"])' in chart


def test_reactions_beyond_a_number_are_not_rehearsed(explain: Explain, write: Write) -> None:
    few = [f"{{when: {{time: {90 + i}}}, then: [hold: {{for: 1}}]}}" for i in range(MAX_REACTIONS)]
    last = "{when: {time: 300}, then: [hold: {for: 2}]}"
    steps, more = "  - takeoff: {height: 0.6}\n", f"on: [{', '.join([*few, last])}]"
    assert explain(steps, beside=more).count("! in the rehearsal: not rehearsed: only") == 1
    path = write(steps, beside=more)
    (text,) = [text for text in check_file(path, Registry(), [])[1] if "[not-rehearsed]" in text]
    line = path.read_text().splitlines().index(more) + 1
    assert text.startswith(f"{path}:{line}:{more.index(last) + 1}: warning: ")


def test_steps_that_an_early_reaction_spoils_are_warned_of(write: Write) -> None:
    more = "on: [{when: {time: 60}, then: [land: {agents: cf1}]}]"
    goto = "  - goto: {agents: cf2, relative_to: cf1, by: [0.6, 0, 0]}"
    path = write(f"  - takeoff: {{}}\n  - hold: {{agents: cf2, for: 5}}\n{goto}\n", beside=more)
    warnings = check_file(path, Registry(), [])[1]
    line = path.read_text().splitlines().index(goto) + 1
    assert [text.partition(": ")[0] for text in warnings if "[unreachable-goal]" in text] == [
        f"{path}:{line}:11"
    ]


def test_a_reaction_may_bring_in_a_reserve(explain: Explain) -> None:
    more = "reserve: {agents: [cf2]}\non: [{when: {time: 4}, then: [join: {agents: cf2}]}]"
    text = explain("  - takeoff: {height: 0.6}\n  - hold: {for: 10}\n", beside=more)
    assert "    3.1  join cf2" in text
    assert "no agents" not in text


def test_steps_of_each_agent_are_reported_once(explain: Explain) -> None:
    text = explain("  - takeoff: {}\n  - each: {steps: [goto: {by: [0, 1, 0]}, land: {}]}\n")
    assert "2  each by itself, cf1, cf2: about" in text
    assert text.count("goto") == 1


def test_steps_with_agent_dependent_times_are_reported_per_agent(explain: Explain) -> None:
    steps = "  - takeoff: {}\n  - each: {steps: [goto: {to: [1, 0.5, 0.8]}, land: {}]}\n"
    text = explain(steps)
    assert text.count("goto") == 2


def test_each_for_one_agent_is_neither_parallel_nor_sequential(explain: Explain) -> None:
    text = explain("  - each: {agents: cf1, steps: [takeoff: {}, land: {}]}\n")
    assert "1  each by itself, cf1: about" in text
    assert "at once" not in text
    assert "one after the other" not in text


@pytest.mark.parametrize("form", [(), ("--mermaid",)])
def test_a_file_that_is_included_is_named(
    explain: Explain, tmp_path: Path, form: tuple[str, ...]
) -> None:
    (tmp_path / "inner.yaml").write_text("star: 1\nmission: [{hold: {}}, {hold: {}}]\n")
    (tmp_path / "part.yaml").write_text(
        "star: 1\nmission: [{hold: {}}, {include: {file: inner.yaml}}]\n"
    )
    text = explain("  - takeoff: {}\n  - include: {file: part.yaml}\n", *form)
    assert "inner.yaml" in text
    part, inner = (text.index(f"from {tmp_path / name}") for name in ("part.yaml", "inner.yaml"))
    assert part < inner


def test_external_programs_are_not_awaited_nor_their_port_opened(
    write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socket.create_server", None)  # a call raises
    steps = "  - takeoff: {}\n  - external: {}\n  - external: {timeout: 7}\n"
    _, first, second = told(write(steps)).parts
    assert (first.takes, first.limit, second.limit) == (None, 60.0, 7.0)
    assert isinstance(first, StepResult)
    assert first.fault == ""


class Alone:
    """Offers a verb that waits for another process, or is alone and done at once."""

    @hookimpl
    def star_tasks(self) -> Iterator[TaskSpec]:
        yield TaskSpec(
            name="ring",
            summary="Ring.",
            make=lambda _scene, _rows, **_options: self,
            exclusive=Exclusive(options=(), unless="alone", timeout=9),
            options={
                "type": "object",
                "properties": {
                    "alone": {"type": "boolean"},
                    "port": {"type": "integer", "default": 7},
                },
            },
        )

    def begin(self, _estimate: object, _health: object) -> float:
        return 5.0

    def step(self, _estimate: object, _health: object) -> TaskOutput:
        return TaskOutput(status=Status.SUCCESS)


def test_a_step_that_takes_hold_of_nothing_outside_is_rehearsed(write: Write) -> None:
    waiting, alone = told(write("  - ring: {}\n  - ring: {alone: true}\n"), Alone()).parts
    assert (waiting.takes, waiting.limit) == (None, 9.0)
    assert (alone.takes, alone.limit) == (0.0, 5.0)


def test_steps_without_external_are_not_reported_as_external(write: Write) -> None:
    path = write("  - ring: {}\n  - ring: {alone: true}\n")
    lines = list(plan(told(path, Alone()), Registry(Alone())))
    assert [line.strip() for line in lines if "default" in line] == ["by default port: 7"]
    assert "alone: true" in lines[-2]


def test_a_step_that_would_fail_is_reported(explain: Explain) -> None:
    text = explain(
        "  - takeoff: {}\n  - goto: {by: [0, 0, 0.1], on_failure: land}\n  - takeoff: {}\n"
    )
    assert "! in the rehearsal: already in the air: cf1, cf2" in text
    grounded = explain("  - land: {on_failure: continue}\n  - goto: {to: [0, 1, 1]}\n")
    assert "! in the rehearsal: times out after" in grounded


def test_on_board_flight_is_reported_with_its_duration(explain: Explain, tmp_path: Path) -> None:
    header = ",".join(["duration", *(f"{a}^{p}" for a in ("x", "y", "z", "yaw") for p in range(8))])
    still = ",".join(["4.0", *["0"] * 32])
    (tmp_path / "still.csv").write_text(f"{header}\n{still}\n", encoding="utf-8")
    options = "file: still.csv, format: poly7, timescale: 2"
    text = explain(
        f"  - takeoff: {{}}\n  - follow: {{{options}, on_board: true}}\n  - follow: {{{options}}}\n"
    )
    (told,) = (line for line in text.splitlines() if "flown on board" in line)
    assert told.startswith("     about 8.")
    assert told.endswith("; flown on board: neither planner nor avoider steers")


def test_an_agent_that_is_in_reserve_does_nothing_until_it_joins(explain: Explain) -> None:
    text = explain(
        "  - takeoff: {}\n  - join: {agents: cf2}\n  - land: {}\n",
        beside="reserve: {agents: [cf2]}",
    )
    assert "  1  takeoff cf1\n" in text
    assert "  3  land cf1, cf2\n" in text
    assert "in reserve: cf2, to replace agents below 3.4 V; ready above 4 V" in text


def test_parts_are_reported_with_options_and_defaults(explain: Explain) -> None:
    text = explain("  - land: {}\n")
    assert "  avoider    orca  radius: 0.2\n" in text
    assert "             by default horizon: 2, " in text


def test_the_world_is_reported_with_its_size_and_what_is_in_it(explain: Explain) -> None:
    world = WORLD + (
        "obstacles: {post: {cylinder: {centre: [2, 2], radius: 0.1}, height: [0, 2]}}\n"
        "landmarks: {a: {tags: [0, 1], at: [-1, -1, 0]}}\n"
        "targets: {b: {tags: [9], at: [2, 0, 0]}}\n"
    )
    text = explain("  - land: {}\n", world=world)
    assert "  fence      6 by 6 by 2 m, from [-3, -3, 0] to [3, 3, 2]\n" in text
    assert "  obstacles  post\n" in text
    assert "  landmarks  1: tags 0, 1\n" in text
    assert "  targets    1: tags 9\n" in text


def test_safety_rules_are_reported_with_their_numbers(explain: Explain) -> None:
    rules = "safety: {battery_low: {below: 3.6}, link_lost: {then: hold}, tumbled: {then: stop}}"
    text = explain("  - land: {}\n", beside=rules)
    assert "  battery_low: battery below 3.6 V, then land\n" in text
    assert "  link_lost: no message for 0.5 s, then hold\n" in text
    assert "  tumbled: tumbled, crashed, locked, rebooted or on the floor, then stop\n" in text


CHARTS = [
    "  - takeoff: {}\n  - land: {}\n",
    "  - parallel: [takeoff: {agents: cf1}, takeoff: {agents: cf2}]\n",
    "  - takeoff: {}\n  - repeat: {times: 2, steps: [hold: {}, hold: {}]}\n  - land: {}\n",
    "  - takeoff: {}\n  - each: {steps: [hold: {}, land: {}]}\n",
]
EDGE = re.compile(r"(\w+) --> (\w+)")
NODE = re.compile(r"(\w+)(?:\(\[.+\]\)|\[\".+\"\]|\{\{\".+\"\}\})")


@pytest.mark.parametrize("steps", CHARTS)
def test_chart_nodes_are_all_connected_to_start_and_end(explain: Explain, steps: str) -> None:
    first, *lines = explain(steps, "--mermaid").splitlines()
    assert first == "flowchart TD"
    edges = [match.groups() for line in lines if (match := EDGE.fullmatch(line.strip()))]
    nodes = {match[1] for line in lines if (match := NODE.fullmatch(line.strip()))}
    frames = [line for line in lines if line.strip().startswith("subgraph")]
    assert len(frames) == sum(line.strip() == "end" for line in lines)
    assert len(edges) + len(nodes) + 2 * len(frames) == len(lines)
    assert {end for edge in edges for end in edge} == nodes
    assert {a for a, _ in edges} == nodes - {"done"}
    assert {b for _, b in edges} == nodes - {"start"}


def test_no_arrow_into_a_frame_pulls_the_step_before_into_it(explain: Explain) -> None:
    lines = explain(CHARTS[2], "--mermaid").splitlines()
    begin = next(i for i, line in enumerate(lines) if "subgraph" in line)
    end = next(i for i, line in enumerate(lines) if line.strip() == "end")
    inside = {m[1] for line in lines[begin + 1 : end] if (m := NODE.fullmatch(line.strip()))}
    for line in lines[begin + 1 : end]:
        if match := EDGE.fullmatch(line.strip()):
            assert set(match.groups()) <= inside


def test_what_is_in_a_chart_cannot_break_it(explain: Explain, tmp_path: Path) -> None:
    (tmp_path / 'a"]-->b').write_text("x,y,z\n0,0,1\n1,0,1\n")
    steps = "  - takeoff: {}\n  - follow: {file: 'a\"]-->b'}\n"
    text = explain(steps, "--mermaid")
    assert "#quot;]--#gt;b" in text
    assert 'a"]' not in text


def test_json_has_the_same(explain: Explain) -> None:
    data = json.loads(explain("  - takeoff: {}\n  - land: {agents: cf1}\n", "--json"))
    assert [step["verb"] for step in data["plan"]["in_order"]] == ["takeoff", "land"]
    assert data["plan"]["in_order"][1]["agents"] == ["cf1"]
    assert data["plan"]["timeout_s"] == pytest.approx(13 + 17)


def test_it_is_a_command_of_star_that_refuses_bad_input(write: Write, capsys: Printed) -> None:
    assert star(["explain", str(write("  - land: {}\n"))]) == 0
    assert star(["explain", str(write("  - fly: {}\n"))]) == 2
    assert "hop.yaml:11:5: " in capsys.readouterr().err


def test_values_can_be_set(explain: Explain) -> None:
    assert "height: 1.2" in explain("  - takeoff: {}\n", "--set", "mission.0.takeoff.height=1.2")


class Broken:
    """Offers a verb whose task raises when it is begun."""

    closed = 0

    @hookimpl
    def star_tasks(self) -> Iterator[TaskSpec]:
        yield TaskSpec(name="break", summary="Raise.", make=lambda _scene, _rows: self)

    def begin(self, _estimate: object, _health: object) -> float:
        raise RuntimeError("no")

    def step(self, _estimate: object, _health: object) -> TaskOutput:
        return TaskOutput()

    def close(self) -> None:
        self.closed += 1


def test_verbs_that_raise_are_reported_closed_and_skipped(write: Write) -> None:
    broken = Broken()
    first, second = told(write("  - break: {}\n  - takeoff: {}\n"), broken).parts
    assert isinstance(first, StepResult)
    assert "task 'break' (" in first.fault
    assert "): RuntimeError: no (" in first.fault
    assert first.limit is None
    assert second.limit == pytest.approx(13.0)
    assert broken.closed == 1


@pytest.mark.parametrize("name", ["first_flight", "around", "three_eyes"])
def test_missions_that_are_shipped_are_explained_without_a_fault(
    capsys: Printed, name: str
) -> None:
    assert main([str(MISSIONS / f"{name}.yaml")]) == 0
    text = capsys.readouterr().out
    assert "plan: about" in text
    assert "! in the rehearsal" not in text
