"""What ``docs/hardware.md`` lists to run is understood, and its missions can be flown."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from shutil import copyfile
from textwrap import dedent

import pytest

from star_core import Mission, Registry, load

ROOT = Path(__file__).parents[4]
PAGE = (ROOT / "docs/hardware.md").read_text("utf-8")
RUNS = re.findall(
    r"^ *star run (missions/(?:first|three)\S+) (.*?)^ *```", PAGE, re.DOTALL | re.MULTILINE
)
PICTURES = re.search(r"```yaml\n( *star: 1.*?)^ *```", PAGE, re.DOTALL | re.MULTILINE)


def loaded(mission: str, words: str) -> Mission:
    told = shlex.split(words.replace("\\\n", " "))
    assignments = [value for flag, value in zip(told[::2], told[1::2], strict=True)]
    assert set(told[::2]) == {"--set"}
    return load(ROOT / mission, Registry(), assignments)


@pytest.mark.parametrize(("mission", "words"), RUNS, ids=[mission for mission, _ in RUNS])
def test_a_rehearsal_flies_every_agent_over_a_link_of_its_own(mission: str, words: str) -> None:
    rehearsal = loaded(mission, words)
    assert rehearsal.plugins["transport"].use == "radio"
    uris = {agent.uri for agent in rehearsal.scene.agents}
    assert len(uris) == len(rehearsal.scene.agents) == 3
    assert None not in uris
    names = {agent.name for agent in rehearsal.scene.agents if agent.camera}
    assert names == set(rehearsal.plugins["transport"].options.get("cameras", {}))


def test_both_rehearsals_are_there() -> None:
    assert [mission for mission, _words in RUNS] == [
        "missions/first_flight.yaml",
        "missions/three_eyes.yaml",
    ]


def test_the_mission_that_takes_pictures_can_be_flown(tmp_path: Path) -> None:
    assert PICTURES is not None
    (tmp_path / "worlds").mkdir()
    copyfile(ROOT / "missions/worlds/lab_4x4.yaml", tmp_path / "worlds/lab_4x4.yaml")
    (tmp_path / "pictures.yaml").write_text(dedent(PICTURES[1]))
    [agent] = load(tmp_path / "pictures.yaml", Registry()).scene.agents
    assert agent.camera is not None
    assert (agent.camera.width, agent.camera.height) == (324, 244)
