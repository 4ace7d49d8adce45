"""What an editor offers, shows and marks in a mission: asked of yaml-language-server itself."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from star_core.plugin_support.registry import Registry
from star_yaml.schema import compose, load
from tests.editors.language_server import LanguageServer

pytestmark = pytest.mark.campaign  # it needs npm and its registry

MISSIONS = Path(__file__).parents[2] / "missions"
HEAD = "# yaml-language-server: $schema=mission.schema.json\n"
TOP = """\
star: 1
name: swap
world: worlds/lab.yaml
limits: {speed: 0.5, height: [0.2, 1.8]}
swarm:
  cf1: {start: [0, 0, 0]}
transport: sim
localizer: {use: flow, max_report_age: 0.5}
planner: straight
avoider: {use: orca, radius: 0.2}
"""
MISSION = f"""\
{HEAD}{TOP}safety: {{battery_low: {{below: 3.5}}}}
let: {{top: 1, leader: cf1, corner: [0, $(top / 2), $top]}}
on: [{{when: {{battery_below: 3.4, agents: {{all: [cf1]}}}}, then: [leave: {{}}]}}]
mission:
  - takeoff: {{height: 0.8}}
  - goto: {{agents: $leader, to: [0, $(0.5 * top), $top], speed: 0.3, yaw_deg: 90}}
  - each: {{with: {{cf1: {{by: [0, 0, 0.1]}}}}, steps: [goto: {{by: $by}}]}}
  - if: {{when: {{time: 9}}, then: [land: {{}}], else: [hold: {{}}]}}
  - hold: {{for: 2, until: {{elapsed: 1}}, timeout: 5}}
  - land: {{}}
"""
STEPS = """\
# yaml-language-server: $schema=steps.schema.json
star: 1
parameters: {rise: null, what: {land: {}}}
"""
PATROL = f"""\
{STEPS}mission:
  - takeoff: {{height: $rise}}
  - goto: {{agents: $who, by: [0, 0, $rise], speed: 0.3, on_failure: $then}}
  - hold: {{for: $rise, until: {{elapsed: 1}}, timeout: 5}}
  - repeat: {{times: $often, steps: [$what, parallel: $both, land: $how]}}
  - include: {{file: $file, with: {{rise: $rise}}}}
  - $what
