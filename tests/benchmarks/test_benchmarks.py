"""Every benchmark and campaign runs in a small size, so that no published figure breaks unseen.

A script is imported, its sizes are set, and its ``main`` is called in this process. What cannot be
small, or needs real time, is marked `campaign`; what needs a peer that is not installed is skipped.
"""

from __future__ import annotations

import gc
import importlib
import os
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "benchmarks"
CAMPAIGNS = ROOT / "tests" / "campaign"


@dataclass(frozen=True)
class Small:
    """How a script is run in a small size.

    Attributes:
        arguments: Of its command line; ``{tmp}`` is an empty folder, ``{flights}`` one with a
            recorded flight.
        sizes: Values of its constants.
        needs: Modules without which it is skipped.
        campaign: Why it is run by ``make campaign`` only; empty for the others.
        prints: Text that it prints.
    """

    arguments: str = "--json"
    sizes: Mapping[str, Any] = field(default_factory=dict)
    needs: Sequence[str] = ()
    campaign: str = ""
    prints: str = "{"


class InProcess(Executor):
    """In place of a pool of processes, of which each would import everything."""

    def __init__(self, _count: int, _context: object = None) -> None:
        """Start nothing."""

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return the result of a call that is made at once."""
        future: Future[Any] = Future()
        future.set_result(call(*args, **kwargs))
        return future


SCRIPTS = {
    "aideck": Small(
        sizes={
            "SECONDS": 0.5,
            "ROUNDS": 1,
            "IMAGES": 3,
            "AWAY": np.array([0.1]),
            "STREAMS": (("one", 1, 15.0, False),),
        }
    ),
    "camera": Small(sizes={"ROUNDS": 1, "TIMES": 1, "LOOKS": 30}),
    "tests.campaign.around": Small("--flights 1", campaign="8 s", prints="| 1 | 1 | 1 |"),
    "tests.campaign.cflib_examples": Small(
        "",
        {"FOLDER": "NO_CFLIB_EXAMPLES"},  # which are not part of the project
        prints="left out",
    ),
    "tests.campaign.crazyswarm2_examples": Small(
        "", {"FOLDER": "NO_CRAZYSWARM2_EXAMPLES"}, prints="left out"
    ),
    "tests.campaign.covariance": Small(
        "--json --seeds 1", {"PATHS": ("paper_box",)}, campaign="15 s"
    ),
    "tests.campaign.coverage": Small("", {"TRIALS": 20, "SIZES": (5,)}, prints="| normal |"),
    "demo": Small("--json --flights 1"),
    "detector": Small("--json --images 2 --scenes 1"),
    "disturbances": Small("--json --images 1"),
    "downwash": Small(
        "--json --seeds 1",
        {
            "PAIRS": 1,
            "SCENARIOS": {"crossing": ((-0.5, 0.5, 0.4), (0.5, -0.5, 0.4))},
            "SEPARATIONS": {"sphere": 0.2},
        },
    ),
    "drag": Small("{flights}", prints="| circle |"),
    "drag_bound": Small("", {"SPEEDS": (1.0,), "LEARNT": 5.0}, prints="circle"),
    "durations": Small("missions/first_flight.yaml", prints="first_flight"),
    "tests.campaign.faults": Small(
        "--cells 'no fault' --seeds 1 --processes 1 --results {tmp}/faults.json",
        {"ProcessPoolExecutor": InProcess},
        prints="|",
    ),
    "figures": Small("", prints="floors of imports"),
    "flight_bits": Small("--missions first_flight", prints="first_flight"),
    "fleet": Small(sizes={"FLIGHT": 0.2, "FLEETS": ((2, 10),)}),
    "tests.campaign.guardian": Small(
        "--runs 1 --only sigkill", campaign="real time", prints="sigkill"
    ),
    "tests.fuzz.guided_fuzzing": Small("yaml -runs=10", needs=("atheris",), prints=""),
    "heights": Small(
        "--seeds 1 --tops 0.3 --clearances 0.3 --widths 1.0", prints="0.3  1.0  0.3  1 of 1"
    ),
    "identify": Small("{flights}", prints="1 flights: circle"),
    "imu_errors": Small("{flights}", prints="median magnitude"),
    "landmarks": Small(
        sizes={
            "MINUTES": 0.05,
            "CHANGES": ("mission.1.follow.until.elapsed=0.2", "localizer.processes=0"),
        }
    ),
    "mosaic": Small("--json --scenes 1"),
    "tests.campaign.killed_studies": Small(
        "--runs 6 --kills 2", campaign="three starts", prints="each run was flown once"
    ),
    "tests.campaign.link_cuts": Small(
        "--flights 1 --processes 1 --phases landing --lengths 0.3", prints="landing"
    ),
    "tests.campaign.imported": Small("--seeds 1 --no-flights", prints="imported"),
    "tests.campaign.mocap": Small(
        "--flights 1 --passing 1 --only passing", campaign="a process", prints="1 of 1"
    ),
    "tests.campaign.mutants": Small("--only none-of-them", prints="0"),
    "tests.campaign.onboard": Small("--flights 1", campaign="20 s", prints="lighthouse"),
    "orca": Small("--json --agents 10", {"DRAWN": 20, "ROUNDS": 1}, needs=("pyrvo",)),
    "planner": Small(sizes={"POLYGONS": 4, "ROUNDS": 1, "BUILDS": 1, "QUERIES": 5}),
    "radio": Small(sizes={"MANY": 2, "FEW": 1, "ROUNDS": 1, "TICKS": 10}, needs=("cflib",)),
    "real_flights": Small("{flights} --json"),
    "recording": Small("--json --rounds 1", {"AGENTS": 2, "RADIUS": 0.5, "TRANSPORT": "sim"}),
    "tests.campaign.relief": Small("--json --seeds 1 --rounds 1", campaign="6 s"),
    "tests.campaign.preflight": Small(
        "--runs 1 --clean 1", campaign="real time", prints="false alarms in 0"
    ),
    "report": Small(
        "--json --rounds 1 --study",
        {"STUDY_RUNS": 200, "opened": lambda _page, _rounds: {}},  # not by Chromium
    ),
    "tests.campaign.safe_defaults": Small(
        "--seeds 1 --workers 1 --missions single-crossing-5 --out {tmp}/out", prints="crossing"
    ),
    "tests.campaign.search": Small("--json --worlds 1 --pattern sweep", campaign="10 s"),
    "silence": Small("--json --only check"),
    "sim": Small(sizes={"AGENTS": (1,), "ROUNDS": 1, "REPEATS": 1, "TIMES": 10, "LAPS": 1}),
    "soak": Small(
        "--json --minutes 0.1 --drones 2",
        {"MAX_JITTER": 1e3, "MAX_SLIP": 10.0, "CLOSING": 1000},  # busy, and nothing has grown yet
    ),
    "startup": Small("--json --rounds 1", {"first_flight": lambda _: {}}),  # no cold start
    "study": Small("--json --only plan memory", {"RUNS": 40, "PLANS": ((4, 2),)}),
    "study cluster": Small(
        "--json --only cluster",
        {"RUNS": 40, "WORKERS": 4, "NAP": 0.02, "PROCESSES": 1},
        needs=("distributed",),
    ),
    "tick": Small("--json --agents 40"),
    "tick_cost": Small("--json --agents 3 --flights 1", {"ROUNDS": 1}),
    "tick_files": Small("--json"),
    "tests.campaign.touchdowns": Small("--flights 1 --ways radio --cases normal", prints="normal"),
    "tracking": Small(
        "missions/paths/eight.csv --seeds 1",
        {"FLIGHTS": {"pid, no noise": ("transport.noise=false",)}},
        prints="pid, no noise",
    ),
    "tests.campaign.tracking_fleet": Small(
        "missions/paths/eight.csv --seeds 1", {"CONTROLLERS": {"pid": ()}}, prints="pid"
    ),
    "view": Small("--json --rounds 1", {"AGENTS": 2, "RADIUS": 0.5}),
}
PARTS = {
    "circle",
    "flight_models",
    "printed",
    "recorded_flights",
    "small_tags",
    "tests.campaign.example_scripts",
    "tests.campaign.fault_cells",
    "tests.campaign.fault_flight",
    "tests.campaign.mocap_fleet",
}


def test_every_script_is_run() -> None:
    scripts = {path.stem for path in BENCHMARKS.glob("*.py")}
    campaigns = {f"tests.campaign.{path.stem}" for path in CAMPAIGNS.glob("*.py")}
    run = {name.split()[0] for name in SCRIPTS}
    assert scripts | campaigns | {"tests.fuzz.guided_fuzzing"} == run | PARTS


def record_flight(folder: Path) -> Path:
    """Write a drawn flight in place of recorded ones, a circle at 0.5 m/s; return its folder."""
    random = np.random.default_rng(0)
    time = np.arange(0.0, 16.0, 0.01)
    turned = np.maximum(time - 2.0, 0.0)
    angle = np.where(turned < 1.0, turned**2 / 2, turned - 0.5)
    position = np.stack(
        [0.5 * np.cos(angle), 0.5 * np.sin(angle), 0.6 * np.clip(time - 1.0, 0.0, 1.0)], axis=1
    )
    velocity = np.gradient(position, 0.01, axis=0)
    turns = np.gradient(velocity, 0.01, axis=0)[:, [1, 0, 2]] * [-1.0, 1.0, 0.0] / 9.81
    flying = (time > 1.0)[:, None]
    arrays: dict[str, Any] = {
        "time": time,
        "position": position,
        "velocity": velocity,
        "attitude": Rotation.from_rotvec(turns).as_quat(),
        "gyro": np.gradient(turns, 0.01, axis=0),
        "accelerometer": np.tile([0.0, 0.0, 1.0], (len(time), 1)),
        "estimate_position": position,
        "estimate_velocity": velocity,
    }
    for name in [*arrays][1:]:
        arrays[name] = arrays[name] + 1e-3 * random.standard_normal(arrays[name].shape)
    arrays["pwm"] = flying * (36_000 + 300 * random.standard_normal((len(time), 4)))
    arrays["setpoint"] = flying * np.column_stack([position, np.zeros(len(time))])
    arrays["voltage"] = 4.0 - 0.01 * time[:, None]
    folder.mkdir()
    np.savez(folder / "circle.npz", **arrays)
    return folder


def exit_status(main: Callable[[], object]) -> object:
    """Return the exit status, or the message, with which a script ends."""
    try:
        return main()
    except SystemExit as end:
        return end.code


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # cflib's socket
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.campaign] if small.campaign else [])
        for name, small in SCRIPTS.items()
    ],
)
def test_a_script_runs_in_a_small_size(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    small = SCRIPTS[name]
    for need in small.needs:
        pytest.importorskip(need)
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.chdir(ROOT)
    script = importlib.import_module(name.split(maxsplit=1)[0])
    for constant, value in small.sizes.items():
        assert hasattr(script, constant)
        monkeypatch.setattr(script, constant, value)
    flights = record_flight(tmp_path / "flights") if "{flights}" in small.arguments else ""
    words = [word.format(tmp=tmp_path, flights=flights) for word in shlex.split(small.arguments)]
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
    before = options()
    assert not exit_status(script.main)
    assert options() == before  # the tests after it are in the same process
    gc.collect()
    assert small.prints in capsys.readouterr().out


def options() -> dict[str, str]:
    """Return the environment variables that STAR reads."""
    return {name: value for name, value in os.environ.items() if name.startswith("STAR_")}


def test_160_drones_that_know_their_positions_to_3_cm_do_not_jam(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    figures, summary = importlib.import_module("tick").measure(160)
    assert figures["flight (s)"] <= 66
    assert figures["least separation (m)"] > 0.25
    assert summary["collisions"]["agent_agent"] == 0
