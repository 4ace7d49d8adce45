"""Setting values over a document that was read."""

from __future__ import annotations

import json
from typing import Any

import pytest

from star_core.errors import InputError
from star_yaml.document import Document
from star_yaml.input_file import override
from tests.plugins.formats.star_yaml.problems import document

MISSION = """\
# a comment
name: swap
limits: {speed: 0.5, height: [0.2, 1.8]}
swarm:
  cf1:
    start: [0, 0, 0]
avoider: orca
mission:
  - takeoff: {height: 1}
  - land:
"""


@pytest.fixture
def mission() -> Document:
    return document(MISSION)


def refused(document: Document, *assignments: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        override(document, assignments)
    return list(caught.value.problems)


@pytest.mark.parametrize(
    ("assignment", "path", "value"),
    [
        ("name=other", ("name",), "other"),
        ("limits.speed=0.3", ("limits", "speed"), 0.3),
        ("limits.height.1=2", ("limits", "height", 1), 2),
        ("swarm.cf1.start=[1, 2, 3]", ("swarm", "cf1", "start"), [1, 2, 3]),
        ("mission.0.takeoff.height=2", ("mission", 0, "takeoff", "height"), 2),
        ("seed=7", ("seed",), 7),
        ("safety.battery_low.below=3.5", ("safety",), {"battery_low": {"below": 3.5}}),
        ("avoider.radius=0.3", ("avoider",), {"use": "orca", "radius": 0.3}),
        ("avoider=none", ("avoider",), "none"),
        ("avoider={use: x, y: 1}", ("avoider", "y"), 1),
        ("name=a=b", ("name",), "a=b"),
        ("seed=~", ("seed",), None),
    ],
)
def test_assigned_values_are_set_and_located_at_the_assignment(
    mission: Document, assignment: str, path: tuple[str | int, ...], value: object
) -> None:
    changed = override(mission, [assignment])
    node: Any = changed.data
    for part in path:
        node = node[part]
    assert node == value
    if path != ("avoider",) or value == "none":
        assert changed.problem(path, "bad") == f"--set {assignment}: bad [invalid-option]"


def test_a_name_that_becomes_a_map_keeps_its_place(mission: Document) -> None:
    changed = override(mission, ["avoider.radius=-1"])
    assert changed.location_text(("avoider", "use")) == mission.location_text(("avoider",))
    assert changed.location_text(("avoider", "radius"), key=True) == "--set avoider.radius=-1"


def test_setting_a_value_forgets_the_places_below_the_old_one(mission: Document) -> None:
    changed = override(mission, ["swarm.cf1=here"])
    assert changed.location_text(("swarm", "cf1", "start", 0)) == "--set swarm.cf1=here"


def test_assignments_follow_one_another(mission: Document) -> None:
    changed = override(mission, ["avoider=apf", "avoider.gain=2", "avoider.gain=3"])
    assert changed.data["avoider"] == {"use": "apf", "gain": 3}


def test_setting_leaves_the_document_it_is_set_over_alone(mission: Document) -> None:
    before = json.dumps(mission.data)
    override(mission, ["avoider.radius=1", "limits.height.0=1"])
    assert json.dumps(mission.data) == before


@pytest.mark.parametrize(
    ("assignment", "problem"),
    [
        ("avoider", "has no '=', expected path=value such as avoider.radius=0.3"),
        ("=1", "expected keys joined by dots before the '='"),
        ("limits..speed=1", "expected keys joined by dots before the '='"),
        ("seed=", "has no value after the '='"),
        ("seed=# none", "has no value after the '='"),
        ("name.x=1", "'name' is 'swap' and has no 'x'"),
        ("swarm.cf1.start.0.x=1", "'swarm.cf1.start.0' is 0 and has no 'x'"),
        ("mission.2={}", "'mission' has no item 2; the last is 1"),
        ("mission.99999999999999999999.land={}", "'mission' has no item 99999999999999999999; "),
        ("mission.-1={}", "'mission' is a list: expected an index in place of '-1'"),
        ("mission.first={}", "'mission' is a list: expected an index in place of 'first'"),
        ("seed=.nan", ".nan is not a plain, finite decimal number"),
        ("seed=[1", "'[' is not closed; add ']'"),
        ("seed=&x 1", "anchor '&x' is refused; write the value out"),
        ("a\n\udcff=1_0", "1_0 is not a plain, finite decimal number"),
    ],
)
def test_an_assignment_that_cannot_be_followed_is_refused(
    mission: Document, assignment: str, problem: str
) -> None:
    (message,) = refused(mission, assignment)
    shown = assignment.replace("\n", "\\n").replace("\udcff", "\\udcff")
    assert message.startswith(f"--set {shown}: {problem}")


def test_an_empty_list_has_no_item_to_set() -> None:
    assert refused(document("a: []"), "a.0=1") == [
        "--set a.0=1: 'a' has no item 0; it is empty [invalid-assignment]"
    ]


def test_all_assignments_that_cannot_be_followed_are_listed(mission: Document) -> None:
    assert len(refused(mission, "seed", "name=ok", "name.x=1")) == 2
