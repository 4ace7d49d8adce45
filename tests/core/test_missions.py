"""Every mission in the repository flies, and two flights with the same seed are the same."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import star_sim
from star_core import Registry, fly, load
from star_core.commands.main import main
from star_core.toolkit import actions, fill_defaults

MISSIONS = Path(__file__).parents[2] / "missions"
GEOMETRIC = "transport.camera.mode=geometric"  # not images, which three_eyes has
IN_PROCESS = "localizer.processes=0"  # a process takes seconds to start; results are the same
PAPER = (GEOMETRIC, IN_PROCESS, "mission.1.follow.until={elapsed: 8}")
SETTINGS = {  # to shorten long flights, and to fly `external` beside other tests
    "around": (IN_PROCESS,),
    "external": ("mission.1.external.port=0",),
    "handover": ("mission.2.wait.until={elapsed: 1}",),
    "paper_box": PAPER,
    "paper_circle": PAPER,
    "paper_figure8": PAPER,
    "paths": (
        "mission.1.follow.until={elapsed: 6}",
        "mission.2.parallel.1.repeat.times=1",
        "mission.4.follow.until={elapsed: 6}",
    ),
    "relief": (
        "mission.1.repeat.times=1",
        "mission.1.repeat.steps.0.search.area={low: [-2.8, -1.5], high: [2.8, 0.5]}",
        "transport.endurance=60",
        "transport.swap_time=15",
    ),
    "search": ("mission.1.search.speed=0.45", IN_PROCESS),
    "three_eyes": ("mission.1.follow.until={elapsed: 1}", IN_PROCESS),
    "trajectory": (
        "limits.speed=1",
        "mission.1.follow.timescale=1.1",
        "mission.2.follow.timescale=1.1",
    ),
}
EXTENDED = {
    "around", "paper_box", "paper_circle", "paths", "relief", "search", "search_flow", "three_eyes",
    "trajectory",
}  # fmt: skip
UNREHEARSED = {
    "external",  # how long its program takes is unknown
    "search",  # ends 15 s later if a fast camera misses a target in passing
}
WARNINGS = {  # with tags detected on board, which a search may not see for some time
    "relief": {"drift-exceeds-clearance"}
}


def flown(mission: Path, out: Path, settings: Sequence[str] = ()) -> tuple[dict[str, Any], float]:
    """Fly a mission and record it in `out`; return its summary, and how long its rehearsal takes.

    `star run` would rehearse it twice more: for its checks, and for the time that is left.
    """
    registry = Registry()
    changed = load(mission, registry, settings)
    summary = fly(changed, registry, folder=out)
    assert (summary["outcome"], summary["reason"]) == ("completed", "")
    rehearsal = registry.manager.hook.star_rehearse(mission=changed, registry=registry)
    return summary, rehearsal.duration


@pytest.mark.parametrize(
    "mission",
    [
        pytest.param(
            path, marks=[pytest.mark.extended] if path.stem in EXTENDED else [], id=path.stem
        )
        for path in sorted(MISSIONS.glob("*.yaml"))
    ],
)
def test_every_mission_checks_and_completes_without_collision(
    mission: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One flight each shows this, and that a rehearsal takes as long."""
    assert main(["check", str(mission)]) == 0
    warnings = re.findall(r"warning: .* \[(.*)\]$", capsys.readouterr().err, re.MULTILINE)
    assert {*warnings} == WARNINGS.get(mission.stem, set())
    summary, rehearsed = flown(mission, tmp_path, SETTINGS.get(mission.stem, ()))
    assert summary["collisions"] == {"agent_agent": 0, "agent_obstacle": 0}
    assert summary["targets"]["found"] == summary["targets"]["total"]
    if mission.stem not in UNREHEARSED:
        assert rehearsed == pytest.approx(summary["steps"][-1]["ended_s"], rel=0.1)


def test_by_default_the_world_is_that_of_a_careful_lab() -> None:
    options = fill_defaults({}, star_sim.OPTIONS)
    assert (options["profile"], options["controller"]) == ("realistic", "pid")


@pytest.mark.campaign
@pytest.mark.parametrize("mission", sorted(MISSIONS.glob("paper_*.yaml")), ids=lambda p: p.stem)
def test_the_flights_of_the_paper_complete_all_their_laps(mission: Path, tmp_path: Path) -> None:
    summary, _ = flown(mission, tmp_path)
    assert summary["position_rmse_m"] < 0.05


@pytest.mark.campaign
@pytest.mark.parametrize(
    "name", ["handover", "paths", "relief", "search", "three_eyes", "trajectory"]
)
def test_long_missions_complete_as_they_are(name: str, missions: Path, tmp_path: Path) -> None:
    summary, _ = flown(missions / f"{name}.yaml", tmp_path)
    assert summary["collisions"]["agent_agent"] == 0


def test_from_python_paths_may_be_text(missions: Path, tmp_path: Path) -> None:
    registry = Registry()
    mission = load(
        str(missions / "first_flight.yaml"), registry, ["mission=[takeoff: {}, land: {}]"]
    )
    summary = fly(mission, registry, folder=str(tmp_path))
    assert summary["outcome"] == "completed"
    assert (tmp_path / "summary.json").exists()


def test_options_have_defaults_beside_what_is_written() -> None:
    mission = load(
        MISSIONS / "first_flight.yaml", Registry(), ["avoider={use: orca, radius: 0.25}"]
    )
    avoider = mission.plugins["avoider"]
    assert avoider.written == {"radius": 0.25}
    assert avoider.options["radius"] == 0.25
    assert {*avoider.options} > {*avoider.written}
    takeoff = next(actions(mission.steps))
    assert takeoff.verb == "takeoff"
    assert {*takeoff.options} > {*takeoff.written}
    assert takeoff.options["speed"] > 0
