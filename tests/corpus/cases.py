"""Reads the files of faulty missions beside it: many small files in one, each with a fault marked.

A topic is a text file. It opens with what it is about; a line ``$ star check mission.yaml`` says
what is run. ``=== valid`` begins the files that are right, each after a line ``--- name``. Every
further ``=== title`` is a case: what it writes differently, and where that is a fault.

- Text of a file that is among the valid ones stands in the place of the blocks with the same keys
  at the left margin; the rest of the file stays. ``without name`` takes the block of a key away.
- ``--- name, whole`` begins a file that is written as it is here, and ``--- name, escaped`` one
  whose ``\\x00`` stand for bytes. A file that is not among the valid ones is always whole.
- Text before the first ``---`` is of the first of the valid files.
- ``# <-- column: words [code]`` ends the line that is at fault: an error is expected there, with
  this code and these words; column and words can be omitted. Where no comment can stand,
  ``@ name:line:column: words [code]`` does as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from star_core.errors import code_of

FOLDER = Path(__file__).parent
MARK = re.compile(r"# <-- (?:(?P<column>\d+): )?(?P<words>.+)$")
AT = re.compile(r"@ (?P<file>[^:]+):(?P<line>\d+)(?::(?P<column>\d+))?: (?P<words>.+)")


@dataclass(frozen=True)
class Expected:
    """An expected error: where it is, words that it contains, and its code.

    Attributes:
        file: Name of the file.
        line: Number of the line.
        column: Number of the column; None for any.
        words: Part of the message.
        code: Its code.
    """

    file: str
    line: int
    column: int | None
    words: str
    code: str

    @classmethod
    def of(cls, file: str, line: str | int, column: str | None, text: str) -> Expected:
        """Take words and code apart."""
        code = code_of(f" {text.strip()}")
        words = text.strip().removesuffix(f"[{code}]").strip()
        return cls(file, int(line), int(column) if column else None, words, code)


@dataclass(frozen=True)
class Case:
    """Files with a fault.

    Attributes:
        topic: Name of the text file, without its ending.
        title: What is wrong.
        command: What is run.
        files: What is written, by name.
        expected: What has to be told; nothing of the valid files.
    """

    topic: str
    title: str
    command: tuple[str, ...]
    files: Mapping[str, bytes]
    expected: tuple[Expected, ...]

    def write(self, folder: Path) -> None:
        """Write the files into a folder."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)

    def __str__(self) -> str:
        return f"{self.topic}: {self.title}"


def topics() -> list[str]:
    """Names of every topic."""
    return sorted(path.stem for path in FOLDER.glob("*.txt"))


def valid(topic: str) -> Case:
    """Return the files of a topic that are right."""
    return next(_read(topic))


def faulty() -> list[Case]:
    """Return every faulty case of every topic."""
    return [case for topic in topics() for case in list(_read(topic))[1:]]


def _read(topic: str) -> Iterator[Case]:
    """Read a topic: its valid files, and then every faulty case.

    Raises:
        ValueError: A case has no mark, or its title is there twice.
    """
    text = (FOLDER / f"{topic}.txt").read_text(encoding="utf-8")
    about, *parts = re.split(r"^=== ", text, flags=re.MULTILINE)
    (command,) = re.findall(r"^\$ star (.+)$", about, flags=re.MULTILINE)
    base: dict[str, str] = {}
    titles: set[str] = set()
    for part in parts:
        title, _, body = part.partition("\n")
        files, marks = _files(body, base)
        base = base or {name: content.decode() for name, content in files.items()}
        if title in titles or bool(marks) is not bool(titles):
            raise ValueError(f"{topic}: {title}: expected a title of its own, and a mark")
        titles.add(title)
        yield Case(topic, title, tuple(command.split()), files, tuple(marks))


def _files(body: str, base: Mapping[str, str]) -> tuple[dict[str, bytes], list[Expected]]:
    """Return the files of a case, and the errors that they must cause."""
    marks = [
        Expected.of(mark["file"], mark["line"], mark["column"], mark["words"])
        for line in body.splitlines()
        if (mark := AT.fullmatch(line))
    ]
    lines = [line for line in body.split("\n") if not AT.fullmatch(line)]
    first, *sections = re.split(r"^--- ", "\n".join(lines).rstrip("\n") + "\n", flags=re.MULTILINE)
    if first.strip():
        sections.insert(0, f"{next(iter(base))}\n{first}")
    files = {name: content.encode() for name, content in base.items()}
    for section in sections:
        header, _, text = section.partition("\n")
        name, _, manner = header.partition(", ")
        if manner == "escaped":
            raw = text.rstrip("\n").encode("latin-1").decode("unicode_escape")
            files[name] = raw.encode("latin-1")
            continue
        text = text if manner == "whole" or name not in base else _changed(base[name], text)
        files[name] = text.encode()
        marks += [
            Expected.of(name, number, mark["column"], mark["words"])
            for number, line in enumerate(text.split("\n"), start=1)
            if (mark := MARK.search(line))
        ]
    return files, marks


def _changed(text: str, changes: str) -> str:
    """Return a text with some of its blocks replaced, taken away, or added at its end."""
    blocks = dict(_blocks(text))
    for key, block in _blocks(changes):
        if key.startswith("without "):
            del blocks[key.removeprefix("without ")]
        else:
            blocks[key] = block
    return "".join(blocks.values())


def _blocks(text: str) -> Iterator[tuple[str, str]]:
    """Yield the key of each line at the left margin, and the line with what is indented below."""
    for block in re.findall(r"^[^\s#-].*\n(?:(?:[\s#-].*)?\n)*", text, flags=re.MULTILINE):
        yield block.partition(":")[0].rstrip(), block
