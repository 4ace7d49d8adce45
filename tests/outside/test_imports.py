"""What is heavy is imported where it is needed, with a third party's plugin installed too."""

from __future__ import annotations

import json
from collections.abc import Callable
from subprocess import CompletedProcess
from typing import TypeAlias

import pytest

pytestmark = pytest.mark.extended

Run: TypeAlias = Callable[..., CompletedProcess[str]]

# Runs `star`, and then prints the top-level name of every module that anything asked for, whether
# it is installed or not: an import that is tried and forgiven counts.
WATCH = """
import json, sys

class Watch:
    def find_spec(name, path=None, target=None):
        asked.add(name.partition(".")[0])

asked = set()
sys.meta_path.insert(0, Watch)
from star_core.commands.main import main
try:
    status = main()
except SystemExit as end:
    status = end.code
print(json.dumps([status, sorted(asked)]))
"""


def imported(run: Run, *arguments: str) -> set[str]:
    """Return what ``star`` with these arguments imports, given that it exits with 0."""
    done = run("python", "-c", WATCH, *arguments)
    status, names = json.loads(done.stdout.splitlines()[-1])
    assert status == 0, done.stderr
    return set(names)


@pytest.mark.usefixtures("mission")
@pytest.mark.parametrize("arguments", [["--help"], ["plugins"], ["schema"]])
def test_what_does_not_fly_imports_plugins_but_no_numpy(run: Run, arguments: list[str]) -> None:
    names = imported(run, *arguments)
    assert "star_gentle" in names
    assert "numpy" not in names
