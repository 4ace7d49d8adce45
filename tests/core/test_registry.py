"""Plugins that are found, and those that are left out."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Generator, Iterable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from star_core import (
    AvoiderSpec,
    InputError,
    PlannerSpec,
    PluginError,
    TaskSpec,
    Tick,
    hookimpl,
    load,
)
from star_core.commands import CommandSpec, Source
from star_core.plugin_support.registry import Registry, guarded
from star_core.toolkit import KindSpec, Spec
from tests.conftest import HOP

NEVER_MADE: Any = object


def offer(name: str) -> PlannerSpec:
    return PlannerSpec(name=name, summary=f"The {name}.", make=NEVER_MADE)


class Planners:
    """A plugin that offers planners of some names."""

    def __init__(self, *names: str) -> None:
        self._offers = [offer(name) for name in names]

    @hookimpl
    def star_planners(self) -> Iterable[PlannerSpec]:
        return self._offers


class Ticking:
    """An observer."""

    @hookimpl
    def star_ticked(self, tick: Tick) -> None: ...


@pytest.fixture
def registry() -> Registry:
    return Registry(installed=False)


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Install a distribution ``<module>-dist`` 1.0 whose entry point is a module of that text."""
    monkeypatch.syspath_prepend(tmp_path)

    def installed(module: str, text: str) -> None:
        (tmp_path / f"{module}.py").write_text(text)
        info = tmp_path / f"{module}_dist-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Name: {module}-dist\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[star.plugins]\n{module} = {module}\n")
        monkeypatch.delitem(sys.modules, module, raising=False)

    return installed


GOOD = """
from star_core import AvoiderSpec, PlannerSpec, TaskSpec, hookimpl

@hookimpl
def star_planners():
    yield PlannerSpec(name="theirs", summary="Theirs.", make=object)
"""
IMPORTS = "from star_core import AvoiderSpec, PlannerSpec, TaskSpec, hookimpl\n@hookimpl\n"


def test_installed_plugins_have_their_distribution_and_version(
    install: Callable[[str, str], None],
) -> None:
    install("good_star", GOOD)
    plugin = Registry().find("planner", "theirs")
    assert str(plugin.source) == "good_star-dist 1.0:good_star"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("raise SystemExit('bye')", "SystemExit: bye"),
        ("raise BaseException('panic')", "BaseException: panic"),
        ("raise ValueError('too\\nlong')", "ValueError: too long"),
        ("def f(:", "SyntaxError: invalid syntax"),
        (
            IMPORTS + "def star_planners():\n    yield 'orca'",
            "PluginError: star_planners() yields str, expected PlannerSpec",
        ),
        (IMPORTS + "def star_planners():\n    1 / 0", "ZeroDivisionError: division by zero"),
        (
            IMPORTS + "def star_planners():\n    raise BaseException('panic')",
            "BaseException: panic",
        ),
        (
            IMPORTS + "def star_planner(): ...",
            "PluginError: no hook named 'star_planner'; did you mean 'star_planners'?",
        ),
    ],
    ids=[
        "import",
        "raise",
        "exit",
        "panic",
        "two lines",
        "syntax",
        "no offer",
        "hook raises",
        "hook panics",
        "no hook",
    ],
)
def test_a_broken_plugin_is_left_out_and_grounds_no_other(
    install: Callable[[str, str], None], text: str, why: str
) -> None:
    install("good_star", GOOD)
    install("bad_star", text)
    registry = Registry()
    assert "theirs" in registry.names("planner")
    assert "straight" in registry.names("planner")
    assert registry.broken[Source("bad_star-dist:bad_star", "1.0")].startswith(why)


def test_missing_names_report_the_plugins_left_out(install: Callable[[str, str], None]) -> None:
    install("bad_star", "1 / 0")
    with pytest.raises(PluginError) as caught:
        Registry().find("planner", "theirs")
    assert str(caught.value).startswith("no planner named 'theirs'; ")
    assert (
        "; plugin bad_star-dist 1.0:bad_star was left out: ZeroDivisionError: division by zero"
        in str(caught.value)
    )


