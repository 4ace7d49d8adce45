"""Every benchmark and campaign runs in a small size, so that no published figure breaks unseen.

``make extended`` does that. A script is imported, its sizes are set, and its ``main`` is called in
this process. What cannot be small, or needs real time, is marked `campaign`; what needs a peer that
is not installed is skipped.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import io
import json
import multiprocessing
import os
import shlex
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from star_core import Registry
from star_core.commands.main import main as star

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "benchmarks"
CAMPAIGNS = ROOT / "tests" / "campaign"
HELLO = ROOT / "missions" / "hello.yaml"
HELP = {"help": [str(Path(sys.executable).with_name("star")), "--help"]}
UP_AND_DOWN = ("mission=[{takeoff: {height: 0.8}}, {land: {}}]", "rate=10")
# 0.2 m ahead in 2 s, from rest to rest.
AHEAD = "2.0,0,0,0,0,0.4375,-0.525,0.21875,-0.03125" + ",0" * 24
COLUMNS = [f"{axis}^{power}" for axis in ("x", "y", "z", "yaw") for power in range(8)]


@dataclass(frozen=True)
class Small:
    """How a script is run in a small size.

    Attributes:
        arguments: Of its command line; ``{tmp}`` is a folder with a trajectory, ``path.csv``,
            ``{flights}`` one with a recorded flight.
        sizes: Values of its constants, or of those of another module.
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


class Threads:
    """In place of `multiprocessing`: threads, which need not import everything."""

    Event, Pipe, Process = threading.Event, staticmethod(multiprocessing.Pipe), threading.Thread

    def get_context(self, _method: str) -> Threads:
        """Return these threads."""
        return self


class RunHere:
    """In place of `subprocess`: runs commands of `star` in this process."""

    DEVNULL = None

    def run(self, command: Sequence[object], **_: object) -> None:
        """Run a command, which must not fail."""
        with contextlib.redirect_stdout(io.StringIO()):
            assert star([str(word) for word in command[1:]]) == 0


class FlownHere:
    """In place of the worker processes of a study."""

    size = 1

    def __init__(self, _size: int) -> None:
        """Start nothing."""

    def fly_all(self, jobs: Sequence[Any], *_: object, **__: object) -> Iterator[tuple[int, Any]]:
        """Yield the index and result of each job."""
        fly_job = importlib.import_module("star_ablate.flight").fly_job
        registry = Registry()
        for index, job in enumerate(jobs):
            yield index, fly_job(job, registry)

    def close(self) -> None:
        """Release nothing."""


