"""The front door: everything a plugin needs, and nothing heavy until it is used."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import star_core
import star_core.commands
import star_core.toolkit
from star_core.commands.main import IDLE, main

HEAVY = ("numpy", "scipy", "numba", "transitions", "jsonschema", "rich", "ruamel")
DECKS = ("gtsam", "cv2", "cflib")  # vision and radio
SLOW = ("scipy.signal", "scipy.stats")  # half a second each


def imported_after(statement: str) -> set[str]:
    """Return which heavy packages a fresh interpreter has imported after a statement."""
    heavy = {*HEAVY, *DECKS, *SLOW}
    ask = f"import sys\n{statement}\nprint(*sorted({heavy!r} & {{*sys.modules}}))"
    answer = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    return set(answer.stdout.splitlines()[-1].split())


def test_every_name_resolves_and_a_class_is_called_that() -> None:
    packages = (star_core, star_core.toolkit, star_core.commands)
    exports = {name: getattr(package, name) for package in packages for name in package.__all__}
    assert [
        n for n, export in exports.items() if isinstance(export, type) and export.__name__ != n
    ] == []


def test_everything_can_be_imported_at_once() -> None:
    names: dict[str, object] = {}
    exec("from star_core import *", names)  # noqa: S102 -- what a newcomer may write
    assert set(star_core.__all__) <= set(names)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match=r"^module 'star_core' has no attribute 'Drone'$"):
        star_core.Drone  # type: ignore[attr-defined]  # noqa: B018 -- looking is what raises


@pytest.mark.parametrize(
    "statement",
    [
        "import star_core",
        "from star_core import PlannerSpec, hookimpl",
        "from star_core import Agent, Fence, Limits, Obstacle, Scene, World",
        "from star_core import Problem, StarError, Status",
    ],
)
def test_plugin_announcements_and_checks_import_nothing_heavy(statement: str) -> None:
    assert imported_after(statement) == set()


def test_a_table_brings_numpy() -> None:
    assert "numpy" in imported_after("from star_core import Setpoint")


@pytest.mark.usefixtures("hop")
def test_check_of_a_good_mission_imports_no_kernels() -> None:
    check = "from star_core.commands.main import main\nmain(['check', 'hop.yaml'])"
    assert imported_after(check) <= {"jsonschema", "numpy", "ruamel"}


@pytest.mark.parametrize("setting", [None, "20"])
def test_idle_threads_of_openblas_sleep_at_once_by_default(setting: str | None) -> None:
    name = "OPENBLAS_THREAD_TIMEOUT"
    environment = {key: value for key, value in os.environ.items() if key != name}
    run = f"import sys; sys.argv = ['star', '-V']; from {main.__module__} import main; main()"
    answer = subprocess.run(
        [sys.executable, "-c", f"{run}; import os; print(os.environ[{name!r}])"],
        capture_output=True,
        text=True,
        check=True,
        env=environment | ({} if setting is None else {name: setting}),
    )
    assert answer.stdout.split()[-1] == (setting or IDLE)


@pytest.mark.extended
@pytest.mark.usefixtures("hop")
def test_simulated_flights_import_no_vision_radio_or_dsp() -> None:
    flight = "from star_core.commands.main import main\nmain(['run', 'hop.yaml', '--no-record'])"
    names = imported_after(flight)
    assert "numpy" in names
    assert not names & {*DECKS, *SLOW}
