"""What the result of a run depends on besides its seed: mission, files and code, as digests."""

from __future__ import annotations

import hashlib
import json
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from star_core import Mission, Registry
from star_core.commands import Source
from star_core.toolkit import actions

DIGEST_LENGTH: Final = 16  # hexadecimal digits
UNNAMED: Final = ("command", "file_kind", "format", "run_option")  # kinds that no mission names
NO_CODE: Final = {"conftest", "docs", "examples", "noxfile", "setup", "test", "tests"}
INSTALLED: Final = {Path(sysconfig.get_path(name)) for name in ("purelib", "platlib")}


class Basis:
    """Digests of what flights depend on; files are read once, when they are first needed.

    Args:
        registry: Registry of the plugins.
    """

    def __init__(self, registry: Registry) -> None:
        self._registry = registry
        self._of_code: dict[str, str] = {}
        self._of_file: dict[Path, str | None] = {}
        self._observers = [registry.source(name) for name in registry.observers()]

    def of(self, mission: Mission) -> dict[str, str]:
        """Return a digest of each thing that a flight depends on, by its name in messages.

        These are the mission as resolved, its world, the files that it names, STAR's core, and the
        plugins that fly: those that the mission uses or names in an option, and the observers.
        """
        content = {key: value for key, value in mission.source.items() if key != "seed"}
        words = {word for word in _words(content) if word}
        digests = {"mission": digest(content), "world": digest(mission.world_file.data)}
        for path in self.files(mission):
            digests[f"file {str(path.relative_to(mission.scene.folder))!r}"] = (
                self._file(path, mission.scene.folder) or ""
            )
        sources = [choice.source for choice in mission.plugins.values()]
        sources += [action.source for action in actions(mission.all_steps)]
        sources += [
            entry.source
            for kind, entry in self._registry
            if kind not in UNNAMED and entry.offer.name in words
        ]
        for source in {source.plugin: source for source in [*sources, *self._observers]}.values():
            digests[f"plugin {source.plugin!r}"] = self._code(source)
        return {**digests, "star_core": self._code(Source("star-swarm:", ""))}

    def files(self, mission: Mission) -> list[Path]:
        """Return the files in its folder that a mission names, without those of its content."""
        folder = mission.scene.folder
        paths = {folder / word for word in _words(mission.source) if word}
        paths |= {*mission.scene.files.values()}
        return [
            path
            for path in sorted(paths, key=str)
            if path != mission.world_file.path and self._file(path, folder)
        ]

    def _file(self, path: Path, folder: Path) -> str | None:
        """Return the digest of a file inside a folder; None if there is none."""
        if path not in self._of_file:
            try:
                inside = path.is_file() and path.resolve().is_relative_to(folder.resolve())
                self._of_file[path] = _digest_of([path]) if inside else None
            except (OSError, RuntimeError, ValueError):  # no path: too long, a NUL, circular links
                self._of_file[path] = None
        return self._of_file[path]

    def _code(self, source: Source) -> str:
        if source.plugin not in self._of_code:
            plugin = self._registry.manager.plugins.get(source.plugin, sys.modules["star_core"])
            name = plugin.__name__ if isinstance(plugin, ModuleType) else type(plugin).__module__
            self._of_code[source.plugin] = _code(sys.modules[name], source)
        return self._of_code[source.plugin]


def digest(content: Any) -> str:
    """Return a digest of JSON, which does not depend on the order of keys."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGEST_LENGTH]


def differences(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return the names of what differs."""
    return [name for name in {**before, **after} if before.get(name) != after.get(name)]


def _words(content: Any) -> Iterator[str]:
    """Yield every text in a mission, keys included."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for key, value in content.items():
            yield str(key)
            yield from _words(value)
    elif isinstance(content, list):
        for value in content:
            yield from _words(value)


def _code(module: ModuleType, source: Source) -> str:
    """Return a digest of a plugin's version and code.

    Of an installed distribution it is that of the digests which its installer has recorded; of one
    that is installed editable, or that stands in a folder, that of its source files.
    """
    file = Path(module.__file__ or "")
    try:
        recorded = _recorded(distribution(source.plugin.partition(":")[0]))
    except PackageNotFoundError:
        recorded = {}
    if file in recorded:
        return digest([source.version, sorted(recorded.values())])
    return digest([source.version, _digest_of(sorted(_source_files(file, own=source.own)))])


def _recorded(installed: Distribution) -> dict[Path, tuple[str, str]]:
    """Return name and digest of the files of a distribution by path, without its metadata."""
    return {
        Path(str(installed.locate_file(file))): (str(file), file.hash.value)
        for file in installed.files or ()
        if file.hash is not None and not file.parts[0].endswith((".dist-info", ".."))
    }


def _source_files(module: Path, *, own: bool) -> Iterator[Path]:
    """Yield the files of a plugin's package, and of the modules and packages beside it.

    The packages beside STAR's own plugins are other plugins, and those in a folder of installed
    packages belong to other distributions.
    """
    top = module
    while (top.parent / "__init__.py").is_file():
        top = top.parent
    tops = [top]
    if not own and top.parent not in INSTALLED:
        tops += [
            each
            for each in top.parent.iterdir()
            if each != top
            and each.stem not in NO_CODE
            and (each.suffix == ".py" or (each / "__init__.py").is_file())
        ]
    for each in tops:
        yield from _files(each)


def _files(path: Path) -> Iterator[Path]:
    """Yield a file, or the files in a folder, without hidden and compiled ones."""
    if path.is_dir():
        for each in path.iterdir():
            if not each.name.startswith((".", "__pycache__")):
                yield from _files(each)
    elif path.is_file():
        yield path


def _digest_of(files: list[Path]) -> str:
    content = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            content.update(
                f"{path.name} {hashlib.file_digest(file, 'sha256').hexdigest()}\n".encode()
            )
    return content.hexdigest()[:DIGEST_LENGTH]