"""
EVENTS = load("mission")["$defs"]["condition"]["properties"]["event"]["enum"]
VERBS = list(compose(Registry().offers())["$defs"]["step"]["properties"])

Hovered = Callable[[str, str, str], str]
Offered = Callable[[str], list[dict[str, Any]]]
Marked = Callable[[str], list[dict[str, Any]]]


@pytest.fixture
def names(folder: Path) -> Iterator[Path]:
    """Names for files that are not open."""
    return (folder / f"{folder.name}-{number}.yaml" for number in count(next(NUMBERS) * 1000))


NUMBERS = count()


@pytest.fixture
def marked(server: LanguageServer, names: Iterator[Path]) -> Marked:
    """Return what is wrong with a mission, as an editor marks it."""

    def mark(text: str) -> list[dict[str, Any]]:
        path = next(names)
        diagnostics = server.open(path, text)
        server.close(path)
        return diagnostics

    return mark


@pytest.fixture
def offered(server: LanguageServer, names: Iterator[Path]) -> Offered:
    """Return what is offered at the ``|`` in a text."""

    def offer(text: str) -> list[dict[str, Any]]:
        before, _, after = text.partition("|")
        path = next(names)
        server.open(path, before + after)
        line = before.count("\n")
        completions = server.complete(path, line, len(before) - before.rfind("\n") - 1)
        server.close(path)
        return completions

    return offer


@pytest.fixture
def hovered(server: LanguageServer, names: Iterator[Path]) -> Hovered:
    """Return what is shown for a key that stands behind something else in a line of a text."""

    def hover(text: str, where: str, key: str) -> str:
        path = next(names)
        server.open(path, text)
        lines = text.splitlines()
        line = next(i for i, text_line in enumerate(lines) if where in text_line)
        at = lines[line].index(f"{key}:", lines[line].index(where) + len(where))
        shown = server.hover(path, line, at + 1)
        server.close(path)
        return shown

    return hover


@pytest.mark.parametrize(
    "steps",
    [
        "  - |\n",
        "  - takeoff: {}\n  - |\n",
        "  - takeoff: {}\n  - |\n  - land: {}\n",
        "  - parallel:\n      - |\n",
        "  - repeat:\n      times: 2\n      steps:\n        - |\n",
        "  - each:\n      steps:\n        - |\n",
    ],
    ids=["first", "last", "between", "in parallel", "in repeat", "in each"],
)
@pytest.mark.parametrize("head", [HEAD + TOP, STEPS], ids=["mission", "steps"])
def test_a_new_step_is_offered_the_verbs_and_nothing_else(
    offered: Offered, head: str, steps: str
) -> None:
    verbs = offered(f"{head}mission:\n{steps}")
    assert sorted(item["label"] for item in verbs) == sorted(VERBS)
    assert all(item["documentation"] for item in verbs)


@pytest.mark.parametrize("kind", ["transport", "localizer", "planner", "avoider"])
@pytest.mark.parametrize("place", ["{}: |\n", "{}: s|\n", "{}:\n  use: |\n", "{}: {{use: |}}\n"])
def test_the_plugins_of_a_kind_are_offered(offered: Offered, kind: str, place: str) -> None:
    plugins = offered(f"{HEAD}star: 1\n{place.format(kind)}")
    expected = {name: offer.summary for name, offer in Registry().offers()[kind].items()}
    assert {item["label"] for item in plugins} == set(expected)
    if "use" in place:  # with what they are for
        assert {item["label"]: item["documentation"] for item in plugins} == expected


def test_the_options_of_the_plugin_that_is_used_are_offered(offered: Offered) -> None:
    items = offered(f"{HEAD}star: 1\navoider:\n  use: orca\n  |\n")
    options = Registry().find("avoider", "orca").offer.options["properties"]
    assert {item["label"] for item in items} == set(options)
    assert next(i["documentation"] for i in items if i["label"] == "radius").endswith(", m.")


@pytest.mark.parametrize("head", [HEAD + TOP, STEPS], ids=["mission", "steps"])
def test_the_options_of_a_verb_are_offered_once_each(offered: Offered, head: str) -> None:
    options = offered(f"{head}mission:\n  - goto:\n      agents: cf1\n      |\n")
    assert [item["label"] for item in options] == [
        *("to", "by", "relative_to", "moving", "yaw_deg", "speed", "spacing", "within"),
        *("until", "timeout", "on_failure"),
    ]


@pytest.mark.parametrize(
    ("option", "values"),
    [
        ("goto:\n      on_failure: |", ["abort", "land", "continue"]),
        ("follow:\n      path: |", ["box", "circle", "figure8"]),
        ("follow:\n      relative: |", ["false", "true"]),
        ("hold:\n      until: {event: fo|}", EVENTS),
    ],
    ids=["set", "set with an example", "truth value", "condition"],
)
@pytest.mark.parametrize("head", [HEAD + TOP, STEPS], ids=["mission", "steps"])
def test_the_values_of_an_option_are_offered(
    offered: Offered, head: str, option: str, values: list[str]
) -> None:
    items = offered(f"{head}mission:\n  - {option}\n")
    assert sorted(item["label"] for item in items) == sorted(values)


@pytest.mark.parametrize(
    ("where", "key", "title", "unit"),
    [
        ("limits:", "speed", "Speed", "m/s"),
        ("limits:", "height", "Height", "m"),
        ("- takeoff:", "height", "Height", "m"),
        ("- goto:", "speed", "Speed", "m/s"),
        ("- goto:", "yaw_deg", "Yaw", "degrees"),
        ("- hold:", "for", "For", "s"),
        ("- hold:", "elapsed", "Elapsed", "s"),
        ("- hold:", "timeout", "Time-out", "s"),
        ("battery_low:", "below", "Below", "V"),
        ("localizer:", "max_report_age", "Max report age", "s"),
        ("avoider:", "radius", "Radius", "m"),
        ("cf1:", "start", "Start", "m"),
    ],
)
def test_hover_shows_title_and_unit(
    hovered: Hovered, where: str, key: str, title: str, unit: str
) -> None:
    shown = hovered(MISSION, where, key)
    assert shown.startswith(f"#### {title}\n")
    assert unit in [word.strip(".,;") for word in shown.partition("Source:")[0].split()]


@pytest.mark.parametrize(
    ("where", "key", "title", "words"),
    [
        ("- takeoff:", "height", "Height", ", m"),
        ("- goto:", "agents", "Agents", "an agent, a group, a list of them"),
        ("- goto:", "by", "By", ", m. Give this or 'to'"),
        ("- goto:", "on_failure", "On failure", "abort the mission, land, or continue"),
        ("- hold:", "for", "For", ", s."),
        ("- hold:", "until", "Until", "A condition"),
        ("- hold:", "elapsed", "Elapsed", ", s."),
        ("- repeat:", "times", "Times", "How many times."),
    ],
)
def test_what_is_a_parameter_is_explained_like_any_value(
    hovered: Hovered, where: str, key: str, title: str, words: str
) -> None:
    shown = hovered(PATROL, where, key)
    assert shown.startswith(f"#### {title}\n")
    assert words in shown


def test_a_verb_and_a_plugin_are_explained_under_the_pointer(
    server: LanguageServer, names: Iterator[Path]
) -> None:
    path = next(names)
    server.open(path, MISSION)
    lines = MISSION.splitlines()
    verb = next(i for i, text in enumerate(lines) if "- goto" in text)
    assert "Fly to a point" in server.hover(path, verb, 5)
    part = next(i for i, text in enumerate(lines) if text.startswith("planner"))
    assert "towards the goals" in server.hover(path, part, len("planner: st"))
    server.close(path)


@pytest.mark.parametrize(
    "path",
    sorted(
        path
        for part in (".", "steps", "worlds", "studies")
        for path in MISSIONS.glob(f"{part}/*.yaml")
    ),
    ids=lambda path: f"{path.parent.name} {path.stem}",
)
def test_a_file_that_ships_has_no_mark(marked: Marked, path: Path) -> None:
    first, _, rest = path.read_text(encoding="utf-8").partition("\n")
    assert first.startswith("# yaml-language-server: $schema=")
    schema = re.split(r"[/=]", first)[-1]
    assert marked(f"# yaml-language-server: $schema={schema}\n{rest}") == []


def covered(text: str, marks: list[dict[str, Any]]) -> Iterator[str]:
    """Yield what each mark in a text covers."""
    for mark in marks:
        begin, end = mark["range"]["start"], mark["range"]["end"]
        yield text.splitlines()[begin["line"]][begin["character"] : end["character"]]


@pytest.mark.parametrize(
    ("right", "wrong", "marks"),
    [
        ("speed: 0.3", "sped: 0.3", "sped"),
        ("takeoff:", "takeof:", "takeof"),
        ("radius:", "raduis:", "raduis"),
        ("orca", "orcaa", "orcaa"),
        ("planner:", "planer:", "planer"),
        ("below: 3.5", "below: low", "low"),
        ("height: 0.8", "height: -1", "-1"),
        ("elapsed: 1", "elapst: 1", "elapst"),
        ("height: 0.8", "height: top", "top"),
    ],
)
def test_a_mistake_has_one_mark_that_covers_it(
    marked: Marked, right: str, wrong: str, marks: str
) -> None:
    assert marked(MISSION) == []
    text = MISSION.replace(right, wrong)
    diagnostics = [
        diagnostic for diagnostic in marked(text) if "Missing property" not in diagnostic["message"]
    ]
    assert [*covered(text, diagnostics)] == [marks]


def test_a_file_of_steps_with_parameters_everywhere_has_no_mark(marked: Marked) -> None:
    assert marked(PATROL) == []


@pytest.mark.parametrize(
    ("right", "wrong", "marks"),
    [
        ("speed: 0.3", "sped: 0.3", "sped"),
        ("takeoff:", "takeof:", "takeof"),
        ("parameters:", "paramters:", "paramters"),
        ("height: $rise", "height: rise", "rise"),
        ("speed: 0.3", "speed: -1", "-1"),
        ("on_failure: $then", "on_failure: then", "then"),
        ("elapsed: 1", "elapst: 1", "elapst"),
        ("land: $how", "land: how", "how"),
        ("file: $file", "fle: $file, file: a", "fle"),
    ],
)
def test_problems_in_files_of_steps_have_one_covering_mark(
    marked: Marked, right: str, wrong: str, marks: str
) -> None:
    text = PATROL.replace(right, wrong)
    assert [*covered(text, marked(text))] == [marks]
