"""Records of a march, passed by reference: one pointer instead of all their arrays.

All data of a march are one NamedTuple m. Its fields are numbers, arrays, functions and further
NamedTuples. Python makes m, and `by_reference` checks the types of its fields. A compiled loop (an
`entry` of compiled/jit.py) gets it as an argument of type `Reference`, and passes the pointer to
the functions it calls. In compiled code ``m.orbit`` is a reference to a part of the record, and
``m.orbit.modes`` is an array. Compiled code reads the record again at each attribute. So read an
array into a variable before a loop.

- The record is on the stack frame of the entry. It is filled when the entry starts, and is gone
  when the entry returns. No compiled function stores a reference, and none sets a field.
- The NamedTuple in Python keeps the arrays alive until the entry returns. Compiled code counts no
  references to them. Therefore Python must make the arrays.
- In compiled code a function is a field of type `FunctionField`, the address of its machine code.
  In Python the field is the compiled function itself.

If numba compiles nothing, `by_reference` returns the NamedTuple, and the same source reads it.
"""

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import cgutils
from numba.core.typing import signature as signature_of
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    unbox,
)
from numba.np.numpy_support import as_dtype


class Reference(types.Type):
    """numba's type of a reference to a record; `record` is numba's type of its NamedTuple class."""

    def __init__(self, record):
        self.record = record
        super().__init__(name=f"Reference({record.instance_class.__name__})")

    @property
    def key(self):
        """The type of the record: two types of references are equal if their records are."""
        return self.record


class FunctionField(types.Callable, types.Opaque):
    """numba's type of a function in a record: the address of machine code for one signature."""

    def __init__(self, signature):
        self.signature = signature
        super().__init__(name=f"FunctionField({signature})")

    def get_call_type(self, context, args, kws):
        """Return the signature if numba can convert the arguments to it; None otherwise."""
        wanted = self.signature
        if kws or len(args) != len(wanted.args):
            return None
        if any(context.can_convert(*pair) is None for pair in zip(args, wanted.args, strict=True)):
            return None
        return signature_of(wanted.return_type, *wanted.args, recvr=self)

    def get_call_signatures(self):
        """Return a list of the only signature, and False: it has no type parameters."""
        return [self.signature], False

    def get_impl_key(self, sig):
        """Return the key under which `_call` is registered with numba."""
        return FunctionField


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        pointed = manager.lookup(kind.record).get_value_type()
        super().__init__(manager, kind, pointed.as_pointer())


register_model(FunctionField)(models.OpaqueModel)


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, typ, attr):  # type: ignore[override]
        if attr in typ.record.fields:
            kind = _field_type(typ.record, attr)
            return Reference(kind) if isinstance(kind, types.BaseNamedTuple) else kind
        return None


def _field_type(record, name):
    return tuple(record)[record.fields.index(name)]


@lower_getattr_generic(Reference)
def _read(context, builder, typ, value, name):
    """Emit code for ``reference.name``: the address of a part of the record, or a field's value."""
    kind = _field_type(typ.record, name)
    place = cgutils.gep_inbounds(builder, value, 0, typ.record.fields.index(name))
    if isinstance(kind, types.BaseNamedTuple):
        return place
    field = builder.load(place)
    if context.enable_nrt:  # because the caller decrements it
        context.nrt.incref(builder, kind, field)
    return field


@lower_builtin(FunctionField, types.VarArg(types.Any))
def _call(context, builder, sig, args):
    """Emit a call of the machine code at an address; an exception in it propagates."""
    convention, (_, *kinds) = context.call_conv, sig.args
    pointer = convention.get_function_type(sig.return_type, kinds).as_pointer()
    function = builder.bitcast(args[0], pointer)
    status, result = convention.call_function(builder, function, sig.return_type, kinds, args[1:])
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return result


@unbox(FunctionField)
def _address(typ, function, c):
    """Emit code that reads the address of a function from a Python object."""
    address = c.pyapi.object_getattr_string(function, "address")
    place = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(place, is_error=c.pyapi.c_api_error())


@unbox(Reference)
def _fill(typ, filled, c):
    """Emit code, without references, that makes a record on the caller's frame from a `Filled`."""
    place = cgutils.alloca_once(c.builder, c.context.get_value_type(typ.record))
    record = c.pyapi.object_getattr_string(filled, "record")
    c.pyapi.decref(record)  # `filled` keeps it alive
    _fill_part(c, typ.record, record, place)
    return NativeValue(place, is_error=c.pyapi.c_api_error())


