"""For kernels: an address, as `pacnet.engine.Memory` hands it over, as a pointer.

A kernel indexes a pointer as it would an array; numba neither counts who holds it nor tests whether
an index counts from the end.
"""

from __future__ import annotations

from typing import Any

from numba import extending, types

_intrinsic: Any = extending.intrinsic  # a type checker would miss the arguments that numba fills in


def _pointer_to(element):
    @_intrinsic
    def pointer(_typing, _address):
        def generate(context, builder, signature, arguments):
            kind = context.get_value_type(signature.return_type)
            return builder.inttoptr(arguments[0], kind)

        return types.CPointer(element)(types.int64), generate

    return pointer


floats = _pointer_to(types.float32)
doubles = _pointer_to(types.float64)
integers = _pointer_to(types.int64)