@pytest.mark.parametrize(
    ("variable", "value", "why"),
    [
        ("STAR_BLOCK_PLUGINS", "tired", "blocked by STAR_BLOCK_PLUGINS"),
        ("STAR_ALLOW_PLUGINS", "other", "not in STAR_ALLOW_PLUGINS"),
    ],
)
def test_a_name_of_a_blocked_plugin_is_explained(
    install: Callable[[str, str], None],
    hop: Path,
    monkeypatch: pytest.MonkeyPatch,
    variable: str,
    value: str,
    why: str,
) -> None:
    install("tired", GOOD)
    monkeypatch.setenv(variable, value)
    registry = Registry()
    hint = f"'tired'; plugin tired-dist 1.0:tired is installed, but {why} [unknown-"
    with pytest.raises(PluginError) as missing:
        registry.find("avoider", "tired")
    assert f"no avoider named {hint}plugin]" in str(missing.value)
    (hop / "hop.yaml").write_text(HOP.replace("land:", "tired:"))
    with pytest.raises(InputError) as caught:
        load(hop / "hop.yaml", registry, ["avoider=tired"])
    assert f"no avoider named {hint}plugin]" in str(caught.value)
    assert f"unknown verb {hint}verb]" in str(caught.value)


def test_a_plugin_that_is_refused_leaves_nothing_behind(registry: Registry) -> None:
    class Half(Planners):
        @hookimpl
        def star_tasks(self) -> Iterable[Any]:
            return ["fly"]

    with pytest.raises(PluginError) as caught:
        registry.add(Half("mine"), Source("my-dist:half"))
    assert str(caught.value) == "star_tasks() yields str, expected TaskSpec [contract-broken]"
    assert registry.names("planner") == ()
    assert registry.manager.get_plugins() == set()


def test_a_hook_that_does_not_exist_is_refused_with_a_hint(registry: Registry) -> None:
    class Misspelt:
        @hookimpl
        def star_tick(self, tick: Tick) -> None: ...

    with pytest.raises(PluginError, match=r"'star_ticked'\? \[contract-broken\]"):
        registry.add(Misspelt(), Source("my-dist:misspelt"))


def test_a_hook_that_asks_for_what_no_agent_reports_is_refused(registry: Registry) -> None:
    class Wrong:
        @hookimpl
        def star_ticked(self, tock: Tick) -> None: ...

    with pytest.raises(PluginError, match=r"star_ticked.*tock"):
        registry.add(Wrong(), Source("my-dist:wrong"))
    assert registry.manager.get_plugins() == set()


def test_a_plugin_that_is_added_twice_is_refused_and_stays(registry: Registry) -> None:
    registry.add(Planners("mine"), Source("my-dist:mine"))
    with pytest.raises(PluginError, match="my-dist:mine"):
        registry.add(Ticking(), Source("my-dist:mine"))
    assert registry.manager.has_plugin("my-dist:mine")


def test_modules_that_are_given_are_distinguished() -> None:
    first, second = ModuleType("first"), ModuleType("second")
    first.star_planners = hookimpl(lambda: [offer("mine")])  # type: ignore[attr-defined]
    second.star_planners = hookimpl(lambda: [offer("yours")])  # type: ignore[attr-defined]
    assert Registry(first, second, installed=False).names("planner") == ("mine", "yours")


def test_two_plugins_of_one_name_are_refused_when_it_is_used(registry: Registry) -> None:
    registry.add(Planners("stay", "mine"), Source("star-stay:stay", "1.0"))
    registry.add(Planners("stay"), Source("their-stay:stay"))
    sources = "star-stay 1.0:stay and their-stay:stay; uninstall one"
    with pytest.raises(PluginError, match=rf"^two plugins offer .*planner .*'stay': {sources} "):
        registry.find("planner", "stay")
    assert registry.find("planner", "mine").offer.name == "mine"


@pytest.mark.parametrize("name", ["run", "view"])
def test_a_command_named_like_one_of_star_leaves_its_plugin_out(name: str) -> None:
    class Theirs:
        @hookimpl
        def star_commands(self) -> Iterable[CommandSpec]:
            yield CommandSpec(name=name, summary="", configure=print, run=lambda *_: 0)

    registry = Registry()
    with pytest.raises(PluginError, match=rf"^command '{name}': STAR has a command of that name"):
        registry.add(Theirs(), Source("their-dist:theirs"))
    assert registry.find("command", name).source.own


