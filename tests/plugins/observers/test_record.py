"""What a run leaves behind, and that recording costs no flight."""

from __future__ import annotations

import json
import logging
import math
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias
from zipfile import ZipFile

import numpy as np
import pytest

from star_core import (
    AgentPhase,
    Array,
    Flight,
    InputError,
    Telemetry,
    Tick,
    TransportSpec,
    Truth,
    hookimpl,
    read_run,
)
from star_core.discovery import Source
from star_core.plugin_support.registry import Registry
from star_core.runner import fly
from star_record.recorder import Recorder
from star_record.text_log import TextLog
from star_sim import ideal_world
from star_sim.transport import Simulator
from star_yaml.mission_loader import load

WORLD = """\
star: 1
name: room
fence: {low: [-2, -2, 0], high: [2, 2, 2]}
obstacles:
  pillar: {polygon: [[0.8, 0.8], [1.2, 0.8], [1.2, 1.2], [0.8, 1.2]], height: [0, 2]}
"""
MISSION = """\
star: 1
name: kept
world: room.yaml
seed: 4
limits: {speed: 0.4}
swarm:
  cf1: {start: [-0.5, 0, 0], yaw_deg: 90}
  cf2: {start: [0.5, 0.2, 0]}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {agents: cf1, height: 0.4, speed: 0.5}
  - goto: {agents: cf1, by: [0, -0.3, 0]}
  - land: {speed: 0.5}
"""
TRUTH = {"truth_position": (3,), "truth_attitude": (4,)}
COLUMNS: Mapping[str, Callable[[Tick], Any]] = {
    "estimate_position": lambda tick: tick.estimate.position,
    "estimate_position_std": lambda tick: np.sqrt(
        np.diagonal(tick.estimate.covariance, axis1=1, axis2=2)
    ),
    "estimate_velocity": lambda tick: tick.estimate.velocity,
    "estimate_yaw": lambda tick: tick.estimate.yaw,
    "estimate_valid": lambda tick: tick.estimate.valid,
    "goal_position": lambda tick: tick.goals.position,
    "goal_active": lambda tick: tick.goals.active,
    "setpoint_velocity": lambda tick: tick.sent.velocity,
    "setpoint_yaw": lambda tick: tick.sent.yaw,
    "setpoint_active": lambda tick: tick.sent.active,
    "phase": lambda tick: tick.health.phase,
    "battery": lambda tick: tick.health.battery,
}
"""What a column holds of each tick."""

Run: TypeAlias = tuple[Path, dict[str, Any], list[Tick]]


