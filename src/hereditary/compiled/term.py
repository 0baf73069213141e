"""Steps of a memory term whose equation another program solves."""

from .block import open_block
from .jit import I8, IVEC, MAT, VEC, entry
from .signatures import EXCHANGE, MEMORY, TABLES


@entry(MAT, MAT, I8, IVEC, MAT, EXCHANGE, TABLES, MEMORY)
def open_lag(lag, pieces, n, groups, weights, exchange, tables, memory):
    """Set the lag (W, B) of the block from step n on, and move the newest piece to its front."""
    open_block(lag, pieces, n, groups, weights, exchange, tables, memory)


@entry(I8, VEC, VEC, MAT, MAT)
def close_piece(p, weights, piece, lag, pieces):
    """Keep the piece (W,) of step p in its block, and spread it over the steps ahead."""
    for c in range(piece.shape[0]):
        pieces[c, p + 1] = piece[c]
        for k in range(2, lag.shape[1] - p):
            lag[c, p + k] += weights[k] * piece[c]
