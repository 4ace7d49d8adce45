"""Makes pictures of every page and of the terminal, to be looked at: `make looked-at`.

Pages are photographed in headless Chromium at 1400 and 400 px, bright and dark, terminals of 60 and
120 columns in tmux. The pictures are written to build/looked-at/, with an index.html.

    python docs/site/looked_at.py [NAME...]
"""

from __future__ import annotations

import io
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from rich.console import Console
from rich.terminal_theme import MONOKAI
from rich.text import Text

ROOT: Final = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))  # the tests have a browser
from tests.plugins.commands.star_view.chromium import Chromium  # noqa: E402 -- on this path

OUT: Final = ROOT / "build" / "looked-at"
STAR: Final = Path(sys.executable).with_name("star")
GL: Final = ("--enable-unsafe-swiftshader", "--use-gl=angle", "--use-angle=swiftshader")
WIDTHS: Final = (1400, 400)  # px, of pages
COLUMNS: Final = (60, 120)  # of terminals
WINDOW: Final = 875  # px, height of a 3-D page
HIGHEST: Final = 6000  # px, of a picture
SETTLE: Final = 1.0  # s, in which a page is drawn again
LOAD: Final = 10.0  # s, in which a 3-D page loads its scene
PATIENCE: Final = 300.0  # s, for a command
CLOSE: Final = "document.querySelector('.mantine-Notification-closeButton')?.click()"
SCHEMES: Final = ("light", "dark")
MANY: Final = {"decisions": "decisions", "api": "reference/api", "missions": "project/missions"}
SAMPLE: Final = ("index", "methods", "errors", "reliability", "reference/localizers")
STUDY: Final = """\
star: 1
name: avoiders
missions: [../hello.yaml]
seeds: 5
factors:
  avoider: {orca: {avoider: orca}, potential: {avoider: potential}}
  world: {default: {}, ideal: {transport.profile: ideal, transport.controller: ideal}}
"""
SPOILED: Final = "localizer: flow", "localizer: flo"


class Terminal(NamedTuple):
    """A command on a terminal.

    Attributes:
        command: Its line, in a folder with `missions/`, `examples/` and records in `runs/`.
        after: Time at which it is looked at, s; None at its end.
    """

    command: str
    after: float | None = None


TERMINALS: Final = {
    "help": Terminal("star --help"),
    "missions": Terminal("star missions"),
    "check": Terminal("star check missions/hello.yaml spoiled.yaml"),
    "errors": Terminal("star errors unknown-plugin"),
    "explain": Terminal("star explain missions/search.yaml"),
    "flying": Terminal("star run missions/first_flight.yaml --no-record --speed 2", after=9.0),
    "run": Terminal("star run missions/hello.yaml --no-record"),
    "plugins": Terminal("star plugins"),
    "plugin": Terminal("star plugins orca"),
    "import": Terminal("star import examples/original_star --out imported"),
    "study": Terminal("star ablate missions/studies/looked_at.yaml --out study"),
    "evaluate": Terminal("star evaluate runs/search"),
    "recover": Terminal("star recover runs/search"),
    "new": Terminal("star new plugin gentle --kind avoider"),
    "calibrate": Terminal("star calibrate camera examples/chessboard/*.jpg -o mine.yaml"),
    "bench": Terminal("star bench --scenarios crossing --avoiders orca none --seeds 1 --out bench"),
    "preflight": Terminal("star preflight missions/hello.yaml --set transport=radio"),
}


