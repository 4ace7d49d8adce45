"""Targets: files that a user writes, or brings along.

A file is good, or it is refused: in lines that name the file and, in YAML, line and column.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from functools import cache, partial
from io import StringIO
from pathlib import Path
from typing import Final
from unittest.mock import patch

from star_ablate.reading import read as read_study
from star_core.errors import InputError, code_of
from star_core.plugin_support.registry import Registry
from star_core.world.scene import Scene
from star_faults.fault_file import read_faults
from star_verbs.follow.files import read_trajectory, read_waypoints
from star_yaml import schema
from star_yaml.mission_loader import load
from tests.commands import command
from tests.fuzz.harness import Draw, Target, Try
from tests.fuzz.mutants import damaged, spoiled

import_files = command("import")

MISSIONS: Final = Path(__file__).parents[2] / "missions"
LOCATED: Final = re.compile(r"[^:\s]+\.(yaml|csv)(:\d+:\d+)?: \S.*", re.DOTALL)
IN_CSV: Final = re.compile(r"path\.csv(:\d+)?: \S.*", re.DOTALL)
IMPORTED: Final = re.compile(
    r"(\S+\.(yaml|csv)(:\d+){0,2}: (warning: )?\S.*|fence: .*|mission: .*|m: .*)", re.DOTALL
)

compose = schema.compose
registry = cache(Registry)  # what is installed does not change from one file to the next
composed = cache(lambda: compose(registry().offers()))


def outcome(read: Callable[[], object], located: re.Pattern[str] = LOCATED) -> str:
    """Read a file; every problem of one that is refused has its place and the error a code."""
    try:
        read()
    except InputError as error:
        problems = error.problems
    else:
        return "good"
    assert problems, "refused without a reason"
    for problem in problems:
        assert located.fullmatch(problem), problem
        assert " raised " not in problem, problem
        assert code_of(problem), f"no code: {problem}"
    return "refused"


@contextmanager
def _plugins_found_once() -> Iterator[None]:
    with (
        patch.object(schema, "compose", lambda _offers: composed()),
        patch("star_core.plugin_support.registry.Registry", registry),
    ):
        yield


def _spoiling(files: Iterable[Path], read: Callable[[Path], object]) -> Try:
    """Return what spoils one of some files, reads it and restores it."""
    originals = {file: file.read_bytes() for file in files}

    def attempt(draw: Draw) -> str:
        file = draw.choice(list(originals))
        file.write_bytes(spoiled(originals[file], draw))
        try:
            return outcome(lambda: read(file))
        finally:
            file.write_bytes(originals[file])

    return attempt


@contextmanager
def missions(folder: Path) -> Iterator[Try]:
    """Shipped missions and the worlds that they name."""
    with _plugins_found_once():
        copy = shutil.copytree(MISSIONS, folder / "missions")
        names = sorted(path.name for path in copy.glob("*.yaml"))
        mission_of = {name: name for name in names}
        for name in names:
            mission_of[load(copy / name, registry()).source["world"]] = name
        of_file = {copy / name: copy / mission for name, mission in sorted(mission_of.items())}
        yield _spoiling(of_file, lambda file: load(of_file[file], registry()))


@contextmanager
def studies(folder: Path) -> Iterator[Try]:
    """Shipped studies."""
    with _plugins_found_once():
        copy = shutil.copytree(MISSIONS, folder / "missions")
        files = sorted((copy / "studies").glob("*.yaml"))
        yield _spoiling(files, lambda file: read_study(file, registry()))


@contextmanager
def faults(folder: Path) -> Iterator[Try]:
    """The shipped fault file."""
    original = (MISSIONS / "faults" / "trouble.yaml").read_bytes()
    scene: Scene = load(MISSIONS / "first_flight.yaml", registry()).scene
    path = folder / "trouble.yaml"

    def attempt(draw: Draw) -> str:
        path.write_bytes(spoiled(original, draw))
        return outcome(lambda: read_faults(path, scene, registry()))

    yield attempt


@contextmanager
def trajectories(folder: Path) -> Iterator[Try]:
    """CSV files of waypoints, of timed points and of polynomials."""
    piece = ",".join(["1.5", *(f"{0.01 * i:.4f}" for i in range(32))])
    header = "duration," + ",".join(f"{a}^{i}" for a in ("x", "y", "z", "yaw") for i in range(8))
    polynomials = f"{header}\n{piece}\n".encode()
    waypoints = [path.read_bytes() for path in sorted((MISSIONS / "paths").glob("*.csv"))]
    path = folder / "path.csv"
    timed = b"t,x,y,z,yaw_deg\n0,0,0,0.8,0\n1.5,0.4,0,0.8,90\n4,0,0,0.8,180\n"
    kinds: list[tuple[Callable[[Path, str], object], list[bytes]]] = [
        (read_waypoints, waypoints),
        (partial(read_trajectory, form="poly7"), [polynomials]),
        (partial(read_trajectory, form="timed"), [timed]),
    ]

    def attempt(draw: Draw) -> str:
        read, originals = draw.choice(kinds)
        original = draw.choice(originals)
        path.write_bytes(draw.choice((spoiled, damaged))(original, draw))
        return outcome(lambda: read(path, "path.csv"), IN_CSV)

    yield attempt


ROBOTS: Final = """\
robots:
  cf1: {enabled: true, uri: radio://0/80/2M/E7E7E7E701, initial_position: [-1.0, 0.0, 0.0], type: a}
  cf2: {enabled: true, uri: radio://0/80/2M/E7E7E7E702, initial_position: [0.0, 0.0, 0.0], type: a}
  cf4: {enabled: true, uri: radio://0/80/2M/E7E7E7E704, initial_position: [1.0, 0.0, 0.0], type: a}
robot_types:
  a: {battery: {voltage_critical: 3.7}, motion_capture: {enabled: false}}
all:
  firmware_params: {stabilizer: {controller: 2, estimator: 2}}
"""
COMMANDS: Final = """\
command_sequence: [
  "takeoff", "wait", "all", "", "",
  "hold", "wait", "all", "2.0", "",
  "goto_velocity", "conc", "cf2", "", "1 -1 1 0.707",
  "goto_velocity", "wait", "cf4", "land", "1 1 1 0.707",
  "external", "wait", "cf1 cf2", "", "",
  "", "", "", "", "",
  "land", "wait", "all", "", ""
]
"""
ENVIRONMENT: Final = """\
environment:
  obstacles:
    obs0:
      use_key_point: true
      height: [0.0, 1.5]
      thickness: 0.8
      points: [ 2.525, 2.00,  -0.90, -0.0,  0.0, -1.0,  0.90, 0.0 ]
april_tags:
  pair_position: [-0.1545, -0.1145, -0.1545, -0.2365]
  pair_paper_size: [0.297, 0.420]
  tags:
    id000 id001: {alignment: "bottom-left", location: [-0.895, 1.2275], purpose: relocalization}
    id100:       {location: [0.5, 0.5], purpose: eliminate}
"""
LEGACY: Final[Mapping[str, str]] = {
    "m.yaml": COMMANDS, "crazyflies.yaml": ROBOTS, "lab.yaml": ENVIRONMENT,
}  # fmt: skip


@contextmanager
def legacy(folder: Path) -> Iterator[Try]:
    """Files of the original STAR and of Crazyswarm2; no command is dropped silently."""
    out = folder / "imported"
    paths = {name: folder / name for name in LEGACY}
    arguments = [*map(str, paths.values()), "--out", str(out), "--force", "--tag-size", "0.1"]

    def attempt(draw: Draw) -> str:
        changed = draw.choice(sorted(LEGACY))
        for name, text in LEGACY.items():
            content = text.encode()
            paths[name].write_bytes(spoiled(content, draw) if name == changed else content)
        (out / "m.yaml").unlink(missing_ok=True)
        said = StringIO()
        with redirect_stdout(said):
            verdict = outcome(lambda: import_files(arguments), IMPORTED)
        if verdict == "good" and not (out / "m.yaml").exists():
            return "not recognized as a mission"
        if verdict == "good":
            _assert_no_command_is_dropped(paths["m.yaml"], out / "m.yaml")
        return verdict

    with _plugins_found_once():
        yield attempt


def _assert_no_command_is_dropped(source: Path, made: Path) -> None:
    """Every command names its line in the mission that came out."""
    from star_yaml.yaml_reader import read_yaml

    fields = read_yaml(source, text_keys=True).need("command_sequence").list()
    lines = {field.mark.line for field in fields[::5]}
    written = {int(number) for number in re.findall(r"# line (\d+)", made.read_text())}
    assert lines == written, (lines, written)


TARGETS: Final = (
    Target("missions and worlds", 30, 10_000, missions),
    Target("studies", 5, 1_000, studies),
    Target("fault files", 20, 5_000, faults),
    Target("trajectories", 100, 5_000, trajectories),
    Target("legacy files", 8, 1_000, legacy),
)
