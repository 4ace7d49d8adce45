"""Compilation of inner loops by numba: once, kept on disk, never stale, with progress on stderr."""

from __future__ import annotations

import gc
import hashlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from pickle import UnpicklingError
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, NamedTuple, TypeVar, cast

import numpy as np
from numba import config, njit, types
from numba._dynfunc import make_function
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.environment import lookup_environment
from numba.core.event import Listener, register
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import NativeLowering
from numba.core.types.functions import BaseFunction
from numba.core.untyped_passes import DeadBranchPrune
from numba.extending import typeof_impl
from numpy.typing import NDArray

from star_core.toolkit.compile_time import compiling
from star_core.toolkit.progress import Progress

Function = TypeVar("Function", bound=Callable[..., Any])

STACK_SIZE: Final = 2**16 + 2**10  # values of 8 bytes: just over half of a chunk of 1 MiB
REPORT_PERIOD: Final = 1.5  # s, between two lines while a kernel is compiled


def compiled(function: Function) -> Function:
    """Return a kernel: `function`, compiled by numba at its first call, with its type as it was.

    Division follows IEEE 754 instead of Python: x / 0 is infinite or NaN. Sums are neither
    reordered nor fused with products, as numba's ``fastmath`` allows: which of them are depends on
    the processor and on what was compiled before, and so would the last digits of a flight. The
    machine code is kept on disk until the kernel changes, or a function or constant that it uses,
    whichever file that is in. Progress is reported on stderr.

    Args:
        function: Takes numbers and arrays. Branches under ``argument is None`` are compiled only
            when the argument is None, those under ``argument is not None`` only when it is not.
    """
    options: dict[str, Any] = {"no_cfunc_wrapper": True, **COMMON}
    kernel: Any = njit(**options)(function)
    if kernel is not function:  # as it is with NUMBA_DISABLE_JIT
        kernel._cache = _KernelCache(kernel)  # noqa: SLF001 -- what `cache=True` does
        kernel._compile_for_args = _with_large_stack(kernel._compile_for_args)  # noqa: SLF001
    return cast("Function", kernel)


def subroutine(function: Function) -> Function:
    """Return `function` for kernels to call; it is compiled, and kept on disk, as part of them.

    Called by Python it is interpreted: code that takes arguments from Python would be a sixth of
    the compiler's work. It is inlined everywhere: otherwise the linker chooses among copies that
    were optimized differently, and a flight that compiles kernels would differ in the last digits
    from one that loads them.

    Args:
        function: Takes numbers, arrays and tuples of them.
    """
    return cast("Function", _Subroutine(function))


def records(count: int, fields: np.dtype[np.void]) -> NDArray[np.void]:
    """Return (`count`,) records of zeros for kernels, in which fields are attributes of records.

    So they are where kernels are interpreted (``NUMBA_DISABLE_JIT=1``), too.
    """
    table = np.zeros(count, fields)
    interpreted: bool = config.DISABLE_JIT  # type: ignore[attr-defined]  # set when imported
    return table.view(np.recarray) if interpreted else table


class _Subroutine:
    """A function that is compiled where kernels call it, and interpreted elsewhere."""

    def __init__(self, function: Callable[..., Any]) -> None:
        options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        options |= {"forceinline": True, **COMMON}
        self.dispatcher: Any = njit(**options)(function)
        self.py_func = function
        update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class _PruneBranches(DeadBranchPrune):
    """Drops branches under ``argument is None`` also where the argument is an array or a record.

    Numba drops such a branch where the argument is None, or has a type of which it knows that it is
    not: one with a `literal_type`.
    """

    _name = "star_prune_branches"

    def run_pass(self, state: Any) -> bool:
        arguments, state.args = state.args, tuple(map(_known_type, state.args))
        pruned: bool = super().run_pass(state)  # type: ignore[no-untyped-call]
        state.args = arguments
        return pruned


class _KnownType(NamedTuple):
    """Stands for the type of an argument that is not None."""

    literal_type: Any


def _known_type(argument: Any) -> Any:
    return _KnownType(argument) if isinstance(argument, types.Array | types.Record) else argument


