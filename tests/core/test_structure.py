"""The kernel stays small enough to be read in half an hour, and folders small enough to find in."""

from __future__ import annotations

from pathlib import Path

import star_core

CORE = Path(star_core.__file__).parent
MAX_KERNEL_LINES, MAX_FILES = 2700, 20  # of the files directly in `star_core`, and of a folder


def test_the_kernel_is_short() -> None:
    kernel = list(CORE.glob("*.py"))
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in kernel)
    assert 1000 < lines <= MAX_KERNEL_LINES


def test_no_package_of_the_core_has_many_files() -> None:
    folders = {path.parent for path in CORE.rglob("*.py")}
    count = {
        folder.relative_to(CORE).as_posix(): len(list(folder.glob("*.py"))) for folder in folders
    }
    assert len(count) > 5
    assert {name: n for name, n in count.items() if n > MAX_FILES} == {}
