"""What a march notices of its own steps (floor 1): zigzags that last, and turns that grow.

Each component of the orbit has a row of the monitor: the length of the alternation under way, the
largest increment of its present stretch and of the one before; the step of its last turn, where
increments change sign, the change there, and the growth of these changes; the smallest and the
largest increment of the present short stretch; the number of turns in quick
succession (-1 where they may last), the largest change in their present stretch and in the one
before. Behind them stand three columns that `march_adams` keeps for itself. Nothing is done
between turns: most orbits seldom turn.
"""

from .._jit import kernel

N_MONITORED, N_TURNS = 14, 8
# Steps of unbroken alternation after which the amplitude is compared with that of the stretch
# before. A resolved oscillation never alternates twice in a row; at 0.99 of the step limit the
# undamped classical oscillator alternates for 16 steps, and every damped one shrinks.
ZIGZAG_WINDOW = 64
# An alternation that shrinks by less than this over a stretch is sustained; one below FLOOR
# times the size of the solution is rounding, and so are increments that are hardly floats.
ZIGZAG_KEPT, ZIGZAG_FLOOR, TINY = 0.98, 1e-9, 1e-300
# An alternation as large as the solution needs fewer steps to spoil it: where its increments are
# this large and this much alike over so many steps. At 0.999 of its limit the undamped oscillator's
# still differ by a tenth.
SHORT_WINDOW, SHORT_ALIKE, LARGE = 16, 0.95, 0.05
# Changes of increments at turns that grow by this much altogether, from one turn to the next within
# up to QUICK steps, and within more; one counts for no more than FASTEST, so that a force that
# jumps is no growth. At 0.99 of its limit the undamped oscillator's grow and shrink by ten; beats
# grow with their number at most.
GROWN, LONG_GROWN, QUICK, FASTEST = 30.0, 1e3, 3.0, 3.2
# Steps between turns that a scheme of first order does not resolve: up to 22 for both.
SLOWEST = 11.0


@kernel
def watch_turn(monitor, c, change, increment, size, slowest, counters):
    """Look at a turn of a component's increments; more than `slowest` steps apart are resolved.

    counters[2] becomes the step at which a zigzag has lasted, counters[6] that at which turns have
    grown.
    """
    change, increment, size, n = abs(change), abs(increment), abs(size), float(counters[0])
    length, before = n - monitor[c, 3], monitor[c, 4]
    growth = 1.0
    if length <= slowest and before > 0.0:
        growth = max(1.0, monitor[c, 5] * min(change / before, FASTEST))
    monitor[c, 3], monitor[c, 4], monitor[c, 5] = n, change, growth
    enough = GROWN if length <= QUICK else LONG_GROWN
    if growth > enough and change > ZIGZAG_FLOOR * size and counters[6] < 0:
        counters[6] = counters[0]
    if monitor[c, N_TURNS] >= 0.0:
        watch_turning(monitor, c, change, size, length, counters)
    if length > 1.0:
        monitor[c, 0], monitor[c, 1], monitor[c, 2] = 0.0, 0.0, 0.0
    watch_zigzag(monitor, c, increment, size, counters)


@kernel
def watch_turning(monitor, c, change, size, length, counters):
    """Note the step at which large turns of a few steps each have gone on without shrinking.

    So a force that saturates keeps an orbit beyond the limit. Undamped oscillators of order 2 turn
    like that below it; every mode of lower order shrinks there.
    """
    if length > QUICK:
        monitor[c, N_TURNS], monitor[c, 9], monitor[c, 10] = 0.0, 0.0, 0.0
    monitor[c, N_TURNS] += 1.0
    monitor[c, 9] = max(monitor[c, 9], change)
    if monitor[c, N_TURNS] % ZIGZAG_WINDOW == 0.0:
        kept = monitor[c, 10] > 0.0 and monitor[c, 9] >= ZIGZAG_KEPT * monitor[c, 10]
        large = change > LARGE * size and change > TINY
        if kept and large and counters[2] < 0:
            counters[2] = counters[0]
        monitor[c, 10], monitor[c, 9] = monitor[c, 9], 0.0


@kernel
def watch_zigzag(monitor, c, increment, size, counters):
    """Note the first step at which the increments have alternated on and on without shrinking."""
    if monitor[c, 0] % SHORT_WINDOW == 0.0:
        monitor[c, 6], monitor[c, 7] = increment, increment
    monitor[c, 0] += 1.0
    monitor[c, 1] = max(monitor[c, 1], increment)
    monitor[c, 6] = min(monitor[c, 6], increment)
    monitor[c, 7] = max(monitor[c, 7], increment)
    size += monitor[c, 7]
    sustained = False
    if monitor[c, 0] % SHORT_WINDOW == 0.0:
        alike = monitor[c, 6] >= SHORT_ALIKE * monitor[c, 7]
        sustained = alike and monitor[c, 7] > LARGE * size
    if monitor[c, 0] % ZIGZAG_WINDOW == 0.0:
        kept = monitor[c, 2] > 0.0 and monitor[c, 1] >= ZIGZAG_KEPT * monitor[c, 2]
        sustained = sustained or (kept and monitor[c, 1] > ZIGZAG_FLOOR * size)
        monitor[c, 2] = monitor[c, 1]
        monitor[c, 1] = 0.0
    if sustained and size > TINY and counters[2] < 0:
        counters[2] = counters[0]
