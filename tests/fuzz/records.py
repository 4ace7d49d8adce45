"""Targets: recordings. They are read, completed, or refused with the name of the file."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, Final

from mcap.reader import make_reader

from star_core import Event, Flight, InputError, Tick, fly, hookimpl, load, read_run
from star_core.discovery import Source
from star_core.errors import code_of
from star_core.plugin_support.registry import Registry
from star_mcap.messages import FILE
from star_mcap.recorder import Recorder
from star_mcap.recovery import run as recover
from tests.fuzz.harness import Draw, Target, Try
from tests.fuzz.mutants import damaged, spoiled

MISSION: Final = """\
star: 1
name: short
world: room.yaml
swarm:
  cf1: {start: [-0.5, 0, 0]}
  cf2: {start: [0.5, 0.2, 0]}
transport: {use: sim, profile: ideal, controller: ideal}
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.4, speed: 0.5}
  - land: {speed: 0.5}
"""
ROOM: Final = "star: 1\nname: room\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"


class Recording:
    """Records a flight to MCAP in this process."""

    @hookimpl
    def star_mission_started(self, flight: Flight) -> None:
        assert flight.folder is not None
        flight.folder.mkdir(exist_ok=True)
        self._recorder = Recorder(flight, flight.folder, 0)

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self._recorder.add(tick)

    @hookimpl
    def star_event(self, event: Event) -> None:
        self._recorder.add_event(event)

    @hookimpl
    def star_mission_ended(self, summary: dict[str, Any]) -> None:
        brief = {key: summary[key] for key in ("mission", "outcome", "reason", "seed")}
        self._recorder.close(brief)


def flown(folder: Path) -> Path:
    """Fly a short mission, and return the folder of its record."""
    (folder / "room.yaml").write_text(ROOM)
    (folder / "short.yaml").write_text(MISSION)
    registry = Registry()
    registry.add(Recording(), Source("fuzz:recording"))
    with redirect_stderr(StringIO()):
        fly(load(folder / "short.yaml", registry), registry, folder=folder / "run")
    return folder / "run"


@contextmanager
def recordings(folder: Path) -> Iterator[Try]:
    """``flight.mcap``, which ``star recover`` completes; what comes out can be read."""
    original = (flown(folder) / FILE).read_bytes()
    path = folder / "spoilt" / FILE
    path.parent.mkdir()

    def attempt(draw: Draw) -> str:
        content = original[: draw.randrange(len(original))] if draw.random() < 0.5 else original
        path.write_bytes(damaged(content, draw))
        try:
            with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
                recover(Namespace(run=str(path.parent)), Registry(installed=False))
        except InputError as error:
            _assert_names(error, path)
            return "refused"
        finally:
            assert [file.name for file in path.parent.iterdir()] == [FILE]
        with path.open("rb") as stream:
            count = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
        return "recovered" if count else "empty"

    yield attempt


@contextmanager
def runs(folder: Path) -> Iterator[Try]:
    """The other files of a run, which `read_run` reads."""
    run = flown(folder)
    names = ("manifest.json", "summary.json", "timing.json", "trajectory.npz", "timing.npz")
    originals = {name: (run / name).read_bytes() for name in names}

    def attempt(draw: Draw) -> str:
        name = draw.choice(names)
        spoil = spoiled if name.endswith("json") and draw.random() < 0.5 else damaged
        (run / name).write_bytes(spoil(originals[name], draw))
        try:
            read_run(run)
        except InputError as error:
            _assert_names(error, run)
            return "refused"
        finally:
            (run / name).write_bytes(originals[name])
        return "read"

    yield attempt


def _assert_names(error: InputError, path: Path) -> None:
    """See that each problem begins with the path and ends with a code."""
    for problem in error.problems:
        assert problem.startswith(str(path)), problem
        assert code_of(problem), problem


TARGETS: Final = (
    Target("MCAP recordings", 20, 5_000, recordings),
    Target("runs", 50, 10_000, runs),
)
