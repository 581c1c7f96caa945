"""Kernels in two parts: the function, which other kernels take over as it is, and machine code for calls from Python.

numba compiles every function to machine code with a wrapper for Python, and optimises all that it calls again with each
caller. Here a function stays in LLVM's intermediate form until Python calls it, or a kernel that calls it. Machine code
then holds that of the functions it calls, except long ones, which are apart: their machine code is called by its name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from typing import Any

from llvmlite import binding
from numba import njit
from numba.core import compiler as numba_compiler
from numba.core import typeinfer
from numba.core.codegen import JITCodeLibrary
from numba.core.environment import Environment
from numba.core.types.functions import BaseFunction

# numba's types are not those of its own declarations
CompileResult: Any = numba_compiler.CompileResult


class _Library(JITCodeLibrary):
    """Functions that are compiled to machine code only if Python calls one of them.

    Attributes
    ----------
    apart : bool
        Whether others call the machine code of this library's function, instead of taking the function over.
    exported : str or None
        The function that machine code of other libraries calls.
    """

    apart = False
    exported: str | None = None

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is not None:
            return self._shared_module
        if self._finalized:
            return super()._get_module_for_linking()
        module = self._final_module.clone()
        # functions that a user's numba has compiled before are not ours, and none of them is apart
        taken = (each for each in self._linking_libraries if not getattr(each, "apart", False))
        for library in dict.fromkeys(taken):
            self._reload_init.update(library._reload_init)
            module.link_in(library._get_module_for_linking(), preserve=True)
        for function in module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = "linkonce_odr"
        self._shared_module = module
        return module

    def _optimize_final_module(self) -> None:
        if self.exported is not None:
            self._final_module.get_function(self.exported).linkage = "external"
        super()._optimize_final_module()

    @property
    def has_dynamic_globals(self) -> bool:
        return any(each.name.startswith("numba.dynamic.globals") for each in self._final_module.global_variables)


class _Flags(numba_compiler.Flags):
    """Options of a compilation, compared quickly: numba looks them up with every function that it resolves."""

    __slots__ = ()

    def __hash__(self) -> int:
        return len(self._values)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, numba_compiler.Flags) and self._values == other._values)


# numba's functions, each with the signature found for some types of arguments
_signatures: dict[tuple[int, Any], tuple[Any, Any]] = {}
_find_signature: Any = BaseFunction.get_call_type


def _kept_signature(function: Any, context: Any, arguments: Any, named: Any) -> Any:
    if named:
        return _find_signature(function, context, arguments, named)
    key = (id(function), arguments)
    if key not in _signatures:
        # the function is kept, so that no other one takes its place in memory
        _signatures[key] = function, _find_signature(function, context, arguments, named)
    return _signatures[key][1]


@contextmanager
def _signatures_kept() -> Iterator[None]:
    """Let numba look once only for the signature of a function with given types: each time it tries many templates."""
    before = BaseFunction.get_call_type
    setattr(BaseFunction, "get_call_type", _kept_signature)  # noqa: B010
    try:
        yield
    finally:
        setattr(BaseFunction, "get_call_type", before)  # noqa: B010


class _Function:
    """Stands for the function of a kernel where numba expects what Python calls."""


@contextmanager
def lazy_libraries(codegen: Any) -> Iterator[None]:
    """Let numba make libraries of this module until the end of the block; others compile under the same lock."""
    before = codegen._library_class
    codegen._library_class = _Library
    try:
        yield
    finally:
        codegen._library_class = before


def function_dispatcher(function: Callable[..., Any], options: dict[str, Any], cache: Any, number: int | None) -> Any:
    """Return the dispatcher of a function that other kernels call, and Python does not.

    A number is given to one whose machine code others call, in every process the same: it is part of its name there.
    """

    class Numbered(numba_compiler.Compiler):
        def _compile_bytecode(self) -> Any:
            if number is not None:
                self.state.func_id.unique_id = number
            return super()._compile_bytecode()

    options = {**options, "no_cpython_wrapper": True}
    made: Any = njit(**options, pipeline_class=Numbered)(function)
    compiler, context = made._compiler, made.targetctx

    def customise(flags: Any) -> Any:
        flags.no_compile = True
        return _Flags(flags)

    def compile_function(arguments: Any, result: Any) -> Any:
        found = type(compiler).compile(compiler, arguments, result)._replace(entry_point=_Function())
        context.insert_user_function(found.entry_point, found.fndesc, [found.library])
        return found

    def add_overload(found: Any) -> None:
        found.library.apart = number is not None
        made.overloads[tuple(found.signature.args)] = found

    compiler._customize_flags, compiler.compile = customise, compile_function
    made.add_overload = add_overload
    made._cache = cache
    return made


def entry_dispatcher(
    function: Callable[..., Any],
    options: dict[str, Any],
    cache: Any,
    callee: Callable[[], Any],
    nogil: bool,
    apart: bool,
) -> Any:
    """Return the dispatcher that Python calls; where machine code is not in the cache it is made from the `callee`.

    Machine code of other kernels may call the function too if it is `apart`.
    """
    made: Any = njit(**options, nogil=nogil)(function)
    context = made.targetctx.subtarget(enable_nrt=bool(options["_nrt"]))

    def compile_entry(arguments: Any, result: Any) -> Any:
        inner = callee().overloads[tuple(arguments)]
        library = context.codegen().create_library(inner.library.name)
        library.enable_object_caching()
        library.add_linking_library(inner.library)
        library.exported = inner.fndesc.llvm_func_name if apart else None
        # several libraries hold the function, and each but this one would hide the environment of its name
        description = copy(inner.fndesc)
        description.env_name = f"{inner.fndesc.env_name}.entry"
        environment = Environment.from_fndesc(description)
        with context.push_code_library(library):
            context.create_cpython_wrapper(library, description, environment, None, release_gil=nogil)
        entry = context.get_executable(library, description, environment)
        found = inner._replace(
            entry_point=entry, library=library, fndesc=description, environment=environment, metadata={}
        )
        return found

    made._compiler.compile = compile_entry
    made._cache = cache
    return made


def reduced(found: Any) -> tuple[Any, ...]:
    """Return what a cache keeps of a function that Python does not call."""
    found.fndesc.typemap = found.fndesc.calltypes = None
    module = found.library._get_module_for_linking()
    return found.library.name, module.as_bitcode(), found.fndesc, found.environment, found.signature, found.reload_init


def rebuilt(context: Any, kept: tuple[Any, ...]) -> Any:
    """Return the function of which `reduced` was kept."""
    name, code, description, environment, signature, reload_init = kept
    for function in reload_init:
        function()
    library = _Library(context.codegen(), name)
    library._shared_module = binding.parse_bitcode(code)
    return _result(
        context, entry_point=_Function(), signature=signature, fndesc=description, library=library,
        environment=environment, reload_init=reload_init,
    )  # fmt: skip


def reduced_entry(found: Any) -> tuple[Any, ...]:
    """Return what a cache keeps of a function that Python calls: machine code, and nothing that kernels take over."""
    environments = tuple(found._find_referenced_environments())
    code = found.library._get_compiled_object()
    return found.library.name, code, found.fndesc, found.environment, found.signature, found.reload_init, environments


def rebuilt_entry(context: Any, kept: tuple[Any, ...]) -> Any:
    """Return the function of which `reduced_entry` was kept."""
    name, code, description, environment, signature, reload_init, environments = kept
    for function in reload_init:
        function()
    codegen = context.codegen()
    library = _Library(codegen, name)
    library.enable_object_caching()
    library._set_compiled_object(code)
    library._finalize_final_module()
    # numba looks only for symbols that it has seen in a module
    codegen._engine._defined_symbols.add(description.llvm_cpython_wrapper_name)
    entry = context.get_executable(library, description, environment)
    for each in environments:
        codegen.set_env(each.env_name, each)
    return _result(
        context, entry_point=entry, signature=signature, fndesc=description, library=library, environment=environment,
        reload_init=reload_init, referenced_envs=environments,
    )  # fmt: skip


def _result(context: Any, **known: Any) -> Any:
    """Return numba's result of compiling, of which a few fields are read."""
    empty = dict.fromkeys(CompileResult._fields)
    fields = {**empty, "objectmode": False, "lifted": (), "type_annotation": "", **known}
    return CompileResult(**{**fields, "typing_context": context.typing_context, "target_context": context})


def compile_now(dispatcher: Any, signature: Any) -> None:
    """Compile a dispatcher for a signature, or read it from its cache, and for no other one after that."""
    codegen = dispatcher.targetctx.codegen()
    with typeinfer.register_dispatcher(dispatcher), lazy_libraries(codegen), _signatures_kept():
        dispatcher.compile(signature)
    dispatcher.disable_compile()