def test_one_name_may_stand_for_several_kinds(registry: Registry) -> None:
    class Both(Planners):
        @hookimpl
        def star_avoiders(self) -> Iterable[AvoiderSpec]:
            yield AvoiderSpec(name="stay", summary="Stays.", make=NEVER_MADE)

    registry.add(Both("stay"), Source("my-dist:both"))
    assert [kind for kind, plugin in registry if plugin.offer.name == "stay"] == [
        "planner",
        "avoider",
    ]


@pytest.mark.parametrize(
    ("offered", "name", "hint"),
    [
        (("repulsion", "stay"), "repulsoin", "; did you mean 'repulsion'?"),
        (("stay", "repulsion"), "xyz", "; there are: repulsion, stay"),
        ((), "stay", ""),
    ],
)
def test_an_unknown_name_is_answered_with_a_hint(
    registry: Registry, offered: tuple[str, ...], name: str, hint: str
) -> None:
    registry.add(Planners(*offered), Source("my-dist:mine"))
    with pytest.raises(PluginError) as caught:
        registry.find("planner", name)
    assert str(caught.value) == f"no planner named {name!r}{hint} [unknown-plugin]"


def test_every_offer_is_listed_those_of_one_name_too(registry: Registry) -> None:
    registry.add(Planners("stay", "go"), Source("a:a"))
    registry.add(Planners("stay"), Source("b:b"))
    listed = [(kind, plugin.offer.name, str(plugin.source)) for kind, plugin in registry]
    assert listed == [
        ("planner", "go", "a:a"),
        ("planner", "stay", "a:a"),
        ("planner", "stay", "b:b"),
    ]
    assert [*registry.offers()["planner"]] == ["go", "stay"]


class Shy:
    """A plugin whose hook offers nothing."""

    @hookimpl
    def star_planners(self) -> None: ...


class Unmarked:
    """A plugin with a function that is no hook."""

    def star_planners(self) -> Iterable[PlannerSpec]:
        yield offer("mine")


@pytest.mark.parametrize("plugin", [Ticking(), Shy(), Unmarked()])
def test_a_plugin_may_offer_nothing(registry: Registry, plugin: object) -> None:
    registry.add(plugin, Source("my-dist:mine"))
    assert not any(registry.names(kind) for kind in registry.kinds)


def test_a_plugin_may_be_an_object_without_a_hash(registry: Registry) -> None:
    plugin = SimpleNamespace(star_planners=hookimpl(lambda: [offer("mine")]))
    registry.add(plugin, Source("my-dist:bare"))
    registry.add(Planners("yours"), Source("my-dist:planners"))
    assert registry.names("planner") == ("mine", "yours")


# As pluggy documents


def test_specname_names_the_hook(registry: Registry) -> None:
    class Renamed:
        @hookimpl(specname="star_planners")
        def my_planners(self) -> Iterable[PlannerSpec]:
            yield offer("mine")

        @hookimpl
        def star_planners(self) -> Iterable[PlannerSpec]:
            yield offer("yours")

    registry.add(Renamed(), Source("my-dist:renamed"))
    assert registry.names("planner") == ("mine", "yours")


def test_an_optional_hook_may_be_unknown(registry: Registry) -> None:
    class Ahead(Planners):
        @hookimpl(optionalhook=True)
        def star_gripped(self) -> None: ...

    registry.add(Ahead("mine"), Source("my-dist:ahead"))
    assert registry.names("planner") == ("mine",)


class Hiding:
    """A plugin that hides planners of some names, or raises."""

    def __init__(self, *hidden: str, error: BaseException | None = None) -> None:
        self._hidden, self._error = hidden, error
        self.names: list[list[str]] = []

    @hookimpl(wrapper=True)
    def star_planners(self) -> Generator[None, Any, Any]:
        results = yield
        self.names.append([spec.name for specs in results for spec in specs])
        if self._error and results:
            raise self._error
        return [[spec for spec in specs if spec.name not in self._hidden] for specs in results]


