"""``star evaluate`` against known errors, offsets and transforms, and against evo."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import AgentPhase, Array, InputError, Run, read_run
from star_core.messages.telemetry import Detections
from star_core.testing import scene
from star_core.toolkit import PlannedPaths
from star_evaluate.evaluation import Alignment, evaluate, recorded_truth
from star_evaluate.truth_files import read_truth
from tests.commands import Printed, command

star_evaluate = command("evaluate")

TIME = np.arange(0.0, 20.0, 0.05)
TURNED = Rotation.from_euler("ZYX", [0.7, -0.02, 0.03])
MOVED = np.array([3.0, -1.0, 0.2])


def path(time: Array, number: int = 0) -> Array:
    """Where an agent flies, (T, 3) m: from 2 s to 18 s, it rests before and after."""
    flown = np.clip(time, 2.0, 18.0) - 2.0
    x = 0.8 * np.sin(0.9 * flown + number)
    return np.column_stack([x, 0.6 * np.sin(0.5 * flown) + number, 0.8 + 0.2 * np.cos(flown)])


def flight(*, error: float = 0.0, agents: int = 2, seed: int = 0) -> Run:
    """A record of agents that fly from 2 s to 18 s, whose estimates err with a deviation, m."""
    names = tuple(f"cf{i + 1}" for i in range(agents))
    noise = error * np.random.default_rng(seed).standard_normal((len(TIME), agents, 3))
    estimate = np.stack([path(TIME, i) for i in range(agents)], axis=1) + noise
    flying = (TIME > 2) & (TIME < 18)
    phase = np.where(flying, AgentPhase.FLYING, AgentPhase.GROUNDED)
    return Run(
        folder=Path("run"),
        manifest={},
        summary={},
        arrays={
            "time": TIME,
            "estimate_position": estimate,
            "estimate_position_std": np.full_like(estimate, max(error, 1e-3)),
            "phase": np.repeat(phase[:, None], agents, axis=1),
        },
        detections=Detections.none(),
        paths=PlannedPaths.none(),
        timing={},
        agents=names,
        swarm=(),
        world=scene(1).world,
    )


def truth(
    *, agents: int = 2, later: float = 0.0, rotation: Rotation | None = None
) -> dict[str, Array]:
    """Ground truth at 100 Hz, by a clock that is ahead and in another frame."""
    time = np.arange(-5.0, 30.0, 0.01)
    back = (rotation or Rotation.identity()).inv()
    moved = MOVED if rotation else np.zeros(3)
    return {
        f"cf{i + 1}": np.column_stack([time + later, back.apply(path(time, i) - moved)])
        for i in range(agents)
    }


def test_known_errors_are_measured() -> None:
    errors = evaluate(flight(error=0.02), truth()).every
    assert errors.mse == pytest.approx(3 * 0.02**2, rel=0.1)
    assert errors.rmse == pytest.approx(math.sqrt(errors.mse))
    assert errors.nees == pytest.approx(1.0, rel=0.1)
    assert errors.coverage == 1.0
    assert errors.samples == 2 * 319


def test_the_length_is_that_of_the_true_path() -> None:
    errors = evaluate(flight(error=0.05), truth()).agents["cf1"]
    steps = np.diff(path(TIME[(TIME > 2) & (TIME < 18)]), axis=0)
    assert errors.path_length == pytest.approx(np.linalg.norm(steps, axis=1).sum(), rel=1e-3)


@pytest.mark.parametrize("later", [0.0, 3.217, 1.7e9])
def test_an_unknown_offset_is_found(later: float) -> None:
    result = evaluate(flight(error=0.002), truth(later=later), offset=None)
    assert result.offset == pytest.approx(-later, abs=0.001)
    assert result.every.rmse < 0.005


@pytest.mark.parametrize(("align", "tilt"), [("rigid", True), ("yaw", False)])
def test_a_known_transform_is_found(align: Alignment, *, tilt: bool) -> None:
    turned = TURNED if tilt else Rotation.from_euler("z", -2.5)
    evaluation = evaluate(
        flight(error=1e-4), truth(later=2.0, rotation=turned), offset=None, align=align
    )
    assert evaluation.rotation == pytest.approx(turned.as_matrix(), abs=1e-3)
    assert evaluation.translation == pytest.approx(MOVED, abs=2e-3)
    assert evaluation.every.rmse < 1e-3


def test_without_an_alignment_none_is_applied() -> None:
    result = evaluate(flight(), truth(rotation=Rotation.from_euler("z", 1.0)))
    assert np.array_equal(result.rotation, np.eye(3))
    assert result.every.rmse > 0.5


def test_gaps_of_the_truth_are_left_out() -> None:
    tracks = {
        name: track[(track[:, 0] < 6) | (track[:, 0] > 10)] for name, track in truth().items()
    }
    errors = evaluate(flight(error=0.01), tracks).every
    assert errors.coverage == pytest.approx(0.75, abs=0.01)
    assert errors.rmse == pytest.approx(0.01 * math.sqrt(3), rel=0.1)


def test_a_truth_of_another_time_is_refused() -> None:
    with pytest.raises(InputError, match=r"no time in common; find their offset by --offset auto"):
        evaluate(flight(), truth(later=100.0))


def test_a_record_without_truth_has_none() -> None:
    assert recorded_truth(flight()) == {}


def write_tum(file: Path, track: Array) -> None:
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (len(track), 1))
    np.savetxt(file, np.column_stack([track, quaternion]), fmt="%.9f")


@pytest.mark.parametrize("flags", [[], ["-a"]])
def test_evo_computes_the_same(tmp_path: Path, flags: list[str]) -> None:
    """evo is GPL-3: it is called as a program, and not imported."""
    run = flight(error=0.02, agents=1)
    # at the same times, since evo takes the nearest pose and does not interpolate
    turned = TURNED if flags else Rotation.identity()
    moved = MOVED if flags else np.zeros(3)
    tracks = {"cf1": np.column_stack([TIME, turned.inv().apply(path(TIME) - moved)])}
    rows = (TIME > 2) & (TIME < 18)
    write_tum(tmp_path / "truth.tum", tracks["cf1"])
    estimate = np.column_stack([TIME, run.arrays["estimate_position"][:, 0]])[rows]
    write_tum(tmp_path / "estimate.tum", estimate)
    ape = subprocess.run(
        [Path(sys.executable).with_name("evo_ape"), "tum", "truth.tum", "estimate.tum", *flags],
        env={**os.environ, "HOME": str(tmp_path)},  # it writes its settings there
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    ours = evaluate(
        run,
        read_truth(tmp_path / "truth.tum", {"cf1": "cf1"}, ""),
        align="rigid" if flags else "none",
    ).every
    for name, value in {"rmse": ours.rmse, "max": ours.worst}.items():
        theirs = float(re.findall(rf"\b{name}\s+(\S+)", ape.stdout)[0])
        assert value == pytest.approx(theirs, abs=2e-6)


CSV = "time,body,x,y,z\n0,drone,1,2,3\n0.5,other,0,0,0\n1,drone,1.5,2,3\n2,other,0,0,1\n"


def test_a_table_names_its_bodies(tmp_path: Path) -> None:
    (tmp_path / "truth.csv").write_text(CSV)
    tracks = read_truth(tmp_path / "truth.csv", {"cf1": "drone", "cf2": "cf2"}, "")
    assert tracks.keys() == {"cf1"}
    assert tracks["cf1"].tolist() == [[0, 1, 2, 3], [1, 1.5, 2, 3]]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.tum", "0 1 2\n", r"a.tum:1: expected 8 numbers: time x y z qx qy qz qw \[inv"),
        ("a.tum", "0 1 2 3 0 0 0 1\n", r"a.tum: a trajectory has fewer than two poses"),
        ("a.csv", "time,x,y\n", r"a.csv:1: expected columns time, x, y, z"),
        ("a.csv", "time,x,y,z\n0,1,2,north\n", r"a.csv:2: expected numbers"),
        ("a.bag", "", r"a.bag: expected a .tum, .txt, .csv or .mcap file"),
        ("a.csv", "time,body,x,y,z\n0,other,1,2,3\n", r"a.csv: no trajectory of cf1"),
        ("a.mcap", "no such file", r"a.mcap: "),
    ],
)
def test_what_is_wrong_in_a_file_is_located(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        read_truth(tmp_path / name, {"cf1": "cf1"}, "/{}/pose")


def test_several_agents_need_several_trajectories(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("0 0 0 0 0 0 0 1\n")
    (tmp_path / "a.csv").write_text("time,x,y,z\n0,1,2,3\n")
    both = {"cf1": "cf1", "cf2": "cf2"}
    with pytest.raises(InputError, match=r"name a folder with AGENT.tum for each"):
        read_truth(tmp_path / "a.tum", both, "")
    with pytest.raises(InputError, match="expected a column body"):
        read_truth(tmp_path / "a.csv", both, "")


HOP = """\
star: 1
name: hop
world: room.yaml
swarm: {cf1: {start: [-0.5, 0, 0]}, cf2: {start: [0.5, 0, 0]}}
transport: {use: sim, positioning: {std: 0.002}}
localizer: mocap
planner: straight
avoider: none
mission:
  - takeoff: {height: 0.4}
  - goto: {agents: cf1, by: [0.0, 0.4, 0]}
  - land: {}
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evaluated")
    (folder / "room.yaml").write_text(
        "star: 1\nname: room\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
    )
    (folder / "hop.yaml").write_text(HOP)
    assert command("run")([str(folder / "hop.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


def evaluated(capsys: Printed, *arguments: str) -> Mapping[str, float]:
    assert star_evaluate([*arguments, "--json"]) == 0
    figures: Mapping[str, float] = json.loads(capsys.readouterr().out)["all"]
    return figures


def test_the_record_and_its_export_have_the_error_of_the_summary(
    recorded: Path, capsys: Printed
) -> None:
    summary = json.loads((recorded / "summary.json").read_text())
    assert command("export")([str(recorded), "--format", "tum"]) == 0
    capsys.readouterr()
    for arguments in ([], ["--truth", str(recorded / "tum")]):
        figures = evaluated(capsys, str(recorded), *arguments)
        assert figures["mse_m2"] == pytest.approx(summary["position_mse_m2"]["mean"], rel=1e-6)
        assert figures["worst_m"] == pytest.approx(summary["position_worst_m"], rel=1e-6)
        assert figures["nees"] == pytest.approx(summary["position_nees"], rel=0.05)


def test_offset_and_alignment_are_stated(recorded: Path, capsys: Printed) -> None:
    assert star_evaluate([str(recorded), "--offset", "auto", "--align", "yaw"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"time offset  -?0\.00\d\d s, found by the speeds", out)
    assert re.search(r"alignment    yaw: turned by roll .*, then moved by \[.*\] m", out)
    assert re.search(r"^all +\d\.\d+e-05 ± ", out, re.MULTILINE)


def test_an_agent_that_is_not_there_is_refused(recorded: Path) -> None:
    with pytest.raises(InputError, match="--body cf3=x: no agent named 'cf3'"):
        star_evaluate([str(recorded), "--truth", "x.csv", "--body", "cf3=x"])


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        (["cf1=cf2"], r"body 'cf2' is of 'cf1' and of 'cf2'.* \[duplicate-name\]"),
        (["cf1=drone"], r"truth.csv: no trajectory of drone \[no-record\]"),
    ],
)
def test_a_body_that_is_not_there_or_taken_is_refused(
    recorded: Path, tmp_path: Path, bodies: list[str], message: str
) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("time,body,x,y,z\n0,cf2,0,0,0\n100,cf2,0,0,0\n")
    options = [word for body in bodies for word in ("--body", body)]
    with pytest.raises(InputError, match=message):
        star_evaluate([str(recorded), "--truth", str(truth), *options])


def test_an_agent_without_ground_truth_is_listed(recorded: Path) -> None:
    run = read_run(recorded, flown=True)
    tracks = recorded_truth(run)
    first, *others = run.agents
    del tracks[first]
    agents = evaluate(run, tracks).agents
    assert list(agents) == list(run.agents)
    assert (agents[first].samples, agents[first].coverage) == (0, 0.0)
    assert all(agents[name].samples > 0 for name in others)