class _ComparableFlags(Flags):
    """Options of a compilation, equal where the same ones are set to the same values.

    Numba looks up each call of a built-in function in tables whose keys contain the flags, and
    compares them option by option, unset ones included: a tenth of the time of a first flight.
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return type(other) is _ComparableFlags and self._values == other._values

    def __hash__(self) -> int:
        return hash(_ComparableFlags)  # few differ in a process, and numba's own are all the same


class _SubroutineLibrary(JITCodeLibrary):
    """Optimized code of a subroutine, of which no machine code is made: kernels contain it."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class _Lowering(NativeLowering):
    """Lowers subroutines to code for kernels, and kernels to machine code."""

    _name = "star_lowering"

    def run_pass(self, state: Any) -> bool:
        context = state.targetctx
        state.flags.no_compile = state.flags.forceinline
        if state.flags.no_compile:
            name = state.func_id.func_qualname
            state.library = _SubroutineLibrary(context.codegen(), name)  # type: ignore[no-untyped-call]
        super().run_pass(state)  # type: ignore[no-untyped-call]
        library, lowered = state.library, state.cr
        if state.flags.no_compile:  # a function of address 0 stands for it in numba's tables
            module = lowered.fndesc.lookup_module()
            entry = make_function(module, name, "", 0, lowered.env, (library,))
            context.insert_user_function(entry, lowered.fndesc, [library])
            state.cr = lowered._replace(cfunc=entry)
        else:  # as when it is loaded from disk
            for variable in library._final_module.global_variables:  # noqa: SLF001 -- no other way
                environment = lookup_environment(variable.name)  # type: ignore[no-untyped-call]
                if environment is not None:
                    library.codegen.set_env(variable.name, environment)
        return True


class _KernelCompiler(CompilerBase):
    """Numba's compiler, with other passes and flags where its own do more than kernels need."""

    def __init__(self, *arguments: Any) -> None:
        *others, flags, types_of_locals = arguments
        super().__init__(*others, _ComparableFlags(flags), types_of_locals)  # type: ignore[call-arg, no-untyped-call]

    def define_pipelines(self) -> list[Any]:
        steps: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        steps.passes = [(REPLACED.get(step, step), text) for step, text in steps.passes]
        steps.finalize()
        return [steps]


REPLACED: Final = {DeadBranchPrune: _PruneBranches, NativeLowering: _Lowering}
COMMON: Final = {"error_model": "numpy", "pipeline_class": _KernelCompiler}  # options of `njit`


@typeof_impl.register(_Subroutine)
def _type_of_subroutine(value: _Subroutine, _context: Any) -> Any:
    return types.Dispatcher(value.dispatcher)


def _with_large_stack(function: Function) -> Function:
    """Return `function`, called so that the calls below it share one chunk of Python's data stack.

    Python allocates that stack in chunks of 16 KiB, by the operating system, and frees a chunk when
    the last call in it returns. Numba's compiler is deeply nested and crosses the end of a chunk
    again and again: half a million times, a third of the time of a first flight. For a frame that
    does not fit into a chunk, Python allocates one of the next power of two.
    """

    def call(*arguments: Any, **options: Any) -> Any:
        with _remembered_calls():
            return function(*arguments, **options)

    call.__code__ = call.__code__.replace(co_stacksize=STACK_SIZE)
    return cast("Function", call)


@contextmanager
def _remembered_calls() -> Iterator[None]:
    """Let the compiler remember which implementation each built-in function has for which types.

    For every call, and each ``+`` and ``[]``, numba tries one implementation after the other, and
    writes a message about each that does not fit: a tenth of the time of a first flight.
    """
    function_type: Any = BaseFunction
    before = function_type.get_call_type
    function_type.get_call_type = _call_type
    try:
        yield
    finally:
        function_type.get_call_type = before


def _call_type(function: Any, context: Any, arguments: Any, options: Any) -> Any:
    """Return the signature of a call, and note its implementation in the function's type."""
    flags = ConfigStack.top_or_none()  # type: ignore[no-untyped-call]
    key = function, context, tuple(arguments), tuple(options.items()), flags
    if key in _CALLS:
        signature, implementation = _CALLS[key]
        function._impl_keys[signature.args] = implementation  # noqa: SLF001 -- as numba does
        return signature
    signature = _GET_CALL_TYPE(function, context, arguments, options)
    _CALLS[key] = signature, function._impl_keys[signature.args]  # noqa: SLF001 -- likewise
    return signature


_CALLS: Final[dict[Any, tuple[Any, Any]]] = {}
_GET_CALL_TYPE: Final[Any] = BaseFunction.get_call_type


