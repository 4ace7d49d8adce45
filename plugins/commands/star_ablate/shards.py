"""Shards of a study: every n-th run, and all runs of the folders that they were flown into."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from star_ablate.basis import differences
from star_ablate.flight import Result
from star_ablate.journal import JOURNAL, changes, entries
from star_ablate.study import Run
from star_core import InputError
from star_core.toolkit import log, shortlist

ABOUT = "study.json"
Item = TypeVar("Item")


class Shard(NamedTuple):
    """The runs `number`, `number + total`, ... of a study, counted from 1."""

    number: int = 1
    total: int = 1

    def __str__(self) -> str:
        return f"shard {self.number}/{self.total}" if self.total > 1 else "the whole study"

    def of(self, items: Sequence[Item]) -> Sequence[Item]:
        """Return the items of the shard."""
        return items[self.number - 1 :: self.total]


def shard(text: str) -> Shard:
    """Return the shard ``NUMBER/COUNT``, as a ``type`` for argparse.

    >>> shard("3/16")
    Shard(number=3, total=16)
    """
    if (match := re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)) is None:
        raise ValueError(text)
    number, total = map(int, match.groups())
    if not 1 <= number <= total:
        raise ValueError(text)
    return Shard(number, total)


shard.__name__ = "shard (NUMBER/COUNT, from 1/COUNT to COUNT/COUNT)"  # as argparse calls it


def require_shard(folder: Path, chosen: Shard) -> None:
    """Require that a folder, if it has runs, has those of a shard.

    Raises:
        InputError: It has those of another one.
    """
    if (folder / ABOUT).is_file() and (flown := _shard_of(_about(folder))) != chosen:
        raise InputError(f"--out {folder}: has {flown}; name another folder", "unwritable-file")


def merged(runs: Sequence[Run], folders: Sequence[Path]) -> dict[str, Result]:
    """Return the results of all runs by key, from the folders that shards were flown into.

    Raises:
        InputError: A run is in no folder, or in two; a folder has no shard of the study.
    """
    abouts = {folder: _about(folder) for folder in folders}
    shards = {folder: _shard_of(about) for folder, about in abouts.items()}
    problems = [f"{folder}: is given twice" for folder in shards if folders.count(folder) > 1]
    problems += [*_doubled(shards), *_missing(shards)]
    results: dict[str, Result] = {}
    for folder, part in shards.items():
        read = {entry.key: entry for entry in entries(folder / JOURNAL)}
        expected = part.of(runs)
        missing = [run for run in expected if run.key not in read]
        if missing:
            causes = shortlist(changes(missing, read.values()))
            why = f"{causes}" if causes else f"among them {missing[0]}"
            count = f"{len(missing)} of its {len(expected)} runs"
            problems.append(f"{folder}, {part}: {count} are missing; {why}; resume it")
        results |= {run.key: read[run.key].result for run in expected if run.key in read}
    if problems:
        raise InputError([f"--merge: {problem}" for problem in problems], "incomplete-study")
    _report_versions(abouts)
    return results


def _doubled(shards: Mapping[Path, Shard]) -> Iterator[str]:
    """Yield the pairs of folders with common runs."""
    for (first, shard), (second, other) in combinations(shards.items(), 2):
        if (shard.number - other.number) % math.gcd(shard.total, other.total) == 0:
            twice = f"{shard} is there twice"
            both = twice if shard == other else f"{shard} and {other} overlap"
            yield f"{both}: {first}, {second}"


def _missing(shards: Mapping[Path, Shard]) -> Iterator[str]:
    """Yield what is in no folder."""
    count = math.lcm(*(part.total for part in shards.values()))
    covered = {
        number for part in shards.values() for number in range(part.number, count + 1, part.total)
    }
    if missing := [str(Shard(k, count)) for k in range(1, count + 1) if k not in covered]:
        yield f"no folder has {shortlist(missing)}"


def _about(folder: Path) -> Mapping[str, Any]:
    """Return the contents of a folder's ``study.json``.

    Raises:
        InputError: It has none.
    """
    try:
        about = json.loads((folder / ABOUT).read_text(encoding="utf-8"))
        if isinstance(about, dict) and (folder / JOURNAL).is_file():
            return about
    except (OSError, ValueError, RecursionError):
        pass
    raise InputError(f"{folder}: no folder of a study, with {ABOUT} and {JOURNAL}", "no-record")


def _shard_of(about: Mapping[str, Any]) -> Shard:
    try:
        return shard(str(about.get("shard", "1/1")))
    except ValueError:
        return Shard()


def _report_versions(abouts: Mapping[Path, Mapping[str, Any]]) -> None:
    """Report packages that differ between folders."""
    (first, about), *others = abouts.items()
    expected = _versions(about)
    for folder, other in others:
        versions = _versions(other)
        different = [
            f"{name} {versions.get(name)}, not {expected.get(name)}"
            for name in differences(expected, versions)
        ]
        if different:
            log(
                f"star: {folder} was flown with other versions than {first}: {shortlist(different)}"
            )


def _versions(about: Mapping[str, Any]) -> dict[str, str]:
    packages = about.get("packages")
    versions = {"Python": about.get("python"), **(packages if isinstance(packages, dict) else {})}
    return {name: str(version) for name, version in versions.items()}
