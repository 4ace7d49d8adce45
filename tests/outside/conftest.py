"""A fresh environment with this project's wheel and the plugins that `docs/plugins` shows."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import chdir
from importlib.metadata import Distribution, PathDistribution, distribution
from pathlib import Path
from typing import TypeAlias
from venv import EnvBuilder

import pytest
from hatchling.build import build_wheel
from packaging.requirements import Requirement

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGES = ROOT / "docs" / "plugins"
BLOCK = re.compile(r"^`([\w./-]+)`:\n\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OWN = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")  # not passed on to the fresh environment
INTERPRETED = {"NUMBA_DISABLE_JIT": "1"}  # these flights are short; compiling takes longer
PIP = (sys.executable, "-m", "pip", "--quiet")

Run: TypeAlias = Callable[..., subprocess.CompletedProcess[str]]

collect_ignore_glob = ["star-*"]  # theirs: not importable from here


def pip(*arguments: object) -> None:
    """Run this environment's pip; its output is in the error if it fails."""
    done = subprocess.run([*PIP, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"pip {arguments[0]} failed: {done.stderr}")


@pytest.fixture(scope="session")
def documented(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The packages on the pages about plugins, as they are printed there, by distribution."""
    home = tmp_path_factory.mktemp("documented")
    for page in PAGES.glob("*.md"):
        text = page.read_text()
        name = "".join(re.findall(r"^<!-- star new plugin (\S+) ", text, re.MULTILINE))
        for path, content in BLOCK.findall(text):
            file = home / path if path.startswith("star-") else home / f"star-{name}" / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(content)
    return {folder.name: folder for folder in home.iterdir()}


@pytest.fixture(scope="session")
def wheels(
    documented: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """The wheels of this project and of the third parties, by distribution."""
    folder = tmp_path_factory.mktemp("wheels")
    for project in (ROOT, *HERE.glob("star-*"), *documented.values()):
        with chdir(project):  # as pip does, which would start three processes for each
            build_wheel(str(folder))
    return {path.name.split("-")[0].replace("_", "-"): path for path in folder.glob("*.whl")}


@pytest.fixture(scope="session")
def bin_folder(
    wheels: dict[str, Path], documented: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The commands of the fresh environment, with this project and the documented plugins."""
    home = tmp_path_factory.mktemp("environment")
    EnvBuilder(symlinks=True).create(home)
    ours = (wheels[name] for name in ("star-swarm", *documented))
    pip("--python", home, "install", "--no-deps", "--no-compile", *ours)
    (packages,) = home.glob("lib/*/site-packages")
    (gentle,) = packages.glob("star_gentle-*.dist-info")
    link_requirements(PathDistribution(gentle), ["test"], packages)
    return home / "bin"


def link_requirements(of: Distribution, extras: Iterable[str], packages: Path) -> None:
    """Link what a distribution requires, directly or not, from this environment into `packages`.

    As installing does, but without a download; what is not required is not there.
    """
    for requirement in map(Requirement, of.requires or ()):
        marker = requirement.marker
        if marker and not any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            continue
        if requirement.name == "star-swarm":
            (ours,) = packages.glob("star_swarm-*.dist-info")
            link_requirements(PathDistribution(ours), requirement.extras, packages)
            continue
        package = distribution(requirement.name)
        for top in {file.parts[0] for file in package.files or ()} - {"..", "__pycache__"}:
            if not (packages / top).exists():
                (packages / top).symlink_to(str(package.locate_file(top)))
        link_requirements(package, requirement.extras, packages)


@pytest.fixture(scope="module")
def beside(wheels: dict[str, Path], bin_folder: Path) -> Iterator[Callable[..., None]]:
    """Installs more distributions of third parties, until the module is over."""
    installed: list[str] = []

    def install(*names: str) -> None:
        pip(
            "--python", bin_folder.parent, "install", "--no-deps", *(wheels[name] for name in names)
        )
        installed.extend(names)

    yield install
    pip("--python", bin_folder.parent, "uninstall", "--yes", *installed)


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    """A copy of the small mission, alone in a folder with its world."""
    for name in ("nod.yaml", "room.yaml"):
        shutil.copy(HERE / name, tmp_path)
    return tmp_path / "nod.yaml"


@pytest.fixture
def run(bin_folder: Path, mission: Path) -> Run:
    """Runs a command of the fresh environment in the mission's folder."""
    environment = {key: value for key, value in os.environ.items() if key not in OWN} | INTERPRETED

    def command(name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [bin_folder / name, *arguments],
            capture_output=True,
            text=True,
            check=False,
            cwd=mission.parent,
            env=environment,
        )

    return command
