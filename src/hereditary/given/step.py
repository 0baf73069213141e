"""Parts of a step that are inlined into the march, array by array.

Prediction and corrector sweeps are for pieces that are values of f.
"""

from ..compiled.jit import inlined, inner


@inlined
def predict(lead, known, force, lacks, w):
    """Predict w with the last f, and add the change of lead times f in the last sweep."""
    for c in range(w.shape[0]):
        known[c] -= lacks[c]
        w[c] = lead[c] * force[c] - known[c]
        lacks[c] = 0.0


@inlined
def correct(lead, known, f, lacks, w, moved):
    """Make a corrector sweep; `lacks` is, negated, what it took for f."""
    for c in range(w.shape[0]):
        corrected = lead[c] * f[c] - known[c]
        moved[c] = corrected - w[c]
        w[c] = corrected
        lacks[c] = -lead[c] * f[c]


@inlined
def settle(lead, f, force, lacks):
    """Keep f, and lead times what the last sweep lacked of it."""
    for c in range(f.shape[0]):
        force[c] = f[c]
        lacks[c] += lead[c] * f[c]


# Rows of the room of a step, (N_ROOM, W), for W columns: what is known of its left side, the
# increment of t x'(0), factors of the increment, of f and of the newest piece, increments, f, what
# a sweep changed, the point where f is taken, that point without increments and their factor, and
# the increments that Newton's method begins with; the units of components, for differences of f.
(
    KNOWN, SHIFT, SCALE, LEAD, NEAR, W, F, MOVED, POINT, BASE, GAIN, FIRST, UNITS, N_ROOM
) = range(14)  # fmt: skip


@inlined
def take_row(i, groups, length, speed, leads, nears, scales, shift, lead, near, scale):
    """Take the coefficients of each column from row i."""
    for c in range(lead.shape[0]):
        a = groups[c]
        shift[c], lead[c] = length[i] * speed[c], leads[a, i]
        near[c], scale[c] = nears[a, i], scales[a, i]


@inlined
def know(p, near, lag, pieces, known):
    """Add the newest piece to the lag."""
    for c in range(known.shape[0]):
        known[c] = near[c] * pieces[c, p] + lag[c, p]


@inlined
def add_drift(i, groups, drifts, speed, amplitudes, known):
    """Add what terms with orders that vary take of x'(0), and of x(0) where amplitudes hold it."""
    n_groups = drifts.shape[0] // (1 + amplitudes.shape[1])
    for c in range(known.shape[0]):
        known[c] += drifts[groups[c], i] * speed[c]
        if amplitudes.shape[1] > 0:
            known[c] += drifts[n_groups + groups[c], i] * amplitudes[c, 0]


@inner
def add_powers(n, t, amplitudes, powers, corrections, lead, known):
    """Add known powers of t, not at 0, and corrections of the first steps."""
    # amplitudes (W, r), powers (r, W), corrections (W, k), lead, known (W,)
    for c in range(known.shape[0]):
        total = 0.0
        for k in range(powers.shape[0] if t > 0.0 else 0):
            if amplitudes[c, k] != 0.0:
                total += amplitudes[c, k] * t ** powers[k, c]
        if n < corrections.shape[1]:
            total -= corrections[c, n]
        known[c] += lead[c] * total


@inlined
def see(theta, sources, x, shift, scale, known, lead, base, gain):
    """Set where f is taken: at ``base + gain w`` with w of the sources, y and memory alike."""
    for c in range(base.shape[0]):
        if sources[c] == c:
            base[c], gain[c] = x[c] + theta * shift[c], theta
        else:  # scale w + known is lead times the derivative
            base[c], gain[c] = known[c] / lead[c], scale[c] / lead[c]


@inlined
def look(base, gain, sources, w, point):
    """Set the point where f is taken."""
    for c in range(point.shape[0]):
        point[c] = base[c] + gain[c] * w[sources[c]]


@inlined
def change(n, p, given, lead, known, shift, f, u, pieces, w, d):
    """Set w of an explicit step, and its change."""
    for c in range(w.shape[0]):
        # at first increments of order above 1 hold h x'(0) already: the scheme's x_1
        w_old = pieces[c, p] if n > 0 else u[c] - shift[c]
        more = 0.0 if n == 0 and given[c] == 1 else lead[c] * f[c] - known[c]
        w[c], d[c] = w_old + more, more if n > 0 else 0.0


@inlined
def close(
    p, n, explicit, integral, ratio, groups, sources, weights, given, shift, known, lead, base,
    gain, w, f, x, u, d, lag, pieces,
):  # fmt: skip
    """Move the solution on, keep the piece and spread it over the steps ahead in its block."""
    bend = 2.0 * ratio / (1.0 + ratio)
    for c in range(w.shape[0]):
        own = sources[c] == c
        if not own:  # memory takes the increments of its source
            w[c] = w[sources[c]]
            if explicit:
                d[c] = w[c] - pieces[c, p]
        new = shift[c] + w[c]
        if not explicit:
            d[c] = bend * (new - ratio * u[c]) if n > 0 else 0.0
        u[c] = new
        if own:
            x[c] += new
        elif not explicit:
            x[c] = base[c] + gain[c] * w[c]
        else:  # for the next step
            x[c] = 0.0 if n == 0 and given[c] == 1 else (d[c] + known[c]) / lead[c]
        piece, a = f[c] if integral == 1 and own else w[c], groups[c]
        pieces[c, p + 1] = piece
        for k in range(2, lag.shape[1] - p):
            lag[c, p + k] += weights[a, k] * piece


@inlined
def first_value(explicit, starts, w, out):
    """Set the first start value of each column, its first increment where that is solved for."""
    for c in range(out.shape[0]):
        out[c] = starts[c, 0] if explicit else w[c]
