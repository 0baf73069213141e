"""Parts of one step of a march, for all columns (components of the orbit and of the tangents).

Names of arrays are those of `StepWorkspace` and `March`. `predict`, `correct` and `keep_last_f`
belong to predictor-corrector schemes, whose pieces are values of f.
"""

from ..compiled.functions import set_force
from ..compiled.jacobian import add_derivative_by, multiply
from ..compiled.jit import inner, plug_in


@inner
def evaluate(march, t, x, f):
    """Set f (W,) to the right-hand sides of orbit and tangents at x (W,), and count calls."""
    m = march.work
    d = m.table.n_orbit
    set_force(m.right.force, t, x[:d], f[:d])
    m.state.counts.rhs += 1
    if x.shape[0] > d:
        march.push(m, t, x, f)


@plug_in
def push_tangents(m, t, x, f):
    """Set the f of the tangents: the Jacobian times each tangent, plus df / dp_k."""
    # df / dp_k of the first tangents only, which are derivatives by a parameter
    right, d, j_f = m.right, m.table.n_orbit, m.state.newton[-1]
    m.state.counts.rhs += right.jacobian(right.force, t, x[:d], m.workspace.units, j_f)
    for first in range(d, x.shape[0], d):
        multiply(j_f, x[first : first + d], f[first : first + d])
    for k in range(right.by_params):
        first = d * (1 + k)
        calls = add_derivative_by(k, right.force, t, x[:d], f[first : first + d])
        m.state.counts.rhs += calls


@plug_in
def push_nothing(m, t, x, f):
    """Do nothing: the march has no tangents."""


@inner
def predict(m):
    """Predict w with f of the last step, and add `lacks`."""
    # lacks: lead times the change of f, evaluated again at the last step's end, that y lacks
    known, lead, w = m.workspace.known, m.workspace.lead, m.workspace.w
    last_f, lacks = m.state.last_f, m.state.lacks
    for c in range(w.shape[0]):
        known[c] -= lacks[c]
        w[c] = lead[c] * last_f[c] - known[c]
        lacks[c] = 0.0


@inner
def correct(m):
    """Make one corrector sweep: compute w from f, and set `lacks` to minus lead times this f."""
    known, lead, w, f = m.workspace.known, m.workspace.lead, m.workspace.w, m.workspace.f
    moved, lacks = m.workspace.moved, m.state.lacks
    for c in range(w.shape[0]):
        corrected = lead[c] * f[c] - known[c]
        moved[c] = corrected - w[c]
        w[c] = corrected
        lacks[c] = -lead[c] * f[c]


@inner
def keep_last_f(m):
    """Set `last_f` to the final f of a step, and `lacks` to lead times the last change of f."""
    lead, f, last_f, lacks = m.workspace.lead, m.workspace.f, m.state.last_f, m.state.lacks
    for c in range(f.shape[0]):
        last_f[c] = f[c]
        lacks[c] += lead[c] * f[c]


@inner
def load_coefficients(m, i):
    """Copy the coefficients of each column from row i of the step coefficients."""
    groups, speed, rows, workspace = m.table.groups, m.state.shift, m.rows, m.workspace
    leads, nears, scales, length = rows.lead, rows.near, rows.scale, rows.length[i]
    shift, lead, near, scale = workspace.shift, workspace.lead, workspace.near, workspace.scale
    for c in range(lead.shape[0]):
        a = groups[c]
        shift[c], lead[c] = length * speed[c], leads[a, i]
        near[c], scale[c] = nears[a, i], scales[a, i]


@inner
def set_known_terms(m, p):
    """Set `known` to the lag of the step plus the weighted newest piece, number p of its block."""
    known, near, lag, pieces = m.workspace.known, m.workspace.near, m.state.lag, m.state.pieces
    for c in range(known.shape[0]):
        known[c] = near[c] * pieces[c, p] + lag[c, p]


@inner
def add_drift(m, i):
    """Add parts with x'(0), and with x(0), to `known`, if each step has its own coefficients."""
    # x(0) occurs in Riemann-Liouville terms only; then the state's drift is x(0)
    groups, drifts, speed, amplitudes = m.table.groups, m.rows.drift, m.state.shift, m.state.drift
    known, n_groups = m.workspace.known, drifts.shape[0] // (1 + amplitudes.shape[1])
    for c in range(known.shape[0]):
        known[c] += drifts[groups[c], i] * speed[c]
        if amplitudes.shape[1] > 0:
            known[c] += drifts[n_groups + groups[c], i] * amplitudes[c, 0]


