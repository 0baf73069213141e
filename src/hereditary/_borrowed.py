"""Arrays that compiled code looks at without owning them.

numba counts the references to an array wherever a view of it is taken or a function that may raise
is handed it, each time by an atomic addition that takes as long as twenty others. Arrays that the
caller keeps alive need no count.
"""

from typing import Any

from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def _borrowed(typing_context, value):
    """Return arrays without the counters of their references."""

    def codegen(context, builder, signature, arguments):
        return _uncounted(context, builder, value, arguments[0])

    return value(value), codegen


def _uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return a value of a type with all arrays in it uncounted."""
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        for place, part in enumerate(parts):
            own = builder.extract_value(value, place)
            own = _uncounted(context, builder, part, own)
            value = builder.insert_value(value, own, place)
    elif isinstance(kind, types.Array):
        found = context.make_array(kind)(context, builder, value)
        found.meminfo = cgutils.get_null_value(found.meminfo.type)
        found.parent = cgutils.get_null_value(found.parent.type)
        value = found._getvalue()
    return value


def _itself(value):
    """Return the value, where nothing is compiled."""
    return value


# borrowed(value): an array, or a tuple of some, not to be kept beyond the life of their owner
borrowed: Any = _itself if config.DISABLE_JIT else _borrowed  # type: ignore[attr-defined]
