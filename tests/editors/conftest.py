"""A language server for YAML, and missions to edit with the schema that ``star schema`` writes."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from star_core.commands.main import main
from tests.editors.language_server import LanguageServer

PACKAGE = "yaml-language-server"
VERSION = "1.25.0"
"""Of the server that the Red Hat extension of VS Code and most other editors run."""

SETTINGS = {"yaml": {"schemaStore": {"enable": False}}}


@pytest.fixture(scope="session")
def command(request: pytest.FixtureRequest) -> list[str]:
    """Return what starts the server, which is installed once, into pytest's cache."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("node and npm are not installed: they bring and run yaml-language-server")
    folder = request.config.cache.mkdir(f"{PACKAGE}-{VERSION}")
    program = folder / "node_modules" / PACKAGE / "bin" / PACKAGE
    if not program.exists():
        quiet = ["--no-audit", "--no-fund", "--loglevel=error"]
        subprocess.run(
            [npm, "install", *quiet, "--prefix", str(folder), f"{PACKAGE}@{VERSION}"], check=True
        )
    return [node, str(program), "--stdio"]


@pytest.fixture(scope="session")
def server(command: list[str]) -> Iterator[LanguageServer]:
    with LanguageServer(command, SETTINGS) as running:
        yield running


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what ``star schema`` writes: ``mission.schema.json`` and the others."""
    made = tmp_path_factory.mktemp("missions")
    for name in ("mission", "steps", "world", "camera", "study", "faults"):
        assert main(["schema", name, "--out", str(made / f"{name}.schema.json")]) == 0
    return made
