"""Messages about a swarm of a thousand agents stay short; the record names all of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Agent, Scene, Supervisor, Telemetry, World
from star_core.errors import StarError, suggestion
from star_core.world.world import Fence
from tests.core import conftest
from tests.core.conftest import Lab

NAMES = tuple(f"cf{i}" for i in range(1, 1001))
SHORT = "cf1, cf2, cf3, cf4, cf5, cf6, cf7, cf8, cf9, cf10 and 990 more"
MAX_LENGTH = 600  # characters of a message


@pytest.fixture
def swarm(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> Lab:
    """A laboratory of a thousand agents, in a hall."""
    monkeypatch.setattr(conftest, "WORLD", conftest.WORLD.replace("9", "1000"))
    lab.swarm = NAMES
    return lab


def flying(receive: Callable[[], Telemetry]) -> Telemetry:
    """Report that all agents are in the air, where their commanders lead them."""
    telemetry = receive()
    return replace(telemetry, state=np.full_like(telemetry.state, int(Supervisor.FLYING)))


def texts(value: Any) -> list[str]:
    """Return all texts in a summary but the names of lists of agents."""
    if isinstance(value, dict):
        return [text for inner in value.values() for text in texts(inner)]
    if isinstance(value, list):
        return [text for inner in value for text in texts(inner)]
    return [value] if isinstance(value, str) else []


def test_a_scene_names_at_most_ten_agents() -> None:
    fence = Fence((-9.0, -9.0, 0.0), (9.0, 9.0, 2.0))
    agents = tuple(Agent(name, (0.0, 0.0, 0.0)) for name in NAMES)
    scene = Scene(agents, 0.1, World("hall", fence))
    assert scene.named(range(1000)) == SHORT
    assert scene.named(range(350, 361)).endswith(", cf360 and 1 more")
    assert scene.named(range(10)) == SHORT.removesuffix(" and 990 more")
    assert scene.label(range(999)) == SHORT.replace("990", "989")


@pytest.mark.extended
def test_reports_on_a_thousand_airborne_agents_are_abbreviated(swarm: Lab) -> None:
    swarm.spoil("transport", "receive", flying)
    summary = swarm.fly("\n  - climb: {timeout: 0.3}\n")
    late = "climb all agents failed: timed out after 0.3 s: cf1 is taking off, cf2 is"
    assert late in summary["reason"]
    assert summary["reason"].endswith(f"; {SHORT} did not report to be on the ground")
    assert max(map(len, texts(summary))) < MAX_LENGTH
    (waiting,) = [e for e in summary["events"] if e["text"].startswith("waiting for")]
    assert waiting["details"]["agents"] == list(NAMES)
    (step,) = summary["steps"]
    assert step["agents"] == list(NAMES)
    assert [cause.split()[0] for cause in step["causes"]] == list(NAMES)


def test_misspelt_agents_in_large_swarms_give_a_short_error(swarm: Lab) -> None:
    with pytest.raises(StarError) as raised:
        swarm.load("\n  - climb: {agents: zzz}\n")
    assert f"there are: {SHORT.replace('990', '991')} [unknown-agent]" in str(raised.value)


def test_all_names_that_are_not_agents_are_listed() -> None:
    assert suggestion("x", ["q"] * 20, "there are") == "; there are: " + ", ".join(["q"] * 20)
