"""Kernels that call kernels: what is called becomes a part of the machine code of its caller, and nothing else.

Numba makes machine code of a function for each signature as soon as a caller is compiled: a wrapper that takes its
arguments out of Python objects, code of its own beside the copy in its caller, and a file in the cache. A law that only
compiled code calls needs none of these, and for one that takes the state the wrapper alone is some thousand lines of
code. Here such a function is compiled as far as its caller needs it: types, and code of LLVM, optimised. What Python
calls is compiled as before.

The code that runs is the same: the caller takes up the same optimised code as it did.

A kernel that takes named tuples reads them by itself where Python calls it (`TupleKernel`): numba takes some 0.1 us to hand over
an array, and three times as long for one inside of a tuple, a tenth of all that a berg of some hundred elements computes.
"""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, reduce
from typing import Any

from llvmlite import ir
from numba import boolean, int64, typeof
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature
from numba.core.targetconfig import ConfigStack
from numba.core.types import Array, BaseTuple
from numba.extending import intrinsic
from numpy import array, empty, ndarray


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


class UnlikeError(Exception):
    """Arguments are not of the types for which code was compiled."""


class TupleKernel(Kernel):
    """A kernel whose arguments may be named tuples; its code finds the arrays in them by itself (`_reader`)."""

    _cache: Any

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel by the address of its arguments."""
        number, call = self._latest
        try:  # nearly always they are of the classes of those before
            result = call(arguments) if number == len(arguments) else self._call_like(arguments)
        except (UnlikeError, IndexError, TypeError):
            result = self._call_like(arguments)
        return _owned(result) if self._returns_arrays else result

    def _call_like(self, arguments: tuple[Any, ...]) -> Any:
        """Call the code for arguments of these classes, which comes first at the next call."""
        kinds = tuple(map(type, arguments))
        call = self._calls.get(kinds) or self._call_with(kinds, arguments)
        try:
            result = call(arguments)
        except UnlikeError:  # of the same classes, but of other types within
            call = self._call_with(kinds, arguments)
            result = call(arguments)
        self._latest = len(arguments), call
        return result

    @cached_property
    def _latest(self) -> tuple[int, Callable[..., Any]]:
        return -1, self._call_like

    @cached_property
    def _calls(self) -> dict[tuple[type, ...], Callable[..., Any]]:
        return {}

    @cached_property
    def _variants(self) -> dict[tuple[Any, ...], Callable[..., Any]]:
        return {}

    @cached_property
    def _returns_arrays(self) -> bool:
        returned = str(self.py_func.__annotations__.get("return"))
        return any(name in returned for name in ("Floats", "Ints", "Booleans", "NDArray"))

    def _call_with(self, kinds: tuple[type, ...], arguments: tuple[Any, ...]) -> Callable[..., Any]:
        """Return a function that calls the kernel with such arguments, and note it for those of these classes."""
        # Code that is kept is found again by module and name.
        names: dict[str, Any] = {"kernel": self, "__name__": self.py_func.__module__}
        given, expected, classes = ["id(a)", "classes"], [], [id(True), id(False)]

        def taken(n: int, value: Any) -> str:
            """Return the source of an argument: read by its address, or handed over as it is."""
            if not isinstance(value, tuple | ndarray):
                given.append(f"a[{n}]")
                return f"x{len(given) - 1}"
            kind, loose = typeof(value), list(_loose(value, f"a[{n}]"))
            names[f"read{n}"] = _reader(kind, n, _hollow(value), len(classes))
            classes.extend(_classes(value))
            own = "".join(f"x{len(given) + k}, " for k in range(len(loose)))
            given.extend(loose)
            expected.append(f"# {loose} {_described(kind)}")
            return f"read{n}(x0, x1, ({own}))"

        whole = ", ".join([taken(n, value) for n, value in enumerate(arguments)])
        received = ", ".join(f"x{k}" for k in range(len(given)))
        # The source stands for the code that is kept, so it says what the readers expect. The name too: numba names machine
        # code by function, number in its process and types, which are addresses here. Two codes of one name that come from
        # two processes would be taken for each other.
        body = "\n".join([f"({received}):", f"    return kernel({whole})", *expected])
        name = f"{self.py_func.__name__}_by_address_{hashlib.sha256(body.encode()).hexdigest()[:8]}"
        text = f"def {name}{body}"
        key = text, *classes
        if key not in self._variants:
            exec(text, names)
            by_address = Kernel(names[name], targetoptions={**self.targetoptions, "inline": "never"})
            by_address._cache = self._cache.of_caller(text)
            known = array(classes)
            around = {"by_address": by_address, "known": known, "classes": known.ctypes.data}
            self._variants[key] = eval(f"lambda a: by_address({', '.join(given)})", around)
        self._calls[kinds] = self._variants[key]
        return self._variants[key]


def _is_read(value: Any) -> bool:
    """Whether compiled code can read a value in a tuple: whole numbers look otherwise in each version of Python."""
    return isinstance(value, ndarray) or type(value) in (float, bool)


def _loose(value: Any, expression: str) -> Iterator[str]:
    """Where the values stand that are to be handed over by themselves."""
    if isinstance(value, tuple):
        for n, field in enumerate(value):
            yield from _loose(field, f"{expression}[{n}]")
    elif not _is_read(value):
        yield expression


def _hollow(value: Any) -> Any:
    """Return a value of the same kind without the data of its arrays, which would be held as long as the code is."""
    if isinstance(value, ndarray):
        return empty((0,) * value.ndim, value.dtype)
    return tuple(map(_hollow, value)) if isinstance(value, tuple) else value


def _classes(value: Any) -> Iterator[int]:
    """Addresses of the classes of what compiled code reads of a value, in the order in which it does."""
    if isinstance(value, tuple | ndarray) or type(value) is float:
        yield id(type(value))
    for field in value if isinstance(value, tuple) else ():
        yield from _classes(field)


def _described(kind: Any) -> str:
    """Types of a tuple, with the names of its fields, whose order is frozen into code."""
    items: Any = kind if isinstance(kind, BaseTuple) else ()
    return f"{kind} {getattr(kind, 'fields', ())} ({', '.join(map(_described, items))})"


def _owned(result: Any) -> Any:
    """Return what a kernel returned; arrays that are views of its arguments, which nothing would keep alive, as copies."""
    if isinstance(result, tuple):
        return tuple(map(_owned, result))
    return result.copy() if isinstance(result, ndarray) and result.base is None else result


HEADER, ITEMS = object.__basicsize__, tuple.__basicsize__
"""Where in a tuple, an array or a number of Python its own part begins, and where the items of a tuple do, bytes."""


def _reader(kind: Any, place: int, sample: Any, first: int) -> Any:
    """Return a function for compiled code: it takes argument ``place`` out of the tuple at an address.

    Numba makes an object of its own of each array that Python hands over. Here type, layout and address are read where NumPy
    keeps them (``PyArrayObject_fields``, the same since NumPy 1.7); while a kernel runs its caller holds the tuple, whose items
    cannot change. `UnlikeError` is raised where an object is of another class, or an array is not of type ``kind``: nothing
    is read of an object before that is known. ``sample`` is such an argument; values in it that are no arrays and no plain
    numbers come one by one. ``first``: place of its own class among the addresses of classes at ``classes``.
    """

    @intrinsic
    def read(typing_context: Any, address: Any, classes: Any, loose: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            unlike = builder.append_basic_block("unlike")
            reading = _Reading(context, builder, unlike, arguments[1], first, loose, arguments[2])
            value = reading.item(arguments[0], place, kind, sample)
            with builder.goto_block(unlike):
                context.call_conv.return_user_exc(builder, UnlikeError, ())
            return value

        return kind(int64, int64, loose), generate

    return read


class _Reading:
    """Code of LLVM that reads objects of Python, or goes on at ``unlike``."""

    def __init__(
        self, context: Any, builder: Any, unlike: Any, classes: Any, first: int, loose_kinds: Any, loose: Any
    ) -> None:
        self.context, self.builder, self.unlike = context, builder, unlike
        self.classes, self.next_class = classes, first
        self.loose_kinds, self.loose, self.used = loose_kinds, loose, 0

    def load(self, address: Any, offset: int, bits: int = 64, *, number: bool = False) -> Any:
        """Return what stands in memory: a whole number, or a number with double precision."""
        kind = ir.DoubleType() if number else ir.IntType(bits)
        place = self.builder.add(address, ir.Constant(address.type, offset))
        return self.builder.load(self.builder.inttoptr(place, kind.as_pointer()))

    def equal(self, found: Any, wanted: Any) -> Any:
        """Return whether two whole numbers are equal."""
        wanted = ir.Constant(found.type, wanted) if isinstance(wanted, int) else wanted
        return self.builder.icmp_unsigned("==", found, wanted)

    def expect(self, *facts: Any) -> None:
        """Go on here where all of some facts are true."""
        going_on = self.builder.append_basic_block()
        self.builder.cbranch(reduce(self.builder.and_, facts), going_on, self.unlike)
        self.builder.position_at_end(going_on)

    def item(self, parent: Any, place: int, kind: Any, sample: Any) -> Any:
        """Return an item of the tuple at an address."""
        if not isinstance(sample, tuple) and not _is_read(sample):
            self.used += 1
            value = self.builder.extract_value(self.loose, self.used - 1)
            return self.context.cast(self.builder, value, self.loose_kinds[self.used - 1], kind)
        address = self.load(parent, ITEMS + 8 * place)
        if isinstance(sample, bool):
            true, false = (self.equal(address, self.load(self.classes, 8 * k)) for k in range(2))
            self.expect(self.builder.or_(true, false))
            return self.context.cast(self.builder, true, boolean, kind)
        self.expect(self.equal(self.load(address, HEADER - 8), self.load(self.classes, 8 * self.next_class)))
        self.next_class += 1
        if isinstance(sample, float):
            return self.load(address, HEADER, number=True)
        if isinstance(sample, ndarray):
            return self.array(address, kind, sample)
        self.expect(self.equal(self.load(address, HEADER), len(sample)))
        fields = [self.item(address, n, *each) for n, each in enumerate(zip(kind, sample, strict=True))]
        return self.context.make_tuple(self.builder, kind, fields)

    def array(self, address: Any, kind: Any, sample: Any) -> Any:
        """Return the array at an address."""
        from numba.np.arrayobj import make_array, populate_array  # takes long to load, and is needed only to compile

        wanted = {"C": 1, "F": 2, "A": 0}[kind.layout] | 0x100 | (0x400 if kind.mutable else 0)  # aligned, writeable
        type_of_items, flags = self.load(address, HEADER + 40), self.load(address, HEADER + 48, 32)
        self.expect(
            self.equal(self.load(address, HEADER + 8, 32), kind.ndim),
            self.equal(self.load(type_of_items, HEADER + 10, 8), ord(sample.dtype.byteorder)),
            self.equal(self.load(type_of_items, HEADER + 12, 32), sample.dtype.num),
            self.equal(self.builder.and_(flags, ir.Constant(flags.type, wanted)), wanted),
        )
        made, size = make_array(kind)(self.context, self.builder), ir.Constant(address.type, sample.itemsize)
        populate_array(
            made, self.builder.inttoptr(self.load(address, HEADER), made.data.type),
            [self.load(self.load(address, HEADER + 16), 8 * k) for k in range(kind.ndim)],
            [self.load(self.load(address, HEADER + 24), 8 * k) for k in range(kind.ndim)], size, None,
        )  # fmt: skip
        return made._getvalue()


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
