"""Kernel compiler: a function that compiled functions call becomes instructions for them, and nothing more.

Numba optimises each function with all those that it calls, makes machine code and wrappers of it, and does so
again in each caller. Of the kernels of the lab, only those that Python calls need machine code. All others
stay instructions of LLVM, which are linked into the kernel that Python calls, and optimised there once. A
kernel that needs another optimisation than its callers is optimised before.

`NativeLowering`, `JITCodeLibrary` and `CPUDispatcher` are Numba's own classes, not a public interface; the
tests check what is built on them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, cast

import numba
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, _LowerResult
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import InlineOverloads, NativeLowering, NopythonRewrites
from numba.core.untyped_passes import (
    FindLiterallyCalls,
    InlineClosureLikes,
    LiteralPropagationSubPipelinePass,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    RewriteDynamicRaises,
    WithLifting,
)

from lab.base.compiling.compiled_cache import compile_cached

WITHOUT_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a kernel that no Python and no C calls."""

UNUSED = {
    FindLiterallyCalls,
    InlineClosureLikes,
    InlineOverloads,
    LiteralPropagationSubPipelinePass,
    LiteralUnroll,
    MakeFunctionToJitFunction,
    NopythonRewrites,
    RewriteDynamicRaises,
    WithLifting,
}
"""Steps for what no kernel has: functions within functions, expressions of whole arrays, loops over tuples of
several types, messages of exceptions that are computed, and `with`."""

_unliteral: Callable[[Any], Any] = types.unliteral


class _Instructions(JITCodeLibrary):
    """The instructions of a kernel with those that it calls, which are never executed from here."""

    def finalize(self) -> None:
        """Take in what the kernel calls."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._complete()
        self._finalized = True

    def _complete(self) -> None:
        """Do what remains to do when all is there: nothing."""


class _OptimisedInstructions(_Instructions):
    """The instructions of a kernel that are optimised before its callers get them."""

    def _complete(self) -> None:
        """Optimise them."""
        self._optimize_final_module()


@register_pass(mutates_CFG=True, analysis_only=False)
class _ToInstructions(NativeLowering):
    """The last step of the compilation of a kernel."""

    _name = "lowering_to_instructions"
    library: type[_Instructions] = _Instructions

    def run_pass(self, state: Any) -> bool:
        """Write the instructions, and tell Numba where they are."""
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        made = state["cr"]
        entry = object()  # stands for the machine code: what identifies the kernel in a caller
        state.targetctx.insert_user_function(entry, made.fndesc, [state.library])
        state["cr"] = _LowerResult(made.fndesc, made.call_helper, cfunc=entry, env=made.env)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class _ToOptimisedInstructions(_ToInstructions):
    """The last step for a kernel that is optimised apart."""

    _name = "lowering_to_optimised_instructions"
    library = _OptimisedInstructions


class _Compiler(CompilerBase):
    """Numba's compiler with fewer steps, and another last one."""

    last = _ToInstructions

    def define_pipelines(self) -> list[PassManager]:
        """Return the one list of steps."""
        own = PassManager("kernel")
        for step, what in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if step not in UNUSED:
                own.add_pass(self.last if step is NativeLowering else step, what)
        own.finalize()
        return [own]


class _CompilerApart(_Compiler):
    """The compiler of a kernel that is optimised apart."""

    last = _ToOptimisedInstructions


class Kernel(CPUDispatcher):
    """A function that kernels call.

    A kernel that Python calls, as the reference does, is compiled a second time, as Numba does.
    """

    def __init__(self, function: Any, options: dict[str, Any], *, apart: bool = False) -> None:
        compiler = _CompilerApart if apart else _Compiler
        super().__init__(function, targetoptions=options | WITHOUT_WRAPPERS, pipeline_class=compiler)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function from Python."""
        return self.for_python(*arguments)

    @functools.cached_property
    def for_python(self) -> Callable[..., Any]:
        """The function compiled for callers in Python, at the first call; one of the lab is kept on disk."""
        called = {name: value for name, value in self.targetoptions.items() if name not in WITHOUT_WRAPPERS}
        if self.py_func.__module__.startswith("lab."):
            return cast(Callable[..., Any], compile_cached(self.py_func, called))
        return cast(Callable[..., Any], numba.jit(**called)(self.py_func))

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return what a call in a kernel needs; a number as an argument is a variable, not a constant.

        Otherwise Numba compiles a function for each constant with which it is called. A function that is
        inlined gets its constants all the same.
        """
        return super().get_call_template([_unliteral(kind) for kind in args], kws)

    def add_overload(self, compiled: Any) -> None:
        """Keep what was compiled for some types of arguments; there is no machine code to register."""
        self.overloads[tuple(compiled.signature.args)] = compiled