@pytest.mark.parametrize("first", [True, False], ids=["wrapper first", "wrapper last"])
def test_a_wrapper_receives_the_records_of_every_plugin(registry: Registry, first: bool) -> None:  # noqa: FBT001
    hiding = Hiding("stay")
    if first:
        registry.add(hiding, Source("my-dist:hiding"))
    registry.add(Planners("stay", "go"), Source("a:a"))
    registry.add(Planners("come"), Source("b:b"))
    if not first:
        registry.add(hiding, Source("my-dist:hiding"))
    assert registry.names("planner") == ("come", "go")
    assert str(registry.find("planner", "go").source) == "a:a"
    assert hiding.names[-1] == ["come", "stay", "go"]  # last registered, first called


def test_tryfirst_and_trylast_order_what_a_wrapper_receives(registry: Registry) -> None:
    class First:
        @hookimpl(tryfirst=True)
        def star_planners(self) -> Iterable[PlannerSpec]:
            yield offer("first")

    class Last:
        @hookimpl(trylast=True)
        def star_planners(self) -> Iterable[PlannerSpec]:
            yield offer("last")

    hiding = Hiding()
    for plugin in (First(), Planners("any"), Last(), hiding):
        registry.add(plugin, Source(f"my-dist:{type(plugin).__name__}"))
    assert hiding.names[-1] == ["first", "any", "last"]


def test_what_a_wrapper_adds_is_attributed_to_its_plugin(registry: Registry) -> None:
    class Adding:
        @hookimpl(wrapper=True)
        def star_planners(self) -> Generator[None, Any, Any]:
            return [*(yield), [offer("mine")]]

    registry.add(Planners("stay"), Source("a:a"))
    registry.add(Adding(), Source("my-dist:adding"))
    sources = {plugin.offer.name: str(plugin.source) for _, plugin in registry}
    assert sources == {"stay": "a:a", "mine": "my-dist:adding"}


def test_a_wrapper_that_raises_is_refused_when_it_is_added(registry: Registry) -> None:
    registry.add(Planners("stay"), Source("a:a"))
    with pytest.raises(RuntimeError, match="boom"):
        registry.add(Hiding(error=RuntimeError("boom")), Source("my-dist:hiding"))
    assert registry.names("planner") == ("stay",)
    assert not registry.manager.has_plugin("my-dist:hiding")


def test_wrappers_that_raise_later_are_left_out_alone(registry: Registry) -> None:
    registry.add(Hiding(error=RuntimeError("boom")), Source("my-dist:hiding", "1.0"))
    registry.add(Planners("stay"), Source("a:a"))
    assert registry.names("planner") == ("stay",)
    assert registry.broken == {Source("my-dist:hiding", "1.0"): "RuntimeError: boom"}
    assert not registry.manager.has_plugin("my-dist:hiding")


@pytest.mark.parametrize("options", [{"hookwrapper": True}, {"wrapper": True}], ids=str)
def test_a_wrapper_is_a_generator_function_of_the_new_style(
    registry: Registry, options: dict[str, Any]
) -> None:
    class Old:
        @hookimpl(**options)  # type: ignore[untyped-decorator]
        def star_planners(self) -> Any:
            return [offer("mine")]

    with pytest.raises(PluginError, match=r"star_planners: expected .* \[contract-broken\]"):
        registry.add(Old(), Source("my-dist:old"))
    assert registry.manager.get_plugins() == set()


@pytest.mark.parametrize("yields", [0, 2])
def test_a_wrapper_that_does_not_yield_once_is_left_out(registry: Registry, yields: int) -> None:
    class Odd:
        @hookimpl(wrapper=True)
        def star_planners(self) -> Generator[None, Any, Any]:
            for _ in range(yields):
                yield

    with pytest.raises((RuntimeError, StopIteration)):
        registry.add(Odd(), Source("my-dist:odd"))
    registry.add(Planners("stay"), Source("a:a"))
    assert registry.names("planner") == ("stay",)


def test_other_hooks_name_the_plugin_that_raises(registry: Registry) -> None:
    class Bad:
        @hookimpl
        def star_check(self) -> Iterable[Any]:
            yield 1 / 0

    registry.add(Bad(), Source("my-dist:bad", "1.0"))
    with pytest.raises(PluginError, match=r"^star_check of my-dist 1\.0:bad: Zero.*test_registry"):
        registry.manager.hook.star_check(mission=None, registry=registry)