@inner
def add_powers(m, n, t):
    """Add known terms ``amplitude t**power``, unless t = 0, and corrections of the first steps."""
    # amplitudes (W, r), powers (r, W), corrections (W, k), lead, known (W,)
    amplitudes, powers, corrections = m.state.drift, m.table.powers, m.state.corrections
    lead, known = m.workspace.lead, m.workspace.known
    for c in range(known.shape[0]):
        total = 0.0
        for k in range(powers.shape[0] if t > 0.0 else 0):
            if amplitudes[c, k] != 0.0:
                total += amplitudes[c, k] * t ** powers[k, c]
        if n < corrections.shape[1]:
            total -= corrections[c, n]
        known[c] += lead[c] * total


@inner
def set_argument_map(m, theta):
    """Set `base` and `gain`: f is taken at ``base + gain w``, w being that of a column's source."""
    # a column of memory that f reads has another one as source; others are their own
    sources, x, workspace = m.table.sources, m.state.x, m.workspace
    shift, scale, known, lead = workspace.shift, workspace.scale, workspace.known, workspace.lead
    base, gain = workspace.base, workspace.gain
    for c in range(base.shape[0]):
        if sources[c] == c:
            base[c], gain[c] = x[c] + theta * shift[c], theta
        else:  # for memory that f reads, scale w + known is lead times this memory
            base[c], gain[c] = known[c] / lead[c], scale[c] / lead[c]


@inner
def set_argument(m, n):
    """Set `point`, where f is taken, to ``base + gain w`` in the first n columns."""
    base, gain, w, point = m.workspace.base, m.workspace.gain, m.workspace.w, m.workspace.point
    sources = m.table.sources
    for c in range(n):
        point[c] = base[c] + gain[c] * w[sources[c]]


@inner
def change(m, n, p):
    """Set the increment w of an explicit step, and its change from the increment before."""
    known, shift = m.workspace.known, m.workspace.shift
    lead, f, w = m.workspace.lead, m.workspace.f, m.workspace.w
    given, u, d, pieces = m.table.given, m.state.increment, m.state.change, m.state.pieces
    for c in range(w.shape[0]):
        # before step 0 the increment of an order above 1 is h x'(0), which gives the scheme's x_1
        w_old = pieces[c, p] if n > 0 else u[c] - shift[c]
        more = 0.0 if n == 0 and given[c] == 1 else lead[c] * f[c] - known[c]
        w[c], d[c] = w_old + more, more if n > 0 else 0.0


@inner
def close(m, n, p, ratio, explicit):
    """End step n: add its increment to x, store its piece, and add this piece to later lags."""
    # only lags of the same block get the piece; p is the number of the step in its block
    table, state, workspace = m.table, m.state, m.workspace
    groups, sources, weights, given = table.groups, table.sources, table.weights, table.given
    shift, known = workspace.shift, workspace.known
    lead, w, f = workspace.lead, workspace.w, workspace.f
    x, u, d, lag, pieces = state.x, state.increment, state.change, state.lag, state.pieces
    base, gain, integral = workspace.base, workspace.gain, table.integral
    bend = 2.0 * ratio / (1.0 + ratio)
    for c in range(w.shape[0]):
        own = sources[c] == c
        if not own:  # memory that f reads is driven by the increments of its source
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
        else:  # memory that f reads in the next step
            x[c] = 0.0 if n == 0 and given[c] == 1 else (d[c] + known[c]) / lead[c]
        piece, a = f[c] if integral == 1 and own else w[c], groups[c]
        pieces[c, p + 1] = piece
        for k in range(2, lag.shape[1] - p):
            lag[c, p + k] += weights[a, k] * piece


@inner
def first_value(m, explicit):
    """Set `known` to the first start value of each column."""
    # the increment of the first step in implicit schemes, a given value in explicit ones
    starts, w, out = m.state.starts, m.workspace.w, m.workspace.known
    for c in range(out.shape[0]):
        out[c] = starts[c, 0] if explicit else w[c]
