"""The list of mutants that `make mutants` plants."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
MUTANTS = tomllib.loads((ROOT / "tests/mutants.toml").read_text())["mutant"]


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant["name"])
def test_a_mutant_can_be_planted(mutant: dict[str, Any]) -> None:
    assert (ROOT / mutant["file"]).read_text().count(mutant["old"]) == 1
    assert mutant["new"] != mutant["old"]
    for test in mutant["tests"]:
        file, _, name = test.partition("::")
        assert (ROOT / file).exists()
        if name:
            assert name.partition("[")[0].split("::")[-1] in (ROOT / file).read_text()