def _fill_part(c, record, values, place):
    """Emit code that fills the part of a record at `place` from a NamedTuple."""
    for number, kind in enumerate(record):
        value = c.pyapi.tuple_getitem(values, number)
        at = cgutils.gep_inbounds(c.builder, place, 0, number)
        if isinstance(kind, types.BaseNamedTuple):
            _fill_part(c, kind, value, at)
        elif isinstance(kind, types.Array):
            arguments = value, c.builder.bitcast(at, c.pyapi.voidptr)
            ftype = ir.FunctionType(ir.IntType(32), [argument.type for argument in arguments])
            adapt = cgutils.get_or_insert_function(c.builder.module, ftype, "numba_adapt_ndarray")
            c.builder.call(adapt, arguments)
        else:
            native = c.unbox(kind, value)
            c.builder.store(native.value, at)
            if native.cleanup:
                native.cleanup()


class Filled:
    """A NamedTuple with checked fields: the argument of a compiled entry, of the type `kind`."""

    def __init__(self, record, kind):
        if type(record) is not _checked_class(kind.record.instance_class):
            _check(record, _form_of(kind.record))
        self.record, self._numba_type_ = record, kind


def by_reference(record, kind):
    """Return a NamedTuple as an argument for an entry; `kind` is the `Reference` type of it."""
    return record if config.DISABLE_JIT or isinstance(record, Filled) else Filled(record, kind)


def as_checked(record, kind):
    """Return a record, a NamedTuple, with its fields checked once and for all."""
    # Its class tells entries that they need not check it again; `_replace` returns one that is.
    # kind: numba's type of the NamedTuple.
    if config.DISABLE_JIT:
        return record
    _check(record, _form_of(kind))
    return tuple.__new__(_checked_class(kind.instance_class), record)


@cache
def _checked_class(cls):
    return type(cls.__name__, (cls,), {"__slots__": (), "_make": cls._make})


# The `_form` of each NamedTuple class, which has one type; numba's types take 5 us to hash.
_FORMS_OF_RECORDS: dict[type, list[Any]] = {}


def _form_of(kind) -> list[Any]:
    """Return the `_form` of a type of records, made once."""
    if kind.instance_class not in _FORMS_OF_RECORDS:
        _FORMS_OF_RECORDS[kind.instance_class] = _form(kind)
    return _FORMS_OF_RECORDS[kind.instance_class]


def _form(kind) -> list[Any]:
    """List (name, type, how, like) of each field of a record, for `_check`."""
    # how and like are None and Python classes for a number; dtype and number of axes for an array;
    # an attribute and its value for a structured record or a function; the class of a checked one
    # and its list for a record inside
    entries: list[Any] = []
    for name, wanted in zip(kind.fields, kind, strict=True):
        like: Any = None, ((int,) if wanted == types.int64 else (int, float))
        if isinstance(wanted, types.BaseNamedTuple):
            like = _checked_class(wanted.instance_class), _form(wanted)
        elif isinstance(wanted, types.Array):
            like = as_dtype(wanted.dtype), wanted.ndim
        elif isinstance(wanted, types.Record):
            like = "dtype", as_dtype(wanted)
        elif isinstance(wanted, FunctionField):
            like = "of_signature", wanted.signature
        entries.append((f"{kind.instance_class.__name__}.{name}", wanted, *like))
    return entries


def _check(record, entries):
    """Raise TypeError if a field of a NamedTuple does not fit its entry in the list of `_form`."""
    for value, (name, wanted, key, like) in zip(record, entries, strict=True):
        if type(value) is np.ndarray:  # most fields
            fits = value.ndim == like and value.flags.c_contiguous
            fits = fits and (value.dtype is key or value.dtype == key)
        elif type(like) is list:
            fits = type(value) is key or _check(value, like) is None
        elif key is None:
            fits = type(value) in like or isinstance(value, like)
        else:
            attribute = getattr(value, key, None) if type(key) is str else None
            fits = attribute is like or attribute == like
        if not fits:
            raise TypeError(f"{name} must be of type {wanted}, not {value!r}")
