"""The diagram in docs/architecture.md shows the calls of a tick in their order."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from star_core.tick import ControlLoop
from tests.core.conftest import Lab

DIAGRAM = Path(__file__).parents[2] / "docs" / "site" / "tick_diagram.py"
CALLED = {  # classes that are called, or that call plugins, by their lines in the diagram
    "VehicleInterface": "VehicleInterface",
    "StepExecutor": "StepExecutor",
    "SafetyFilter": "SafetyFilter",
    "transport": "PluginPipeline",
    "localizer": "PluginPipeline",
    "planner": "PluginPipeline",
    "avoider": "PluginPipeline",
}
SELDOM = {"PluginPipeline.correct", "PluginPipeline.command", "VehicleInterface.send_command"}


def test_the_diagram_has_the_calls_of_a_tick(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = runpy.run_path(str(DIAGRAM))
    expected = [
        f"{CALLED[name]}.{method}"
        for _, callee, text, _ in drawn["CALLS"]
        if (name := drawn["LINES"][callee]) in CALLED
        for method in text.partition(", of")[0].split(", ")
    ]
    called: list[str] = []
    tick, ticks = ControlLoop.tick, iter(range(10**6))

    def note(frame: FrameType, event: str, _argument: Any) -> None:
        if event == "call" and frame.f_code.co_qualname in expected:
            called.append(frame.f_code.co_qualname)

    def traced(loop: ControlLoop) -> Any:
        if next(ticks) != 20:
            return tick(loop)
        sys.setprofile(note)
        try:
            return tick(loop)
        finally:
            sys.setprofile(None)

    monkeypatch.setattr(ControlLoop, "tick", traced)
    lab.fly()
    assert called == [name for name in expected if name not in SELDOM]
