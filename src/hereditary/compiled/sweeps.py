"""Prediction and corrector sweeps, for pieces that are values of f."""

from .jit import inlined


@inlined
def predict(lead, known, force, lacks, w):
    """Predict w with the last f, and add what the last sweep lacked of lead times f."""
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
