"""What plugins import: the public API, not each other; cflib, which is GPL, in `star_radio` only.

The layers within `star_core` are a contract of import-linter in pyproject.toml.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import grimp
import pytest

PLUGINS = {path.parent.name for path in Path(__file__).parents[2].glob("plugins/*/*/__init__.py")}
PUBLIC = {f"star_core{name}" for name in ("", ".toolkit", ".commands", ".formats", ".testing")}
# The fleet puts these modules of the simulator behind the firmware's protocol.
FLEET_IMPORTS = {
    "star_sim", "star_sim.airframe", "star_sim.attitude", "star_sim.cascade", "star_sim.commander",
    "star_sim.drone", "star_sim.fusion", "star_sim.pieces", "star_sim.kernel", "star_sim.transport",
}  # fmt: skip
GPL = {"cflib"}
OF_PLUGINS = {
    "star_external.planner", "star_mocap.source", "star_search.pattern", "star_search.search_space",
}  # fmt: skip
"""What plugins offer to others for the kinds that they add."""


def allowed(importer: str, imported: str) -> bool:
    """Return whether a module may import another, by the names of both."""
    package, other = importer.partition(".")[0], imported.partition(".")[0]
    if package == other:
        return True
    if other == "star_core":
        return imported in PUBLIC
    if other in PLUGINS:
        return package == "star_fleet" and imported in FLEET_IMPORTS
    return other not in GPL or package == "star_radio"


def forbidden(graph: grimp.ImportGraph) -> Iterator[str]:
    """Yield the imports that are not allowed, as ``importer -> imported``."""
    for importer in sorted(graph.modules):
        for imported in sorted(graph.find_modules_directly_imported_by(importer)):
            if not allowed(importer, imported):
                yield f"{importer} -> {imported}"


@cache
def product() -> grimp.ImportGraph:
    return grimp.build_graph(
        "star_core", *sorted(PLUGINS), include_external_packages=True, cache_dir=None
    )


def test_plugins_import_the_public_api_only() -> None:
    assert not [*forbidden(product())]


@pytest.mark.parametrize(
    ("importer", "imported", "expected"),
    [
        ("star_none", "star_core.toolkit", True),
        ("star_none", "star_core.toolkit.jit", False),
        ("star_none", "star_orca", False),
        ("star_fleet.server", "star_sim.kernel", True),
        ("star_fleet.server", "star_sim.camera_sim", False),
        ("star_core.runner", "star_sim", False),
        ("star_radio.orders", "cflib", True),
        ("star_none", "cflib", False),
        ("star_none", "numpy", True),
    ],
)
def test_private_modules_and_other_plugins_are_not_imported(
    importer: str,
    imported: str,
    expected: bool,  # noqa: FBT001 -- what is expected
) -> None:
    assert allowed(importer, imported) is expected


def test_templates_of_plugins_import_public_names_only() -> None:
    folder = Path(__file__).parents[2] / "plugins/commands/star_new/templates"
    texts = [path.read_text() for path in folder.glob("*.tmpl")]
    modules = {name for text in texts for name in re.findall(r"(?:from|import) (star_\S+)", text)}
    assert "star_external.planner" in modules
    assert modules <= PUBLIC | OF_PLUGINS


def test_public_modules_of_plugins_are_in_the_documentation() -> None:
    docs = Path(__file__).parents[2] / "docs"
    for page in ("site/generated.py", "write-a-plugin.md"):
        assert {name for name in OF_PLUGINS if name in (docs / page).read_text()} == OF_PLUGINS


@pytest.fixture
def planted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], grimp.ImportGraph]:
    """Return a function that makes a package of one statement, and its graph of imports."""

    def graph(statement: str) -> grimp.ImportGraph:
        (tmp_path / "star_planted").mkdir()
        (tmp_path / "star_planted" / "__init__.py").write_text(f"{statement}\n")
        monkeypatch.syspath_prepend(tmp_path)
        return grimp.build_graph(
            "star_core", "star_planted", include_external_packages=True, cache_dir=None
        )

    return graph


@pytest.mark.parametrize(
    ("statement", "violations"),
    [
        ("from star_core import Scene", []),
        ("from star_core.toolkit import compiled", []),
        ("from star_core import tick", ["star_planted -> star_core.tick"]),
        ("from star_core.toolkit.jit import compiled", ["star_planted -> star_core.toolkit.jit"]),
    ],
)
def test_imports_of_names_and_of_modules_are_told_apart(
    planted: Callable[[str], grimp.ImportGraph], statement: str, violations: list[str]
) -> None:
    assert [*forbidden(planted(statement))] == violations
