"""Types of the function values and array groups that marches and histories exchange (floor 1).

A march advances in blocks of B steps over W columns. Between two blocks it hands the finished
block's pieces to the history and gets the lag of everything older than the next one. Every history
offers one such function, with its own tables and memory behind it as 2-D arrays: marches and
histories are compiled once each and pair freely.
"""

from numba import types

from .._jit import CUBE, F8, I8, IVEC, JAC_SIG, MAT, RHS_SIG, VEC

RHS = types.FunctionType(RHS_SIG)
JAC = types.FunctionType(JAC_SIG)

TABLES = types.UniTuple(MAT, 5)
MEMORY = types.UniTuple(MAT, 3)
# lag (W, B), pieces (W, B + 1), first step of the block, class of each column (W,), tables, memory:
# takes all pieces but the last into memory (none at step 0), adds to lag
EXCHANGE_SIG = types.void(MAT, MAT, I8, IVEC, TABLES, MEMORY)
EXCHANGE = types.FunctionType(EXCHANGE_SIG)

# what a march works on: numbers, layout [components d of the orbit, blocks between Jacobians (0:
# none)], class of each column, flags, weights and start weights inside a block, rows of constants
# for the columns; and what a march changes. What they hold is told at each march. The W columns are
# the d components of the orbit, then those of one tangent after the other; all of the state but
# the counters is linear in the tangents.
SCHEME = types.Tuple((VEC, IVEC, IVEC, IVEC, MAT, MAT, MAT))
STATE = types.Tuple((IVEC, VEC, VEC, VEC, MAT, MAT, MAT, MAT))
OUTPUT = types.Tuple((VEC, MAT, MAT, CUBE))
MARCH = (RHS, JAC, I8, VEC, EXCHANGE, TABLES, MEMORY, SCHEME, STATE, OUTPUT, I8)

# The same on meshes of any steps: lag (W,), newest piece (2, W), pieces so far, time seen from,
# class of each column, tables, memory; stores the piece and sets lag
RECALL_SIG = types.void(VEC, MAT, I8, F8, IVEC, TABLES, MEMORY)
RECALL = types.FunctionType(RECALL_SIG)
MESH_SCHEME = types.Tuple((VEC, VEC, IVEC, IVEC, MAT, MAT, MAT, VEC, VEC))
MESH_STATE = types.Tuple((IVEC, VEC, VEC, MAT))
MESH_OUTPUT = types.Tuple((VEC, MAT, MAT))
MESH_MARCH = (
    RHS, JAC, I8, VEC, RECALL, TABLES, MEMORY, MESH_SCHEME, MESH_STATE, MESH_OUTPUT, I8
)  # fmt: skip