class Watcher:
    """An observer that keeps the ticks."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self.ticks.append(tick)


class Blind(Simulator):
    """A simulator that does not know where its drones are."""

    def truth(self) -> Truth | None:
        return None


class Blinds:
    """A plugin that offers the transport ``blind``."""

    @hookimpl
    def star_transports(self) -> Iterable[TransportSpec]:
        return [TransportSpec(name="blind", summary="Knows no truth.", make=_blind, realtime=False)]


def _blind(scene: Any) -> Blind:
    return Blind(scene, **ideal_world())


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(WORLD)
    Path("m.yaml").write_text(MISSION)


def flown(*plugins: object, folder: Path | None, assignments: Iterable[str] = ()) -> dict[str, Any]:
    """Fly the mission, watched by more plugins, and return the summary."""
    registry = Registry()
    for number, plugin in enumerate(plugins):
        registry.add(plugin, Source(f"their-dist:{number}"))
    return fly(load(Path("m.yaml"), registry, list(assignments)), registry, folder=folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A folder of a run, the summary of its flight, and the ticks it was made of."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "room.yaml").write_text(WORLD)
    (folder / "m.yaml").write_text(MISSION)
    registry, watcher = Registry(), Watcher()
    registry.add(watcher, Source("their-dist:watcher"))
    out = folder / "runs" / "one"
    summary = fly(load(folder / "m.yaml", registry), registry, folder=out)
    return out, summary, watcher.ticks


@pytest.fixture(scope="module")
def trajectory(run: Run) -> dict[str, Any]:
    with np.load(run[0] / "trajectory.npz", allow_pickle=False) as file:
        return dict(file)


# The folder


def test_a_run_leaves_a_manifest_a_summary_and_a_trajectory(run: Run) -> None:
    assert sorted(path.name for path in run[0].iterdir()) == [
        "log.txt",
        "manifest.json",
        "paths.npz",
        "summary.json",
        "timing.json",
        "timing.npz",
        "trajectory.npz",
    ]


def test_the_times_of_every_tick_are_kept(run: Run) -> None:
    recorded = read_run(run[0])
    timing = recorded.timing
    assert (timing["time"] == recorded.arrays["time"]).all()
    assert (timing["late"] == 0).all()
    stages = sum(timing[name] for name in ("localizer", "planner", "avoider", "safety"))
    assert (timing["tick"] > stages).all()
    mean = 1e6 * timing["planner"][timing["planner"] > 0].sum()
    ticks, agents = len(timing["time"]), len(recorded.agents)
    assert mean / ticks / agents == pytest.approx(run[1]["compute_us"]["planner"], rel=0.05)


def test_planned_paths_are_kept_when_they_change(run: Run) -> None:
    recorded, ticks = read_run(run[0]), run[2]
    paths = recorded.paths
    for row in (0, 1):
        numbers = paths.current(row, recorded.arrays["time"])
        for tick, number in zip(ticks, numbers.tolist(), strict=True):
            planned = tick.plan.paths.of(row)
            kept = paths.points(number) if number >= 0 else planned[:0]
            np.testing.assert_array_equal(planned[1:], kept)
            assert (planned[:1] == tick.estimate.position[row]).all()
    assert 0 < len(paths.time) < 10


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("trajectory.npz", b"PK\x01\x02", b"PK\x01\x03"),
        ("timing.npz", b"late.npy", b"lat_.npy"),
        ("manifest.json", b'"low":', b'"lo_":'),
        ("manifest.json", b'"swarm":', b'"swar_":'),
        ("summary.json", b"{", b"["),
        ("timing.json", b"{", b"["),
    ],
)
def test_a_damaged_record_is_refused_with_its_folder(
    run: Run, tmp_path: Path, name: str, old: bytes, new: bytes
) -> None:
    copy = shutil.copytree(run[0], tmp_path / "copy")
    content = (copy / name).read_bytes()
    assert old in content
    (copy / name).write_bytes(content.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read_run(copy)
    assert str(error.value).startswith(f"{copy}: the record cannot be read: ")
    assert error.value.code == "no-record"


def test_an_array_whose_header_is_damaged_is_refused(run: Run, tmp_path: Path) -> None:
    copy = shutil.copytree(run[0], tmp_path / "copy")
    with ZipFile(run[0] / "timing.npz") as good, ZipFile(copy / "timing.npz", "w") as damaged:
        for name in good.namelist():
            content = good.read(name)
            assert b"'shape': (" in content
            damaged.writestr(name, content.replace(b"'shape': (", b"'shape':((", 1))
    with pytest.raises(InputError, match="the record cannot be read: "):
        read_run(copy)


def test_the_summary_is_what_the_flight_returned(run: Run) -> None:
    folder, summary, _ = run
    assert read_run(folder).summary == summary


def test_the_manifest_is_there_before_anything_moves() -> None:
    class Early:
        has_manifest: bool | None = None

        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            if self.has_manifest is None:
                self.has_manifest = json.loads(Path("out/manifest.json").read_text())["seed"] == 4

    flown(early := Early(), folder=Path("out"))
    assert early.has_manifest


# The columns


def test_the_trajectory_holds_these_columns_and_no_others(trajectory: dict[str, Any]) -> None:
    assert set(trajectory) == {"agents", "time", *COLUMNS, *TRUTH}


def test_agents_stand_in_the_order_of_the_swarm(trajectory: dict[str, Any]) -> None:
    assert trajectory["agents"].tolist() == ["cf1", "cf2"]


@pytest.mark.parametrize(
    ("column", "told"),
    [
        *COLUMNS.items(),
        ("time", lambda tick: tick.time),
        ("truth_position", lambda tick: tick.truth.position),
        ("truth_attitude", lambda tick: tick.truth.attitude),
    ],
)
def test_a_column_holds_what_the_ticks_were_made_of(
    run: Run, trajectory: dict[str, Any], column: str, told: Any
) -> None:
    expected = np.array([told(tick) for tick in run[2]])
    assert np.array_equal(trajectory[column], expected)
    assert trajectory[column].dtype == expected.dtype


# Truth


def test_where_there_is_no_truth_none_is_kept() -> None:
    summary = flown(Blinds(), folder=Path("out"), assignments=["transport=blind"])
    with np.load("out/trajectory.npz") as file:
        assert set(file) == {"agents", "time", *COLUMNS}
    assert summary["position_rmse_m"] is None


class Dim(Simulator):
    """A simulator that knows where its drones are at every other tick from the second on."""

    asked = 0

    def truth(self) -> Truth | None:
        self.asked += 1
        return super().truth() if self.asked % 2 == 0 else None


def test_ticks_without_ground_truth_are_recorded_as_nan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "Blind", Dim)
    flown(Blinds(), folder=Path("out"), assignments=["transport=blind"])
    with np.load("out/trajectory.npz") as file:
        ticks = len(file["time"])
        for name, shape in TRUTH.items():
            assert file[name].shape == (ticks, 2, *shape)
            assert np.isnan(file[name][0::2]).all()
            assert np.isfinite(file[name][1::2]).all()


class Heard(Simulator):
    """A simulator that reports its signal strength at every other tick."""

    asked = 0

    def receive(self) -> Telemetry:
        self.asked += 1
        told = super().receive()
        return replace(told, signal=np.array([-44.0, -61.0])) if self.asked % 2 == 0 else told


def test_the_signal_is_kept_where_agents_hear_a_radio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "Blind", Heard)
    flown(Blinds(), folder=Path("out"), assignments=["transport=blind"])
    with np.load("out/trajectory.npz") as file:
        assert (file["signal"][0::2] == [-44.0, -61.0]).all()
        assert np.isnan(file["signal"][1::2]).all()


def test_targets_csv_has_finder_time_and_position_of_each_target() -> None:
    sightings = [
        {"name": "red", "finder": "cf2", "time_s": 12.5, "position_m": [1.0, -0.25, 0.0],
         "error_m": 0.03},
        {"name": "blue, far", "finder": "cf1", "time_s": 13.0, "position_m": [0.0, 2.0, 0.0],
         "error_m": 0.12345},
    ]  # fmt: skip
    scene = load(Path("m.yaml"), Registry()).scene
    recorder = Recorder(Flight("kept", scene, {}, Path("out")), Path("out"))
    targets = {"found": 2, "total": 3, "list": sightings}
    recorder.close({"outcome": "completed", "reason": "", "targets": targets})
    assert Path("out/targets.csv").read_text().splitlines() == [
        "target,finder,time_s,x_m,y_m,z_m,error_m",
        "red,cf2,12.500,1.0000,-0.2500,0.0000,0.0300",
        '"blue, far",cf1,13.000,0.0000,2.0000,0.0000,0.1235',
    ]


def test_log_txt_has_the_lines_of_stderr() -> None:
    class Talker:
        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            if 1.0 <= tick.time < 1.0 + 1e-6:
                logging.getLogger("their_plugin").warning("said %d", 7)
            logging.getLogger("their_plugin").info("not shown")

    registry = Registry()
    registry.add(Talker(), Source("their-dist:talker"))
    summary = fly(load(Path("m.yaml"), registry), registry, folder=Path("out"))
    lines = Path("out/log.txt").read_text().splitlines()
    events = [f"{event['time']:8.2f} s  {event['text']}" for event in summary["events"]]
    assert [line for line in lines if "star: " not in line] == [*events, lines[-1]]
    assert lines[-1].endswith(" s  completed")
    assert "    0.95 s  star: said 7" in lines  # the time of the tick before
    assert not any(isinstance(handler, TextLog) for handler in logging.getLogger().handlers)


def apart(a: Array, b: Array) -> Array:
    return np.asarray(np.linalg.norm(a - b, axis=-1))


def test_the_figures_of_the_summary_follow_from_the_trajectory(
    run: Run, trajectory: dict[str, Any]
) -> None:
    _, summary, _ = run
    truth, flying = trajectory["truth_position"], trajectory["phase"] == AgentPhase.FLYING
    length = apart(truth[1:], truth[:-1]).sum(axis=0)
    error = apart(truth, trajectory["estimate_position"])[flying]
    pairs = [apart(truth[:, i], truth[:, j]).min() for i, j in combinations(range(2), 2)]
    assert summary["path_length_m"]["per_agent"] == pytest.approx(
        dict(zip(["cf1", "cf2"], length, strict=True))
    )
    assert summary["position_rmse_m"] == pytest.approx(math.sqrt(np.mean(error**2)))
    assert summary["min_separation_m"] == pytest.approx(min(pairs))
    assert summary["flight_time_s"] == pytest.approx(trajectory["time"][-1])


# When it cannot be written


def test_failing_to_create_the_folder_does_not_end_the_flight() -> None:
    summary = flown(folder=Path("m.yaml/out"))
    assert summary["outcome"] == "completed"
    (told,) = [event for event in summary["events"] if event["kind"] == "observer"]
    assert told["text"].startswith("star-swarm:record is dropped: star_mission_started raised ")
    assert "m.yaml/out" in told["text"]


def test_losing_the_folder_in_flight_does_not_fail_the_flight(
    caplog: pytest.LogCaptureFixture,
) -> None:
    class Vandal:
        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            shutil.rmtree("out", ignore_errors=True)

    with caplog.at_level(logging.WARNING):
        summary = flown(Vandal(), folder=Path("out"))
    assert summary["outcome"] == "completed"
    assert (
        "observer star-swarm:record is dropped for this flight: star_mission_ended" in caplog.text
    )


def test_what_was_flown_until_python_was_interrupted_is_kept() -> None:
    class Breaker(Watcher):
        @hookimpl
        def star_ticked(self, tick: Tick) -> None:
            self.ticks.append(tick)
            if len(self.ticks) == 20:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flown(Breaker(), folder=Path("out"))
    with np.load("out/trajectory.npz") as file:
        assert len(file["time"]) >= 19