@contextmanager
def workplace() -> Iterator[Path]:
    """Yield a folder with missions, a record and a study, in which all commands run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for each in ("missions", "examples"):
            shutil.copytree(ROOT / each, folder / each)
        (folder / "missions/studies/looked_at.yaml").write_text(STUDY, encoding="utf-8")
        text = (ROOT / "missions/hello.yaml").read_text(encoding="utf-8")
        (folder / "spoiled.yaml").write_text(
            text.replace(*SPOILED).replace("worlds/", "missions/worlds/"), encoding="utf-8"
        )
        _run(folder, "run missions/search.yaml --save-frames --out runs/search")
        _run(folder, "ablate missions/studies/looked_at.yaml --out study --quiet")
        _run(folder, "report runs/search")
        yield folder


def _run(folder: Path, command: str) -> None:
    subprocess.run(
        [STAR, *shlex.split(command)], cwd=folder, check=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip


def reports(folder: Path) -> None:
    """Reports of a flight and of a study, bright and dark, and on paper."""
    for name, file in (
        ("report-flight", folder / "runs/search/report.html"),
        ("report-study", folder / "study/report.html"),
    ):
        for scheme in SCHEMES:
            with Chromium(file.as_uri(), *_dark(scheme)) as page:
                page.wait_for("document.body.dataset.ready")
                _page(page, f"{name}-{scheme}")


def views(folder: Path) -> None:
    """The 3-D pages of a mission, a flight and a world, and that of a flight being flown."""
    commands = {
        "view-mission": "view missions/search.yaml",
        "view-flight": "view runs/search",
        "view-world": "view missions/worlds/search_hall.yaml",
        "view-live": "run missions/search.yaml --no-record --view --speed 0.2",
    }
    for name, command in commands.items():
        with _served(folder, command) as address:
            for scheme in SCHEMES:
                with Chromium(address, *GL, *_dark(scheme)) as page:
                    for width in WIDTHS:
                        page.screenshot(width, WINDOW)
                        page.run("location.reload()")  # the camera depends on the size
                        time.sleep(SETTLE)
                        page.wait_for("document.querySelector('canvas') !== null")
                        time.sleep(LOAD)
                        page.run(CLOSE)
                        time.sleep(SETTLE)
                        _save(f"{name}-{scheme}-{width}", page.screenshot(width, WINDOW))


@contextmanager
def _served(folder: Path, command: str) -> Iterator[str]:
    """Run a command that serves a page, and yield its address."""
    process = subprocess.Popen(
        [STAR, *shlex.split(command)], cwd=folder, stdout=subprocess.PIPE, text=True,
        stderr=subprocess.STDOUT,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        yield next(
            word for line in process.stdout for word in line.split() if word.startswith("http://")
        )
    finally:
        process.terminate()
        process.wait(PATIENCE)


def site(_folder: Path) -> None:
    """Pages of the documentation, as `make docs` builds it; some of them dark and on paper, too.

    Of `MANY`, whose pages are of one form, the first is taken.
    """
    built = ROOT / "build" / "docs"
    pages = [file for file in sorted(built.rglob("*.html")) if file.parent.name not in MANY]
    first = [min((built / folder).glob("*.html")) for folder in MANY.values()]
    pages += first
    sample = [*first, *(built / f"{name}.html" for name in SAMPLE)]
    for scheme in SCHEMES:
        with Chromium(pages[0].as_uri(), *_dark(scheme)) as page:  # a file leads to others
            for file in pages if scheme == SCHEMES[0] else sample:
                address = file.as_uri()
                page.run(f"location.href = {address!r}")
                page.wait_for(
                    f"location.href === {address!r} && document.readyState === 'complete'"
                )
                name = str(file.relative_to(built).with_suffix("")).replace("/", "-")
                _page(page, f"site-{name}-{scheme}")
                if file in sample:
                    _paper(page.pdf(), f"site-{name}-{scheme}-paper")


def sheets(folder: Path) -> None:
    """What is printed on paper: the chessboard, the tags of a world and their plan, a report."""
    _run(folder, "calibrate board -o board.pdf")
    _run(folder, "tags missions/worlds/search_hall.yaml --plan -o plan.pdf")
    _run(folder, "tags missions/worlds/search_hall.yaml -o tags.pdf")
    for file in ("board", "plan", "tags"):
        _paper((folder / f"{file}.pdf").read_bytes(), file)


def terminals(folder: Path) -> None:
    """Commands on terminals."""
    for name, terminal in TERMINALS.items():
        for columns in COLUMNS:
            _terminal(folder, name, terminal, columns)


def _terminal(folder: Path, name: str, terminal: Terminal, columns: int) -> None:
    """Photograph a command in a tmux of its own."""
    for made in ("imported", "mine.yaml", "star-gentle"):  # which commands refuse to overwrite
        target = folder / made
        shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)
    tmux = ["tmux", "-L", f"star-looked-at-{columns}"]
    line = terminal.command.replace("star", shlex.quote(str(STAR)), 1)
    shell = f"cd {shlex.quote(str(folder))}; TERM=xterm-256color {line}; touch done; sleep 1000"
    marker = folder / "done"
    marker.unlink(missing_ok=True)
    subprocess.run([*tmux, "new-session", "-d", "-x", str(columns), "-y", "50", shell], check=True)
    try:
        deadline = time.monotonic() + (terminal.after or PATIENCE)
        while not marker.exists() and time.monotonic() < deadline:
            time.sleep(0.2)
        time.sleep(SETTLE)
        text = subprocess.run(
            [*tmux, "capture-pane", "-e", "-p", "-S", "-200"], check=True, capture_output=True,
            text=True,
        ).stdout.rstrip()  # fmt: skip
    finally:
        subprocess.run([*tmux, "kill-server"], check=True)
    console = Console(record=True, width=columns, file=io.StringIO(), color_system="truecolor")
    console.print(f"$ {terminal.command}", style="bold", highlight=False)
    console.print(Text.from_ansi(text), no_wrap=True, crop=False)
    with tempfile.TemporaryDirectory() as home:
        page = Path(home) / "page.html"
        page.write_text(console.export_html(theme=MONOKAI), encoding="utf-8")
        with Chromium(page.as_uri()) as chromium:
            chromium.wait_for("document.readyState === 'complete'")
            chromium.screenshot(16 * columns, WINDOW)
            width, height = (
                int(chromium.run(f"document.querySelector('code').getBoundingClientRect().{side}"))
                for side in ("right", "bottom")
            )
            _save(f"terminal-{name}-{columns}", chromium.screenshot(width + 20, height + 20))


def _paper(document: bytes, name: str) -> None:
    """Photograph the first two sheets of a PDF."""
    subprocess.run(
        ["pdftoppm", "-png", "-r", "50", "-l", "2", "-", OUT / name], input=document, check=True
    )


def _dark(scheme: str) -> tuple[str, ...]:
    return ("--force-dark-mode",) if scheme == "dark" else ()


def _page(page: Chromium, name: str) -> None:
    """Photograph a whole page at all widths."""
    for width in WIDTHS:
        page.screenshot(width, WINDOW)
        time.sleep(SETTLE)
        height = int(page.run("document.documentElement.scrollHeight"))
        page.screenshot(width, min(height, HIGHEST))
        time.sleep(SETTLE)
        overflow = int(page.run("document.documentElement.scrollWidth")) - width
        if overflow > 0:
            sys.stderr.write(f"{name}: {overflow} px wider than {width} px\n")
        _save(f"{name}-{width}", page.screenshot(width, min(height, HIGHEST)))


def _save(name: str, image: bytes) -> None:
    (OUT / f"{name}.png").write_bytes(image)


MAKERS: Final[dict[str, Callable[[Path], None]]] = {
    maker.__name__: maker for maker in (reports, views, site, sheets, terminals)
}


def main(names: Sequence[str]) -> None:
    """Make the pictures of some kinds, or all."""
    OUT.mkdir(parents=True, exist_ok=True)
    with workplace() as folder:
        for name in names or MAKERS:
            sys.stderr.write(f"{name}\n")
            MAKERS[name](folder)
    images = sorted(path.name for path in OUT.glob("*.png"))
    figures = "".join(f"<h2>{name}</h2><img src={name}>" for name in images)
    (OUT / "index.html").write_text(f"<!doctype html>{figures}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
