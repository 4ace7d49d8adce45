"""What is in ``examples/`` runs.

``external_goals.py`` flies in ``tests/plugins/tasks/star_external/test_flight.py``.
"""

from __future__ import annotations

import glob
import json
import re
import runpy
import shlex
import shutil
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib import pyplot as plt

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


def figures_of(notebook: str) -> int:
    """Run the code of a notebook, in this process; return how many figures it draws."""
    mpl.use("agg")
    names: dict[str, object] = {}
    for cell in json.loads((EXAMPLES / notebook).read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), notebook, "exec"), names)  # noqa: S102 -- our own
    figures = [plt.figure(number) for number in plt.get_fignums()]
    for figure in figures:
        figure.canvas.draw()
    plt.close("all")
    return len(figures)


@pytest.mark.extended
def test_the_notebook_runs_and_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert figures_of("fly_and_plot.ipynb") == 3
    assert capsys.readouterr().out.startswith("cf1 cf2 cf3 fly in lab-4x4\ncompleted after ")
    assert Path("runs/notebook/first/summary.json").is_file()


@pytest.mark.extended
def test_the_notebook_that_steps_a_flight_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert figures_of("fly_step_by_step.ipynb") == 1
    printed = capsys.readouterr().out
    assert printed.startswith("success after ")
    assert "completed: closest approach" in printed
    assert Path("runs/notebook/steps/summary.json").is_file()


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


@pytest.mark.extended
def test_the_importing_and_calibrating_commands_work_as_typed(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = "README.md", "docs/from-crazyswarm2.md", "docs/from-original-star.md"
    for line in dict.fromkeys(typed(*pages)):
        if not line.startswith("star run"):
            assert star_typed(line) == 0, capsys.readouterr().err
    assert (clone / "missions" / "cameras" / "mine.yaml").exists()


@pytest.mark.campaign
@pytest.mark.usefixtures("clone")
def test_the_flights_of_the_importing_pages_work_as_typed() -> None:
    for page in ("docs/from-crazyswarm2.md", "docs/from-original-star.md"):
        for line in typed(page):
            assert star_typed(line) == 0
