"""What is in ``examples/`` runs.

``external_goals.py`` flies in ``tests/plugins/tasks/star_external/test_flight.py``.
"""

from __future__ import annotations

import glob
import os
import re
import runpy
import shlex
import shutil
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from star_core.commands.main import main

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


def test_missions_fly_from_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / "fly_from_python.py"))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "cf1 cf2 cf3 fly in lab-4x4"
    assert [line.split()[0] for line in lines[1:]] == ["radius", "0.2", "0.3", "0.2", "0.3"]
    assert sorted(folder.name for folder in Path("runs").iterdir()) == ["radius-0.2", "radius-0.3"]


@pytest.fixture(scope="module")
def notebooks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Any]]]:
    """The folder in which the notebooks ran, and the outputs of the cells of each.

    They run in one kernel, which takes longer to start than either: no name is left to the next.
    """
    folder = tmp_path_factory.mktemp("notebooks")
    every = nbformat.v4.new_notebook()  # type: ignore[no-untyped-call]
    names: dict[str, list[Any]] = {}
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        cells = nbformat.reads(path.read_text(), as_version=4).cells  # type: ignore[no-untyped-call]
        names[path.stem] = cells
        every.cells += [*cells, nbformat.v4.new_code_cell("%reset -f")]  # type: ignore[no-untyped-call]
    client = NotebookClient(every, timeout=300, resources={"metadata": {"path": str(folder)}})
    client.execute(env=os.environ | {"MPLCONFIGDIR": str(folder)})
    return folder, {
        name: [output for cell in cells for output in cell.get("outputs", ())]
        for name, cells in names.items()
    }


def test_the_notebook_runs_and_draws(notebooks: tuple[Path, dict[str, list[Any]]]) -> None:
    folder, outputs_of = notebooks
    outputs = outputs_of["fly_and_plot"]
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    printed = "".join(o.get("text", "") for o in outputs if o.get("name") == "stdout")
    assert len(pictures) == 3
    assert printed.startswith("cf1 cf2 cf3 fly in lab-4x4\ncompleted after ")
    assert (folder / "runs" / "notebook" / "first" / "summary.json").is_file()


def test_the_notebook_that_steps_a_flight_runs(
    notebooks: tuple[Path, dict[str, list[Any]]],
) -> None:
    folder, outputs_of = notebooks
    outputs = outputs_of["fly_step_by_step"]
    printed = "".join(o.get("text", "") for o in outputs if o.get("name") == "stdout")
    assert printed.startswith("success after ")
    assert "completed: closest approach" in printed
    assert len([o for o in outputs if "image/png" in o.get("data", {})]) == 1
    assert (folder / "runs" / "notebook" / "steps" / "summary.json").is_file()


def test_the_code_of_the_page_on_python_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "python.md").read_text()
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "python.md", "exec"), names)  # noqa: S102 -- our own page
    outcome, phases, ended, shapes, height = capsys.readouterr().out.splitlines()
    assert outcome.startswith("completed 0.")
    assert (phases, ended) == ("[2 2 2] (3, 3)", "completed")
    assert shapes.startswith("('cf1', 'cf2', 'cf3') (")
    assert re.fullmatch(r"[01]\.\d\d m", height)


def test_the_readme_of_the_examples_names_all_of_them() -> None:
    named = re.findall(r"\]\(([^./)]+(?:\.py|\.ipynb)?)\)", (EXAMPLES / "README.md").read_text())
    assert sorted(named) == sorted(
        {path.name for path in EXAMPLES.iterdir()} - {"README.md", "__pycache__"}
    )


def typed(*pages: str) -> list[str]:
    """The commands of pages about the files in ``examples/``, in order."""
    blocks = [
        block
        for page in pages
        for block in re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
        if "examples/" in block
    ]
    lines = [line.partition("#")[0].strip() for block in blocks for line in block.splitlines()]
    about = re.compile(r"star \w+ .*\b(examples|imported|swarm)/")
    return [line for line in lines if about.match(line)]


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the examples, which is the current one."""
    shutil.copytree(EXAMPLES, tmp_path / "examples")
    (tmp_path / "missions" / "cameras").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def star_typed(line: str) -> int:
    words = shlex.split(line)[1:]
    return main([name for word in words for name in (sorted(glob.glob(word)) or [word])])  # noqa: PTH207 -- as a shell does


def test_the_importing_and_calibrating_commands_work_as_typed(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for page in ("README.md", "docs/from-crazyswarm2.md", "docs/from-original-star.md"):
        for line in typed(page):
            if not line.startswith("star run"):
                assert star_typed(line) == 0, capsys.readouterr().err
        shutil.rmtree(clone / "imported", ignore_errors=True)
    assert (clone / "missions" / "cameras" / "mine.yaml").exists()


@pytest.mark.campaign
@pytest.mark.usefixtures("clone")
def test_the_flights_of_the_importing_pages_work_as_typed() -> None:
    for page in ("docs/from-crazyswarm2.md", "docs/from-original-star.md"):
        for line in typed(page):
            assert star_typed(line) == 0