def parent(address: str, path: Path, out: Path, summary: Path) -> tuple[float, float, float]:
    """Fly a study of `benchmarks/study.py` in this process instead of one of its own."""
    text = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(text):
        patch.setenv("STAR_SUMMARY", str(summary))
        patch.setattr(sys, "argv", ["study.py", "--parent", address, str(path), str(out)])
        importlib.import_module("study").main()
    wall_time, memory, spent = json.loads(text.getvalue())
    return wall_time, memory, spent


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
    "camera": Small(sizes={"ROUNDS": 1, "TIMES": 1, "LOOKS": 8}),
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
    "demo": Small("--json --flights 1", {"MISSION": HELLO}),
    "detector": Small("--json --images 2 --scenes 1 --tags 4 --conditions small large_blurred"),
    "disturbances": Small("--json --images 1"),
    "downwash": Small(
        "--json --seeds 1",
        {
            "PAIRS": 1,
            "REST": 1.0,
            "AVOIDERS": ("orca",),
            "SCENARIOS": {"crossing": ((-0.5, 0.5, 0.4), (0.5, -0.5, 0.4))},
            "SEPARATIONS": {"sphere": 0.2},
        },
    ),
    "drag": Small("{flights}", prints="| circle |"),
    "drag_bound": Small("", {"SPEEDS": (1.0,), "LEARNT": 5.0}, prints="circle"),
    "durations": Small("missions/hello.yaml", prints="hello"),
    "tests.campaign.faults": Small(
        "--rows 0 --seeds 1 --processes 1 --results {tmp}/faults.json",
        {"ProcessPoolExecutor": InProcess},
        prints="|",
    ),
    "figures": Small("", prints="floors of imports"),
    "flight_bits": Small("--missions hello", prints="hello"),
    "fleet": Small(sizes={"FLIGHT": 0.2, "FLEETS": ((2, 10),), "multiprocessing": Threads()}),
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
            "CHANGES": {
                "paper_box.yaml": UP_AND_DOWN,
                "three_eyes.yaml": (
                    *UP_AND_DOWN,
                    "localizer.processes=0",
                    "transport.camera.mode=geometric",
                ),
            },
        }
    ),
    "mosaic": Small("--json --scenes 1 --tags 6", {"SIZE": (320, 214)}),
    "tests.campaign.killed_studies": Small(
        "--runs 6 --kills 2", campaign="three starts", prints="each run was flown once"
    ),
    "tests.campaign.link_cuts": Small(
        "--flights 1 --processes 1 --phases landing --lengths 0.3",
        {"AFTER": 2.0, "N": 2, "ProcessPoolExecutor": InProcess},
        prints="landing",
    ),
    "tests.campaign.imported": Small(
        "--seeds 1 --no-flights", {"MODES": {"intended": ()}}, prints="imported"
    ),
    "tests.campaign.mocap": Small(
        "--flights 1 --passing 1 --only passing", campaign="a process", prints="1 of 1"
    ),
    "tests.campaign.mutants": Small("--only none-of-them", prints="0"),
    "tests.campaign.onboard": Small("--flights 1", campaign="20 s", prints="lighthouse"),
    "orca": Small("--json --agents 10", {"DRAWN": 20, "ROUNDS": 1}, needs=("pyrvo",)),
    "planner": Small(sizes={"POLYGONS": 4, "ROUNDS": 1, "BUILDS": 1, "QUERIES": 5}),
    "radio": Small(
        sizes={
            "MANY": 2,
            "FEW": 1,
            "ROUNDS": 1,
            "TICKS": 10,
            "HANGS": 5.0,
            "GUARDIAN": False,
            "multiprocessing": Threads(),
        },
        needs=("cflib",),
    ),
    "real_flights": Small("{flights} --json"),
    "recording": Small(
        "--json --rounds 1", {"AGENTS": 2, "RADIUS": 0.5, "TRANSPORT": "sim", "TURNS": 1}
    ),
    "tests.campaign.relief": Small("--json --seeds 1 --rounds 1", campaign="6 s"),
    "tests.campaign.preflight": Small(
        "--runs 1 --clean 1", campaign="real time", prints="false alarms in 0"
    ),
    "report": Small(
        "--json --rounds 1 --study",
        {
            "STUDY_RUNS": 100,
            "subprocess": RunHere(),
            "opened": lambda _page, _rounds: {},  # not by Chromium
        },
    ),
    "tests.campaign.safe_defaults": Small(
        "--seeds 1 --workers 1 --missions single-crossing-5 --out {tmp}/out",
        {"star_ablate.command.Processes": FlownHere},
        prints="crossing",
    ),
    "tests.campaign.search": Small("--json --worlds 1 --pattern sweep", campaign="10 s"),
    "silence": Small("--json --only check", {"GOALS": {"terminal": 2.0}}),
    "sim": Small(sizes={"AGENTS": (1,), "ROUNDS": 1, "REPEATS": 1, "TIMES": 10, "LAPS": 1}),
    "soak": Small(
        "--json --minutes 0.02 --drones 2",
        {
            "TRANSPORT": "{use: radio, guardian: false}",
            "MAX_JITTER": 1e3,  # other tests run beside it
            "MAX_SLIP": 10.0,
            "CLOSING": 1000,  # nothing has grown yet
            "multiprocessing": Threads(),
        },
    ),
    "startup": Small(
        "--json --rounds 1",
        {"first_flight": lambda _: {}, "COMMANDS": HELP},  # no cold start
    ),
    "study": Small(
        "--json --only plan memory cluster",
        {
            "MISSION": "hello",
            "PLANS": ((4, 2),),
            "RUNS": 20,
            "WORKERS": 2,
            "NAP": 0.01,
            "PROCESSES": 1,
            "start_parent": parent,
        },
        needs=("distributed",),
    ),
    "tick_cost": Small("--json --agents 3 --flights 1", {"ROUNDS": 1, "DEMO": HELLO}),
    "tick_files": Small("--json missions/hello.yaml"),
    "tests.campaign.touchdowns": Small(
        "--flights 1 --first 34 --ways radio --cases normal", prints="normal"
    ),
    "tracking": Small(
        "{tmp}/path.csv --seeds 1",
        {"FLIGHTS": {"pid, no noise": ("transport.noise=false",)}},
        prints="pid, no noise",
    ),
    "tests.campaign.tracking_fleet": Small(
        "{tmp}/path.csv --seeds 1", {"CONTROLLERS": {"pid": ()}}, prints="pid"
    ),
    "view": Small(
        "--json --rounds 1",
        {"AGENTS": 2, "RADIUS": 0.5, "SPEED": 4.0, "multiprocessing": Threads()},
    ),
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
    run = SCRIPTS.keys()
    assert scripts | campaigns | {"tests.fuzz.guided_fuzzing"} == run | PARTS | {"tick"}


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


@pytest.mark.extended
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
    script = importlib.import_module(name)
    for constant, value in small.sizes.items():
        monkeypatch.setattr(constant if "." in constant else f"{name}.{constant}", value)
    (tmp_path / "path.csv").write_text(f"duration,{','.join(COLUMNS)}\n{AHEAD}\n")
    flights = record_flight(tmp_path / "flights") if "{flights}" in small.arguments else ""
    words = [word.format(tmp=tmp_path, flights=flights) for word in shlex.split(small.arguments)]
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
    before = environment()
    gc.freeze()  # of all that is, or each collection takes long
    assert not exit_status(script.main)
    assert environment() == before  # the tests after it are in the same process
    gc.collect()
    assert small.prints in capsys.readouterr().out


def environment() -> dict[str, str]:
    """Return the environment variables that STAR, Python and users' folders depend on."""
    names = [name for name in os.environ if name.startswith(("STAR_", "PYTHON", "XDG_"))]
    return {name: os.environ[name] for name in names}


@pytest.mark.extended
def test_160_drones_that_know_their_positions_to_3_cm_do_not_jam(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setattr(sys, "argv", ["tick.py", "--json", "--agents", "160"])
    importlib.import_module("tick").main()  # which exits if drones collide
    figures = json.loads(capsys.readouterr().out)
    assert figures["flight (s)"] <= 66
    assert figures["least separation (m)"] > 0.25
