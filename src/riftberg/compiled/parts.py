"""Kernels that call kernels: what is called becomes a part of the machine code of its caller, and nothing else.

Numba makes machine code of a function for each signature as soon as a caller is compiled: a wrapper that takes its
arguments out of Python objects, code of its own beside the copy in its caller, and a file in the cache. A law that only
compiled code calls needs none of these, and for one that takes the state the wrapper alone is some thousand lines of
code. Here such a function is compiled as far as its caller needs it: types, and code of LLVM, optimised. What Python
calls is compiled as before.

The code that runs is the same: the caller takes up the same optimised code as it did.

A kernel that takes named tuples gets their fields one by one where Python calls it (`TupleKernel`). Numba looks at the types of
all arguments at each call, and takes ten times as long for an array inside of a tuple.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature
from numba.core.targetconfig import ConfigStack
from numba.core.types import Array, BaseTuple


class PartLibrary(JITCodeLibrary):
    """Code of LLVM that callers take up, of which no machine code is made."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return nothing: there is no machine code to point to."""
        return 0

    @property
    def codegen(self) -> Any:
        """What numba asks for to set the environment of a function, which is set with its caller's."""
        return _NoEnvironments()


class _NoEnvironments:
    def set_env(self, name: str, environment: object) -> None:
        """Leave it: the variable is not there before the caller's code is."""


class PartCompiler(Compiler):
    """Numba's compiler, into a `PartLibrary`."""

    def __init__(
        self, typingctx: Any, targetctx: Any, library: Any, args: Any, return_type: Any, flags: Any, locals: Any
    ) -> None:
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)
        self._own_library = library is None

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a function."""
        if self._own_library:
            self.state.library = PartLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class Kernel(CPUDispatcher):
    """A function that is compiled when it is called, from Python or as a part of another kernel."""

    _cache: Any
    _compiler: Any

    @cached_property
    def part(self) -> Any:
        """The same function as other kernels call it."""
        return self._as_part(counts=True)

    @cached_property
    def borrowing_part(self) -> Any:
        """The same function as kernels call it that count no references; see `riftberg.compiled.kernels.borrower`."""
        return self._as_part(counts=False)

    def _as_part(self, *, counts: bool) -> Any:
        counts = counts and self.targetoptions.get("_nrt", True)  # a borrower borrows whoever calls it
        options = {**self.targetoptions, "no_cpython_wrapper": True, "_nrt": counts}
        return CPUDispatcher(self.py_func, targetoptions=options, pipeline_class=PartCompiler)

    def _part_for_caller(self, arguments: Any) -> Any:
        """Return the part that suits a caller; a law of numbers is compiled but once."""
        caller = ConfigStack().top_or_none()
        if caller is None or caller.nrt:
            return self.part
        if any(map(_holds_arrays, arguments)):
            return self.borrowing_part
        self.part.compile(tuple(arguments))
        returned = self.part.overloads[tuple(arguments)].signature.return_type
        return self.borrowing_part if _holds_arrays(returned) else self.part

    def _compilation_chain_init_hook(self) -> None:
        """Leave out what other packages teach numba: kernels take numbers, arrays and tuples of them."""

    def compile(self, sig: Any) -> Any:
        """Compile for a signature, or load what was compiled; make the environments of its parts known."""
        with _without_collection():
            entry = super().compile(sig)
        compiled = self.overloads[tuple(normalize_signature(sig)[0])]
        for environment in compiled._find_referenced_environments():
            compiled.codegen.set_env(environment.env_name, environment)
        return entry

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile the part that a caller wants, and return its types."""
        return self._part_for_caller(self._compiler.fold_argument_types(args, kws)[1]).get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return the part that a caller has asked for."""
        return self._part_for_caller(normalize_signature(sig)[0]).get_overload(sig)

    @property
    def nopython_signatures(self) -> Any:
        """Signatures, of parts too."""
        parts = self.part, self.borrowing_part
        return [*super().nopython_signatures, *(known for part in parts for known in part.nopython_signatures)]


class TupleKernel(Kernel):
    """A kernel whose arguments may be named tuples."""

    _cache: Any

    def __call__(self, *arguments: Any) -> Any:
        """Call with the fields of named tuples as arguments of their own; by the classes of the arguments."""
        kinds = tuple(map(type, arguments))
        if kinds not in self._calls:
            self._calls[kinds] = self._call_by_fields(arguments)
        return self._calls[kinds](*arguments)

    @cached_property
    def _calls(self) -> dict[tuple[type, ...], Callable[..., Any]]:
        return {}

    def _call_by_fields(self, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        """Return a function that takes such arguments apart and calls a kernel that puts them together again."""
        # Code that is kept is found again by module and name.
        names: dict[str, Any] = {"kernel": self, "__name__": self.py_func.__module__}
        name = f"{self.py_func.__name__}_by_fields"
        given: list[str] = []  # the fields, as the function below finds them
        classes: list[str] = []  # named in the source, which stands for the code that is kept

        def put_together(value: Any, expression: str) -> str:
            if not hasattr(value, "_fields"):
                given.append(expression)
                return f"x{len(given) - 1}"
            kind = f"Kind{len(names)}"
            names[kind] = type(value)
            classes.append(f"# {kind}: {value.__class__.__qualname__} {value._fields}")
            fields = [put_together(field, f"{expression}[{k}]") for k, field in enumerate(value)]
            return f"{kind}({', '.join(fields)})"

        whole = [put_together(value, f"a{n}") for n, value in enumerate(arguments)]
        flat, own = ", ".join(f"x{k}" for k in range(len(given))), ", ".join(f"a{n}" for n in range(len(arguments)))
        text = f"def {name}({flat}):\n    return kernel({', '.join(whole)})\n" + "\n".join(classes)
        exec(text, names)
        by_fields = Kernel(names[name], targetoptions={**self.targetoptions, "inline": "never"})
        by_fields._cache = self._cache.of_caller(text)
        call: Callable[..., Any] = eval(f"lambda {own}: by_fields({', '.join(given)})", {"by_fields": by_fields})
        return call


@contextmanager
def _without_collection() -> Iterator[None]:
    """Leave the search for cycles of objects until later: numba makes millions that stay, and it took a sixth of its time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _holds_arrays(kind: Any) -> bool:
    parts: Any = kind if isinstance(kind, BaseTuple) else ()
    return isinstance(kind, Array) or any(map(_holds_arrays, parts))