class _KernelCache(FunctionCache):
    """Numba's cache on disk, with keys that cover everything that a kernel is compiled from."""

    def __init__(self, kernel: Any) -> None:
        super().__init__(kernel.py_func)  # type: ignore[no-untyped-call]
        self._kernel = kernel

    @cached_property
    def _digest(self) -> str:
        return hashlib.sha256("\n".join(_sources(self._kernel, {})).encode()).hexdigest()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except (ImportError, AttributeError, EOFError, UnpicklingError):
            self.flush()  # type: ignore[no-untyped-call]  # modules of its types were renamed
            return None

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        key = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, self._digest)


def _sources(value: Any, functions: dict[FunctionType, None]) -> Iterator[str]:
    """Yield the code and the constants that a kernel is compiled from.

    Args:
        value: The kernel, or what it refers to; modules, types and built-in functions have no code.
        functions: Those found so far; the new ones are added.
    """
    if isinstance(value, _Subroutine):
        value = value.dispatcher
    if isinstance(value, Dispatcher):
        yield str(
            sorted(
                (name, sorted(map(str, option)) if isinstance(option, set) else str(option))
                for name, option in value.targetoptions.items()
            )
        )
        value = value.py_func
    if isinstance(value, FunctionType):
        if value not in functions:
            functions[value] = None
            cells = (cell.cell_contents for cell in value.__closure__ or ())
            enclosed = dict(zip(value.__code__.co_freevars, cells, strict=True))
            scope = value.__globals__ | enclosed | {"defaults": value.__defaults__}
            yield from _sources_of_code(value.__code__, value.__doc__, scope, functions)
    elif isinstance(value, tuple):
        for item in value:
            yield from _sources(item, functions)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, (bool, int, float, complex, str, np.generic, np.dtype)):
        yield repr(value)


def _sources_of_code(
    code: CodeType, doc: str | None, scope: dict[str, Any], functions: dict[FunctionType, None]
) -> Iterator[str]:
    """Yield the same for byte code, without its docstring."""
    yield code.co_code.hex()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _sources_of_code(constant, None, scope, functions)
        elif constant is not doc:
            yield repr(constant)
    for name in ("defaults", *code.co_names, *code.co_freevars):
        yield name
        value = scope.get(name)
        if isinstance(value, ModuleType):  # of what is used as in math.pi
            used = (getattr(value, attribute, None) for attribute in code.co_names)
            for constant in used:
                if not isinstance(constant, FunctionType):
                    yield from _sources(constant, functions)
        else:
            yield from _sources(value, functions)


class _CompilationReporter(Listener):
    """Reports on stderr which kernel is being compiled: at once, then every `REPORT_PERIOD`.

    The number of functions is that of all that a kernel may call; it need not call all of them.
    """

    def __init__(self) -> None:
        self._compiling: list[Any] = []  # dispatchers, each called by the one before it
        self._functions: dict[FunctionType, None] = {}
        self._done: set[FunctionType] = set()
        self._progress: Progress | None = None
        self._collects = True

    def on_start(self, event: Any) -> None:
        dispatcher = event.data["dispatcher"]
        if not self._compiling:
            self._collects = gc.isenabled()
            gc.disable()  # saves a tenth of the time
        if not self._compiling and isinstance(dispatcher._cache, _KernelCache):  # noqa: SLF001
            kernel = dispatcher.py_func
            self._functions, self._done = {}, set()
            deque(_sources(kernel, self._functions), maxlen=0)
            name = f"{kernel.__module__.partition('.')[0]}.{kernel.__name__}"
            self._progress = Progress(
                "compiling kernels (once)",
                len(self._functions),
                detail=lambda: (
                    f"{name}, {len(self._done)} of up to {len(self._functions)} functions"
                ),
                period=REPORT_PERIOD,
                announced=True,
            ).__enter__()
        self._compiling.append(dispatcher)

    def on_end(self, event: Any) -> None:
        function = self._compiling.pop().py_func
        if function in self._functions:
            self._done.add(function)
        if self._progress is not None:
            self._progress.done = len(self._done)
        if not self._compiling:
            if self._progress is not None:
                self._progress.__exit__()
                self._progress = None
            gc.freeze()  # the garbage of the compiler becomes old: to search it now for what can
            gc.unfreeze()  # be freed would be a tenth of the time, at 150 MB less
            if self._collects:
                gc.enable()


class _CompileTimeListener(Listener):
    """Measures the time that numba compiles, whatever it compiles."""

    def on_start(self, _event: Any) -> None:
        compiling.begin()

    def on_end(self, _event: Any) -> None:
        compiling.end()


register("numba:compile", _CompilationReporter())  # type: ignore[no-untyped-call]
register("numba:compiler_lock", _CompileTimeListener())  # type: ignore[no-untyped-call]
