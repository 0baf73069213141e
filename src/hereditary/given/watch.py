"""Signs of instability in a march: lasting zigzags, growing turns, and sweeps that diverge.

A turn is a step at which the increment of a component changes its sign. An alternation, or zigzag,
is a sequence of steps that are all turns. Each component of the orbit has a record (`MONITOR`,
given/signatures.py). `watch_turn` is called at turns only, because most orbits seldom turn.
"""

from ..compiled.jit import inner

# Steps in a batch of an alternation; the largest increments of two batches in a row are compared.
# A resolved oscillation never alternates twice in a row. At 0.99 of the step limit the undamped
# classical oscillator alternates for 16 steps, and the alternation of every damped one shrinks.
ZIGZAG_WINDOW = 64
# Least ratio of a batch's largest increment to that of the batch before in a lasting zigzag.
ZIGZAG_KEPT = 0.98
# Increments of an alternation below this fraction of the solution count as rounding errors.
ZIGZAG_FLOOR = 1e-9
# Increments below this size count as rounding errors, because floats hardly resolve them.
SMALLEST_CHANGE = 1e-300
# Steps in a short batch, after which a large alternation counts as a lasting zigzag. A large
# alternation spoils the solution in fewer steps than a small one.
SHORT_WINDOW = 16
# Steps in a row with diverging corrector sweeps that count as instability.
DIVERGING = 3.0
# Least change by a sweep that may diverge, as a fraction of the increment. With a tenth of it,
# resolved components of two orders have false alarms.
LARGE_SWEEP = 0.5
# Least ratio of the smallest to the largest increment of a short batch in a lasting zigzag. At
# 0.999 of its step limit, increments of the undamped oscillator still differ by a tenth.
SHORT_ALIKE = 0.95
# Least size of a large alternation, as a fraction of the solution.
LARGE = 0.05
# Total growth of the increment's changes over a series of turns that counts as instability. This
# value is for turns at most QUICK steps apart. At 0.99 of its step limit the changes of the
# undamped oscillator grow and shrink by a factor of ten.
GROWN = 30.0
# The same total growth for turns more than QUICK steps apart. Beats grow by the number of their
# turns at most.
LONG_GROWN = 1e3
# Most steps between two turns that count as quick.
QUICK = 3.0
# Largest growth from one turn to the next that is counted, so that a jump of the force does not
# count as instability.
FASTEST = 3.2
# Most steps between two turns of an oscillation that a scheme of first order does not resolve; its
# period has up to 22 steps.
SLOWEST = 11.0


@inner
def watch_turn(record, change, increment, size, slowest, counts):
    """Update a component's record at a turn, and note signs of instability in `counts`."""
    # size: that of y; turns more than slowest steps apart are of a resolved oscillation.
    # counts.zigzag becomes the step at which a zigzag has lasted, counts.growth that at which
    # changes have grown.
    change, increment, size, n = abs(change), abs(increment), abs(size), float(counts.step)
    length, before = n - record.turned, record.change
    growth = 1.0
    if length <= slowest and before > 0.0:
        growth = max(1.0, record.growth * min(change / before, FASTEST))
    record.turned, record.change, record.growth = n, change, growth
    enough = GROWN if length <= QUICK else LONG_GROWN
    if growth > enough and change > ZIGZAG_FLOOR * size and counts.growth < 0:
        counts.growth = counts.step
    if record.turns >= 0.0:
        watch_turning(record, change, size, length, counts)
    if length > 1.0:
        record.alternating, record.largest, record.before = 0.0, 0.0, 0.0
    watch_zigzag(record, increment, size, counts)


@inner
def watch_turning(record, change, size, length, counts):
    """Note in counts.zigzag the step at which a series of quick, large turns did not shrink."""
    # Beyond the step limit a force that saturates keeps an orbit turning so; below it modes of
    # order below 2 shrink. Undamped oscillators of order 2 do not, and are not watched here.
    if length > QUICK:
        record.turns, record.turning, record.turning_before = 0.0, 0.0, 0.0
    record.turns += 1.0
    record.turning = max(record.turning, change)
    if record.turns % ZIGZAG_WINDOW == 0.0:
        kept = record.turning_before > 0.0 and record.turning >= ZIGZAG_KEPT * record.turning_before
        large = change > LARGE * size and change > SMALLEST_CHANGE
        if kept and large and counts.zigzag < 0:
            counts.zigzag = counts.step
        record.turning_before, record.turning = record.turning, 0.0


@inner
def watch_zigzag(record, increment, size, counts):
    """Note in counts.zigzag the first step at which a lasting alternation did not shrink."""
    # size: that of the solution; the record counts the steps of the alternation
    if record.alternating % SHORT_WINDOW == 0.0:
        record.least, record.most = increment, increment
    record.alternating += 1.0
    record.largest = max(record.largest, increment)
    record.least = min(record.least, increment)
    record.most = max(record.most, increment)
    size += record.most
    sustained = False
    if record.alternating % SHORT_WINDOW == 0.0:
        alike = record.least >= SHORT_ALIKE * record.most
        sustained = alike and record.most > LARGE * size
    if record.alternating % ZIGZAG_WINDOW == 0.0:
        kept = record.before > 0.0 and record.largest >= ZIGZAG_KEPT * record.before
        sustained = sustained or (kept and record.largest > ZIGZAG_FLOOR * size)
        record.before = record.largest
        record.largest = 0.0
    if sustained and size > SMALLEST_CHANGE and counts.zigzag < 0:
        counts.zigzag = counts.step


@inner
def watch_sweep(record, moved, next_moved, increment, counts):
    """Note in counts.diverged the step at which corrector sweeps had diverged for some steps."""
    # moved: change of a component by the last sweep, next_moved that by one more. If sweeps
    # diverge, decaying modes grow, with or without turns.
    large = abs(moved) > LARGE_SWEEP * abs(increment) and abs(moved) > SMALLEST_CHANGE
    record.diverging = record.diverging + 1.0 if large and abs(next_moved) > abs(moved) else 0.0
    if record.diverging == DIVERGING and counts.diverged < 0:
        counts.diverged = counts.step