class Grippers:
    """A plugin that adds the kind ``gripper``, and lists the names of grippers in a verb."""

    def __init__(self, record: type[Spec] = Spec) -> None:
        self._record = record

    @hookimpl
    def star_kinds(self) -> Iterable[KindSpec]:
        yield KindSpec(name="gripper", record=self._record)

    @hookimpl
    def star_tasks(self, registry: Registry) -> Iterable[TaskSpec]:
        summary = ", ".join(registry.names("gripper"))
        yield TaskSpec(name="grip", summary=summary, make=NEVER_MADE)


class Hand:
    """A plugin that offers a gripper."""

    @hookimpl
    def star_grippers(self) -> Iterable[Any]:
        yield Spec(name="hand", summary="A hand.")


class Wrong:
    """A plugin whose hook has another argument."""

    @hookimpl
    def star_grippers(self, hand: str) -> Iterable[Any]:
        return []


@pytest.mark.parametrize("plugins", [(Grippers(), Hand()), (Hand(), Grippers())], ids=["1", "2"])
def test_plugins_add_kinds_that_others_offer(plugins: tuple[object, ...]) -> None:
    registry = Registry(*plugins, installed=False)
    assert str(registry.find("gripper", "hand").source) == "tests.core.test_registry:Hand"
    assert registry.find("task", "grip").offer.summary == "hand"
    assert [kind for kind, _ in registry] == ["task", "gripper"]


def test_records_of_an_added_kind_have_its_class(registry: Registry) -> None:
    registry.add(Grippers(PlannerSpec), Source("a:grippers"))
    with pytest.raises(PluginError, match=r"star_grippers\(\) yields Spec, expected PlannerSpec"):
        registry.add(Hand(), Source("b:hand"))


def test_a_kind_is_added_once(registry: Registry) -> None:
    registry.add(Grippers(), Source("a:grippers"))
    with pytest.raises(PluginError, match="there is a kind 'gripper' already"):
        registry.add(Grippers(PlannerSpec), Source("b:others"))
    assert registry.names("task") == ("grip",)


@pytest.mark.parametrize("name", ["transport", "Gripper", "two words", ""])
def test_names_of_kinds_are_checked(registry: Registry, name: str) -> None:
    class Odd:
        @hookimpl
        def star_kinds(self) -> Iterable[KindSpec]:
            yield KindSpec(name=name, record=Spec)

    with pytest.raises(PluginError, match="kind"):
        registry.add(Odd(), Source("a:odd"))


def test_arguments_of_added_hooks_are_checked(
    registry: Registry, install: Callable[[str, str], None]
) -> None:
    registry.add(Grippers(), Source("a:grippers"))
    with pytest.raises(PluginError, match=r"star_grippers.*hand.*\[contract-broken\]"):
        registry.add(Wrong(), Source("b:wrong"))
    for name in ("a_star", "b_star"):  # registered before the kind is added
        install(name, "from star_core import hookimpl\n@hookimpl\ndef star_grippers(hand): ...")
    registry = Registry(Grippers())
    assert [source.plugin for source in registry.broken] == [
        "a_star-dist:a_star", "b_star-dist:b_star"
    ]  # fmt: skip
    assert "grip" in registry.names("task")


def test_a_generator_of_a_plugin_is_guarded_until_its_end(registry: Registry) -> None:
    def checks() -> Generator[int]:
        yield 1
        raise RuntimeError("boom")

    registry.add(Planners("theirs"), Source("their-dist:mine"))
    with pytest.raises(PluginError, match=r"planner 'theirs' .*: RuntimeError: boom"):
        guarded("planner", registry.find("planner", "theirs"), checks)


def test_a_command_that_panics_is_named(registry: Registry) -> None:
    def panic() -> None:
        raise asyncio.CancelledError("panic")

    registry.add(Planners("theirs"), Source("their-dist:mine"))
    with pytest.raises(PluginError, match=r"command 'theirs' .*: CancelledError: panic"):
        guarded("command", registry.find("planner", "theirs"), panic)


@pytest.mark.parametrize(("kind", "error"), [("command", SystemExit), ("planner", PluginError)])
def test_only_commands_exit(registry: Registry, kind: str, error: type[BaseException]) -> None:
    registry.add(Planners("theirs"), Source("their-dist:mine"))
    with pytest.raises(error):
        guarded(kind, registry.find("planner", "theirs"), sys.exit, 0)
