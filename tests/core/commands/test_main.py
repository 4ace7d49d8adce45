"""The command line: what each command prints, where, and its exit status."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Any, TypeAlias, cast

import pytest

import star_core
from star_core import InputError, Mission, Tick, hookimpl
from star_core.commands import RunOptionSpec
from star_core.commands.main import main
from star_core.plugin_support.registry import Registry
from tests.commands import problem_lines

LATE = ("--set", "mission.0.takeoff.timeout=0.01")  # no agent is up by then
WALL = ("wall_time_s", "realtime_factor", "compute_us", "compute_s")
ENTER = "import sys; from star_core.commands.main import main; sys.exit(main())"
Printed: TypeAlias = pytest.CaptureFixture[str]
pytestmark = pytest.mark.usefixtures("hop")


@pytest.fixture
def captured(capsys: Printed) -> Printed:
    """What is printed, and where."""
    return capsys


def flown(captured: Printed, *arguments: str) -> dict[str, Any]:
    """Fly the mission and return the JSON that is printed, but for its wall time."""
    assert main(["run", "hop.yaml", "--json", "--no-record", *arguments]) == 0
    summary: dict[str, Any] = json.loads(captured.readouterr().out)
    return {key: value for key, value in summary.items() if key not in WALL}


def recorded(file: str, folder: str = "out") -> Any:
    return json.loads((Path(folder) / file).read_text())


# Exit status


def test_a_mission_that_completes_exits_with_0(captured: Printed) -> None:
    assert main(["run", "hop.yaml"]) == 0
    assert captured.readouterr().out.startswith("hop: completed\n")


def test_a_mission_that_fails_exits_with_1_and_prints_the_reason(captured: Printed) -> None:
    assert main(["run", "hop.yaml", *LATE]) == 1
    assert captured.readouterr().out.startswith(
        "hop: failed: hop.yaml:13 takeoff cf1, cf2 failed: timed out"
    )


def test_star_run_is_star_then_run(captured: Printed, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["hop.yaml", "--json", "--no-record"]
    monkeypatch.setattr(sys, "argv", ["/usr/bin/star-run", *arguments])
    assert main() == 0
    summary = json.loads(captured.readouterr().out)
    assert {key: summary[key] for key in summary if key not in WALL} == flown(captured)


def test_both_commands_are_installed() -> None:
    scripts = {script.name: script for script in entry_points(group="console_scripts")}
    assert scripts["star"].load() is scripts["star-run"].load() is main


def test_arguments_default_to_the_command_line(
    captured: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["star", "check", "hop.yaml"])
    assert main() == 0
    assert captured.readouterr() == ("hop.yaml: 'hop' can be flown, with 2 agents\n", "")


# star check


WORLD = "star: 1\nname: hall\nfence: {low: [-2, -2, 0], high: [2, 2, 2]}\n"
STUDY = "star: 1\nname: radii\nmissions: [hop.yaml]\nmeasures: [deadlocks]\n"
CAMERA = "star: 1\nname: mine\nwidth: 640\nheight: 480\n"


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (
            "star: 1\nname: s\nmission: [land: {}]\n",
            "1 step for missions to include; as a mission it lacks "
            "world, swarm, transport, localizer, planner, avoider",
        ),
        (
            "star: 1\nparameters: {a: null, b: 1, c: null}\n"
            "mission: [hold: {for: $b}, goto: {to: $a}, $c]\n",
            "3 steps for missions to include, with a value for a, c",
        ),
        (WORLD, "'hall', a world that can be flown in"),
        (CAMERA, "'mine', a camera for missions"),
        (STUDY + "seeds: 2\n", "'radii', a study of 2 runs"),
    ],
)
def test_files_of_every_kind_are_described(captured: Printed, text: str, reported: str) -> None:
    Path("file.yaml").write_text(text)
    assert main(["check", "file.yaml"]) == 0
    assert captured.readouterr() == (f"file.yaml: {reported}\n", "")


def test_what_is_set_is_checked_in_a_file_of_steps_too(captured: Printed) -> None:
    Path("steps.yaml").write_text("star: 1\nparameters: {b: 1}\nmission: [hold: {for: $b}]\n")
    assert main(["check", "steps.yaml", "--set", "parameters.b=-1"]) == 2
    fault = (
        "--set parameters.b=-1: steps.yaml:3:23: hold: for: -1 is less than the minimum of 0"
        " [out-of-range]"
    )
    printed = captured.readouterr()
    assert (printed.out, problem_lines(printed.err)) == ("", [fault])


def test_what_is_set_makes_no_file_a_mission(captured: Printed) -> None:
    Path("steps.yaml").write_text("star: 1\nmission: [land: {}]\n")
    assert main(["run", "steps.yaml", "--speed", "1"]) == 2
    assert captured.readouterr().err.startswith(
        "steps.yaml:1:1: this is a file of steps, expected a mission"
    )
    assert main(["check", "steps.yaml", "--speed", "1"]) == 0
    assert captured.readouterr().out.startswith("steps.yaml: 1 step for missions to include")


def test_a_mission_without_a_swarm_is_no_file_of_steps(captured: Printed) -> None:
    Path("m.yaml").write_text("star: 1\nname: m\nworld: w.yaml\nmission: [land: {}]\n")
    assert main(["check", "m.yaml"]) == 2
    assert "missing key 'swarm'" in captured.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "star: 1\nparameters: {}\nmission: [land: {}]\n",
        "star: 1\nname: m\nmission: [land: {}]\n",
        WORLD,
        CAMERA,
        STUDY,
    ],
)
@pytest.mark.parametrize("command", ["run", "explain"])
def test_a_file_that_is_no_mission_is_not_flown(captured: Printed, command: str, text: str) -> None:
    Path("file.yaml").write_text(text)
    assert main([command, "file.yaml"]) == 2
    out, err = captured.readouterr()
    assert (out, err[:15], err[-13:]) == ("", "file.yaml:1:1: ", "[wrong-file]\n")


def test_checking_flies_nothing() -> None:
    before = sorted(Path().rglob("*"))
    assert main(["check", "hop.yaml"]) == 0
    assert sorted(Path().rglob("*")) == before


# What is set


@pytest.mark.parametrize(
    ("assignments", "options", "expected"),
    [
        (
            ["avoider=none", "mission=[{takeoff: {}}]", "swarm.cf2.start=[0, 1, 0]"],
            ["--seed", "3", "--speed", "1e6"],
            {
                "avoider": "none",
                "mission": [{"takeoff": {}}],
                "swarm": {"cf1": {"start": [-0.5, 0, 0]}, "cf2": {"start": [0, 1, 0]}},
                "seed": 3,
                "transport": {"use": "sim", "speed": 1e6},
            },
        ),
        (
            ["avoider.radius=0.1", "mission.0.takeoff.height=0.4", "rate=50", "rate=10", "seed=1"],
            ["--seed", "2"],
            {
                "avoider": {"use": "orca", "radius": 0.1},
                "mission": [{"takeoff": {"height": 0.4, "speed": 0.5}}, {"land": {"speed": 0.5}}],
                "rate": 10,
                "seed": 2,
            },
        ),
    ],
)
def test_what_is_set_is_what_is_flown_and_kept(
    assignments: Sequence[str], options: Sequence[str], expected: dict[str, object]
) -> None:
    words = [word for assignment in assignments for word in ("--set", assignment)]
    assert main(["run", "hop.yaml", "--json", "--out", "out", *words, *options]) == 0
    mission = recorded("manifest.json")["mission"]
    assert {key: mission[key] for key in expected} == expected


def test_a_step_that_is_set_is_flown(captured: Printed) -> None:
    low = flown(captured)["path_length_m"]["total"]
    high = flown(captured, "--set", "mission.0.takeoff.height=1.2")["path_length_m"]["total"]
    assert high > low + 2 * 2 * 0.8  # two agents, up and down, 0.9 m higher


def test_a_speed_changes_the_pace_and_nothing_else(captured: Printed) -> None:
    assert flown(captured, "--speed", "1e6") == flown(captured)


# Signals


class Signaller:
    """A plugin that sends signals, all in one tick, and notes what would be done about each."""

    def __init__(self, *numbers: int) -> None:
        self._numbers = list(numbers)
        self.handlers: dict[int, Any] = {}

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        self.handlers = {number: signal.getsignal(number) for number in signal.Signals}
        while self._numbers:
            signal.raise_signal(self._numbers.pop())


def test_signals_during_a_write_to_stderr_are_acknowledged(
    with_plugin: Callable[[object], None],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    class Busy(io.StringIO):
        def write(self, text: str) -> int:
            if "SIGTERM" in text:
                raise RuntimeError("reentrant call inside <_io.BufferedWriter name='<stderr>'>")
            return super().write(text)

        def fileno(self) -> int:
            return 2

    with_plugin(Signaller(signal.SIGTERM))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", Busy())
        assert main(["run", "hop.yaml"]) == 1
    assert "star: SIGTERM: landing; again stops the motors\n" in capfd.readouterr().err


def test_being_asked_to_terminate_lands_all_agents(
    captured: Printed, with_plugin: Callable[[object], None]
) -> None:
    with_plugin(Signaller(signal.SIGTERM))
    assert main(["run", "hop.yaml"]) == 1
    out, err = captured.readouterr()
    assert out.startswith("hop: aborted: interrupted by the operator\n")
    assert "star: SIGTERM: landing; again stops the motors\n" in err


def test_a_third_interrupt_ends_a_flight_that_hangs(
    captured: Printed, with_plugin: Callable[[object], None]
) -> None:
    with_plugin(Signaller(signal.SIGINT, signal.SIGINT, signal.SIGINT))
    assert main(["run", "hop.yaml"]) == 1
    assert captured.readouterr().err.splitlines()[-1] == "interrupted"


def test_after_a_flight_signals_do_what_they_did_before(
    with_plugin: Callable[[object], None],
) -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    with_plugin(watcher := Signaller())
    main(["run", "hop.yaml", "--json", "--no-record"])
    assert all(watcher.handlers[number] != handler for number, handler in before.items())
    assert all(signal.getsignal(number) == handler for number, handler in before.items())


def test_a_terminal_that_is_closed_lands_all_agents(with_plugin: Callable[[object], None]) -> None:
    with_plugin(watcher := Signaller())
    main(["run", "hop.yaml", "--json", "--no-record"])
    assert watcher.handlers[signal.SIGHUP] == watcher.handlers[signal.SIGTERM]


class Stopper:
    """A plugin that runs `star stop` in the first tick."""

    def __init__(self) -> None:
        self.status: int | None = None

    @hookimpl
    def star_ticked(self) -> None:
        if self.status is None:
            self.status = main(["stop"])


def test_star_stop_lands_all_agents(
    captured: Printed, with_plugin: Callable[[object], None]
) -> None:
    with_plugin(stopper := Stopper())
    assert main(["run", "hop.yaml", "--no-record"]) == 1
    assert stopper.status == 0
    out, err = captured.readouterr()
    assert "hop: aborted: interrupted by the operator\n" in out
    assert "star: star stop: landing\n" in err


# What goes wrong in a plugin


def test_verbose_shows_where_a_plugin_raised() -> None:
    broken = "import star_orca.avoider as orca; del orca.Orca\n" + ENTER
    command = [sys.executable, "-c", broken, "run", "hop.yaml", "--verbose"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Traceback (most recent call last):" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("avoider 'orca' (star-swarm ")


# What is refused


@pytest.fixture
def refused(captured: Printed) -> Callable[..., list[str]]:
    """Run ``star``, see that it refuses and leaves nothing behind, and return its errors."""

    def star(*arguments: str) -> list[str]:
        before = sorted(Path().rglob("*"))
        try:
            status = main(arguments)
        except SystemExit as error:  # argparse's way to return
            status = int(error.code or 0)
        out, err = captured.readouterr()
        assert (status, out) == (2, "")
        assert sorted(Path().rglob("*")) == before
        return problem_lines(err)

    return star


def test_a_rate_at_which_no_agent_can_fly_is_refused(refused: Callable[..., list[str]]) -> None:
    assert len(refused("check", "hop.yaml", "--set", "rate=1e-300")) == 1


def test_misspelt_repeated_set_options_get_a_suggestion(refused: Callable[..., list[str]]) -> None:
    (line,) = refused("run", "hop.yaml", "--set", "avoider.radius=0.3", "--set", "avoider.radus=1")
    assert line.endswith("unknown option 'radus'; did you mean 'radius'? [unknown-option]")


@pytest.mark.parametrize(
    ("assignment", "line"),
    [
        ("avoider.horizn=1", "avoider 'orca': unknown option 'horizn'; did you mean 'horizon'?"),
        ("mission.9.land={}", "'mission' has no item 9; the last is 1"),
        ("mission.0.takeoff.height=9", "9 m is outside the heights to fly at, from 0.2 to 1.8 m"),
        ("seed", "has no '=', expected path=value such as avoider.radius=0.3"),
        ("seed=", "has no value after the '='"),
        ("seed=[1", "'[' is not closed; add ']'"),
    ],
)
def test_invalid_set_values_are_reported_with_the_assignment(
    refused: Callable[..., list[str]], assignment: str, line: str
) -> None:
    (problem,) = refused("run", "hop.yaml", "--set", assignment)
    assert problem.startswith(f"--set {assignment}: {line}")


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--seed", "x"), "--set seed=x: seed: 'x' is a string, expected a whole number"),
        (("--seed", ""), "--set seed=: has no value after the '='"),
        (("--speed", "fast"), "--set transport.speed=fast: transport 'sim': speed: 'fast' is a "),
    ],
)
def test_a_seed_or_a_speed_that_is_none_is_refused(
    refused: Callable[..., list[str]], arguments: tuple[str, ...], line: str
) -> None:
    (problem,) = refused("run", "hop.yaml", *arguments)
    assert problem.startswith(line)


@pytest.mark.parametrize(
    ("command", "hint"),
    [
        ("chekc", "did you mean 'check'?"),
        ("rnu", "did you mean 'run'?"),
        ("fly", "there are: ablate, bench, calibrate, camera, "),
        ("", "there are: ablate, bench, calibrate, camera, "),
    ],
)
def test_an_unknown_command_is_refused_with_a_list(
    refused: Callable[..., list[str]], command: str, hint: str
) -> None:
    (line,) = refused(command, "hop.yaml")
    assert line.startswith(f"star has no command {command!r}; {hint}")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("run", "hop.yaml", "--sed", "3"), "did you mean '--seed'?"),
        (("check", "hop.yaml", "--no-record"), "--no-record"),
        (("run",), "mission"),
        (("run", "hop.yaml", "--set"), "--set"),
        (("schema", "wrold"), "'wrold'"),
        ((), "COMMAND"),
    ],
)
def test_what_the_command_line_has_too_much_or_lacks_is_named(
    refused: Callable[..., list[str]], arguments: tuple[str, ...], named: str
) -> None:
    assert named in refused(*arguments)[-1]


class Chatty:
    """An observer that prints."""

    @hookimpl
    def star_mission_started(self) -> None:
        sys.stdout.write("hello\n")

    @hookimpl
    def star_mission_ended(self, summary: dict[str, Any]) -> None:
        summary["outcome"] = "great"


def test_what_plugins_print_is_not_in_the_json(
    captured: Printed, with_plugin: Callable[[object], None]
) -> None:
    with_plugin(Chatty())
    assert main(["run", "hop.yaml", "--json", "--no-record"]) == 0
    printed = captured.readouterr()
    assert json.loads(printed.out)["outcome"] == "completed"
    assert "hello" in printed.err


class Counter:
    """A plugin with an option of ``star run`` that counts ticks."""

    def __init__(self, wrong: Exception | None = None) -> None:
        self.ticks = 0
        self._wrong = wrong

    @hookimpl
    def star_run_options(self) -> Iterable[RunOptionSpec]:
        yield RunOptionSpec(name="count", summary="count ticks", make=self._make)

    def _make(self, mission: Mission, _registry: Registry) -> object:
        assert mission.name == "hop"
        if self._wrong is not None:
            raise self._wrong

        class Observer:
            @hookimpl
            def star_ticked(observer) -> None:  # noqa: N805 -- self is the plugin
                self.ticks += 1

        return Observer()


def test_an_option_of_a_plugin_adds_an_observer(
    captured: Printed, with_plugin: Callable[[object], None]
) -> None:
    for arguments, ticks in ([], 0), (["--count"], 9.8 * 10):
        counter = Counter()
        with_plugin(counter)
        assert main(["run", "hop.yaml", "--no-record", *arguments]) == 0
        assert counter.ticks == pytest.approx(ticks, rel=0.2)
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    assert "--count" in captured.readouterr().out


@pytest.mark.parametrize("name", ["seed", "json", "help"])
def test_an_option_named_like_one_of_star_run_is_left_out(
    captured: Printed, with_plugin: Callable[[object], None], name: str
) -> None:
    class Seeds:
        @hookimpl
        def star_run_options(self) -> Iterable[RunOptionSpec]:
            yield RunOptionSpec(name=name, summary="", make=cast("Any", object))

    with_plugin(Seeds())
    assert main(["run", "hop.yaml", "--no-record", "--seed", "3"]) == 0
    left_out = f"star: --{name} of their-dist 1.2:theirs is left out: star run has an option of"
    assert left_out in captured.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (InputError("counting needs fingers", "missing-package"), "counting needs fingers [mis"),
        (ValueError("no fingers"), "option 'count' (their-dist 1.2:theirs): ValueError: no finger"),
    ],
)
def test_unusable_plugin_options_end_the_run_before_the_flight(
    captured: Printed, with_plugin: Callable[[object], None], wrong: Exception, message: str
) -> None:
    with_plugin(Counter(wrong))
    assert main(["run", "hop.yaml", "--no-record", "--count"]) == 2
    printed = captured.readouterr().err
    assert printed.startswith(message)
    assert "takeoff" not in printed


def test_help_describes_commands(captured: Printed) -> None:
    assert main(["help"]) == 0
    overview = captured.readouterr().out
    assert main(["--help"]) == 0
    assert captured.readouterr().out == overview
    with pytest.raises(SystemExit, match="0"):
        main(["help", "check"])
    assert captured.readouterr().out.startswith("usage: star check [-h]")
    assert main(["help", "chek"]) == 2
    assert "did you mean 'check'?" in captured.readouterr().err


@pytest.mark.parametrize("option", ["--version", "-V"])
def test_the_version_is_that_of_the_distribution(captured: Printed, option: str) -> None:
    assert main([option]) == 0
    assert captured.readouterr().out == f"star {version('star-swarm')}\n"
    assert star_core.__version__ == version("star-swarm")
