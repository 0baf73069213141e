"""Signs of instability in a march's own steps: lasting zigzags, growing turns.

Each component of the orbit has a record (`MONITOR`, compiled/signatures.py). Nothing is done
between turns: most orbits seldom turn.
"""

from ..compiled.jit import inner

# Steps of unbroken alternation after which the amplitude is compared with that of the batch
# before. A resolved oscillation never alternates twice in a row; at 0.99 of the step limit the
# undamped classical oscillator alternates for 16 steps, and every damped one shrinks.
ZIGZAG_WINDOW = 64
# An alternation is sustained if its amplitude keeps at least this fraction from one batch to the
# next.
ZIGZAG_KEPT = 0.98
# An alternation below this fraction of the solution is rounding.
ZIGZAG_FLOOR = 1e-9
# Increments below this are hardly floats, and count as rounding too.
SMALLEST_CHANGE = 1e-300
# Number of steps after which a large alternation is sustained: it needs fewer steps to spoil the
# solution.
SHORT_WINDOW = 16
# Least ratio of the smallest to the largest increment in these steps. At 0.999 of its limit,
# increments of the undamped oscillator still differ by a tenth.
SHORT_ALIKE = 0.95
# An alternation is large from this fraction of the solution on.
LARGE = 0.05
# Growth of changes at turns that is an instability, from one turn to the next within QUICK steps.
# At 0.99 of its limit changes of the undamped oscillator grow and shrink by ten.
GROWN = 30.0
# Growth of changes at turns that is an instability if turns take longer. The growth of beats is at
# most their number.
LONG_GROWN = 1e3
# Most steps between two turns that count as quick.
QUICK = 3.0
# Largest growth that counts at one turn, so that a jump of the force is no growth.
FASTEST = 3.2
# Most steps between two turns that a scheme of first order does not resolve: a period has up to 22.
SLOWEST = 11.0


@inner
def watch_turn(own, change, increment, size, slowest, counts):
    """Look at a turn of a component's increments; more than `slowest` steps apart are resolved.

    counts.zigzag becomes the step at which a zigzag has lasted, counts.growth that at which turns
    have grown.
    """
    change, increment, size, n = abs(change), abs(increment), abs(size), float(counts.step)
    length, before = n - own.turned, own.change
    growth = 1.0
    if length <= slowest and before > 0.0:
        growth = max(1.0, own.growth * min(change / before, FASTEST))
    own.turned, own.change, own.growth = n, change, growth
    enough = GROWN if length <= QUICK else LONG_GROWN
    if growth > enough and change > ZIGZAG_FLOOR * size and counts.growth < 0:
        counts.growth = counts.step
    if own.turns >= 0.0:
        watch_turning(own, change, size, length, counts)
    if length > 1.0:
        own.alternating, own.largest, own.before = 0.0, 0.0, 0.0
    watch_zigzag(own, increment, size, counts)


@inner
def watch_turning(own, change, size, length, counts):
    """Note the step at which large turns of a few steps each have gone on without shrinking.

    So a force that saturates keeps an orbit beyond the limit. Undamped oscillators of order 2 turn
    like that below it; every mode of lower order shrinks there.
    """
    if length > QUICK:
        own.turns, own.turning, own.turning_before = 0.0, 0.0, 0.0
    own.turns += 1.0
    own.turning = max(own.turning, change)
    if own.turns % ZIGZAG_WINDOW == 0.0:
        kept = own.turning_before > 0.0 and own.turning >= ZIGZAG_KEPT * own.turning_before
        large = change > LARGE * size and change > SMALLEST_CHANGE
        if kept and large and counts.zigzag < 0:
            counts.zigzag = counts.step
        own.turning_before, own.turning = own.turning, 0.0


@inner
def watch_zigzag(own, increment, size, counts):
    """Note the first step at which the increments have alternated on and on without shrinking."""
    if own.alternating % SHORT_WINDOW == 0.0:
        own.least, own.most = increment, increment
    own.alternating += 1.0
    own.largest = max(own.largest, increment)
    own.least = min(own.least, increment)
    own.most = max(own.most, increment)
    size += own.most
    sustained = False
    if own.alternating % SHORT_WINDOW == 0.0:
        alike = own.least >= SHORT_ALIKE * own.most
        sustained = alike and own.most > LARGE * size
    if own.alternating % ZIGZAG_WINDOW == 0.0:
        kept = own.before > 0.0 and own.largest >= ZIGZAG_KEPT * own.before
        sustained = sustained or (kept and own.largest > ZIGZAG_FLOOR * size)
        own.before = own.largest
        own.largest = 0.0
    if sustained and size > SMALLEST_CHANGE and counts.zigzag < 0:
        counts.zigzag = counts.step
