"""What every test may use."""

import gc
import os
import sys
import tomllib
from collections.abc import Callable, Generator, Iterator
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pytest
from hypothesis import settings

import star_sim
from star_basics import land_requests, stop_flights
from star_core import Registry, discovery
from star_core.commands import Source
from star_core.toolkit import progress

ROOT = Path(__file__).parents[1]

# Without bytecode each process of tests compiles all modules and rewrites all assertions anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Recording to MCAP starts a process for each flight: only the tests of it do that.
os.environ["STAR_BLOCK_PLUGINS"] = "mcap"

# `star stop` lands every flight of this user: no test searches a folder of sockets but that of its
# own process. A socket's path has about 100 characters at most.
RUNTIME: Final = TemporaryDirectory(prefix="star-")
os.environ["XDG_RUNTIME_DIR"] = RUNTIME.name
vars(stop_flights).update(SESSIONS=Path(RUNTIME.name), SOCKETS=Path(os.devnull))
vars(land_requests)["gettempdir"] = lambda: RUNTIME.name

# Tests of one process are no work that lasts: the progress of each counts from its own beginning,
# and what a command prints does not depend on the speed of the machine.
progress.MAX_PAUSE = -1.0  # type: ignore[misc]
progress.LINE_PERIOD = 600.0  # type: ignore[misc]

# Reading what is installed takes as long as loading it: once for each search path.


@cache
def _installed_on(_path: tuple[str, ...], group: str) -> EntryPoints:
    return entry_points(group=group)


vars(discovery)["entry_points"] = lambda group: _installed_on(tuple(sys.path), group)

# Times are measured in benchmarks, not in tests. The default examples are the same in every run;
# `--hypothesis-profile=campaign` tries more, and others each time.
settings.register_profile("star", max_examples=25, deadline=None, derandomize=True)
settings.register_profile("campaign", max_examples=400, deadline=None)
settings.load_profile("star")

# Folders whose tests share expensive fixtures run in one process, as the tests of any file do; long
# tests that share nothing are distributed among all processes.
TOGETHER: Final = (
    "tests/outside/",
    "tests/plugins/commands/star_ablate/",
    "tests/plugins/commands/star_calibrate/",
)
APART: Final = ("tests/core/test_missions.py",)

collect_ignore = ["fuzz/guided_fuzzing.py"]  # needs atheris

ROOM = "star: 1\nname: room\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
HOP = """\
star: 1
name: hop
world: room.yaml
seed: 7
swarm:
  cf1: {start: [-0.5, 0, 0]}
  cf2: {start: [0.5, 0, 0]}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.3, speed: 0.5}
  - land: {speed: 0.5}
rate: 10
"""


@pytest.fixture(scope="module", autouse=True)
def ideal_world(request: pytest.FixtureRequest) -> Iterator[None]:
    """Give `sim` the ideal world as a default in modules with this mark; others fly as users do.

    Commands in processes of their own always have the defaults of users.
    """
    with pytest.MonkeyPatch.context() as patch:
        if request.node.get_closest_marker("ideal_world"):
            for name in ("profile", "controller"):
                ideal = {**star_sim.OPTIONS["properties"][name], "default": "ideal"}
                patch.setitem(star_sim.OPTIONS["properties"], name, ideal)
        yield


@pytest.fixture
def missions() -> Path:
    return ROOT / "missions"


@pytest.fixture
def hop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a mission and its world: hop.yaml and room.yaml."""
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(ROOM)
    Path("hop.yaml").write_text(HOP)
    return tmp_path


@pytest.fixture
def with_plugin(monkeypatch: pytest.MonkeyPatch) -> Callable[[object], None]:
    """Have ``star`` find one plugin more than is installed."""

    def add(plugin: object) -> None:
        registry = Registry()
        registry.add(plugin, Source("their-dist:theirs", "1.2"))
        monkeypatch.setattr("star_core.plugin_support.registry.Registry", lambda: registry)

    return add


def pytest_configure() -> None:
    """Refuse to test an editable installation that lacks plugins of ``pyproject.toml``."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {*project["entry-points"][discovery.ENTRY_POINT_GROUP]}
    if missing := declared - entry_points(group=discovery.ENTRY_POINT_GROUP).names:
        text = f"not installed: {', '.join(sorted(missing))}; run `pip install -e . --no-deps`"
        raise pytest.UsageError(text)


def pytest_collectstart() -> None:
    """Collect tests without garbage collections: what is collected stays."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Exclude some 400,000 objects of the collected tests from each full garbage collection."""
    gc.enable()
    gc.freeze()


@pytest.hookimpl(optionalhook=True, wrapper=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """Run two processes per processor: many tests wait for real time."""
    count = yield
    return 2 * count


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Distribute the files of tests among processes, in the order of their names.

    By default the file with the most tests comes first, and flights in real time, of which a file
    has few, would come last, one after the other. The marks of pytest-xdist 3.8 for distributions
    have no effect with pytest 9.2.
    """
    from xdist.scheduler import LoadScopeScheduling

    config.option.loadscopereorder = False
    scheduling: Any = LoadScopeScheduling(config, log)
    scheduling._split_scope = _work_unit
    return scheduling


def _work_unit(test: str) -> str:
    """Return the name that all tests of one process have in common."""
    if test.startswith(APART):
        return test
    return next(filter(test.startswith, TOGETHER), test.partition("::")[0])
