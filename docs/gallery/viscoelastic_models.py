"""
Two spring-pots: from measured moduli to creep
==============================================

Storage and loss moduli, measured at nine frequencies, are those of two spring-pots in parallel.
The model then predicts how the body creeps and recovers.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd
from hereditary.viscoelastic import SpringPot, fit_moduli, kelvin_voigt

# %%
# The experimental data that RHEOS.jl 0.9.4 publishes (docs/src/assets/data_freq.csv), and its own
# fit of this model to them (docs/src/fitpredictFreq.jl), by another optimiser [KaplanEtAl2019]:
# angular frequency [1/time], storage modulus, loss modulus [stress]. The file does not say which
# units of time and stress.

omega, storage, loss = np.array(
    [
        (0.091160329, 0.828556819, 0.149921737),
        (0.304963687, 0.862943457, 0.142491695),
        (0.77022935, 0.898757203, 0.151197212),
        (4.24686265, 0.974905392, 0.182173688),
        (9.175279817, 1.036221356, 0.210393172),
        (29.44212077, 1.124016346, 0.313294598),
        (103.7540299, 1.244293227, 0.552659563),
        (309.5187241, 1.494145654, 1.070122282),
        (1003.289067, 3.170324762, 1.871798151),
    ]
).T
published = {"fast": 0.009444444, "a": 0.76694686, "slow": 0.91477855, "b": 0.09972298}


def model(fast, a, slow, b):
    return kelvin_voigt(SpringPot(fast, a), SpringPot(slow, b))


guess = {"fast": 0.1, "a": 0.5, "slow": 1.0, "b": 0.2}
found = fit_moduli(model, omega, storage, loss, guess, bounds={"a": (0, 1), "b": (0, 1)})
for name, value in found.parameters.items():
    error = found.standard_errors[name]
    print(f"{name:4s} {value:.4f} +- {error:.4f}, published {published[name]:.4f}")
    assert abs(value - published[name]) < 0.1 * error

# %%
# Below 10 radians a time unit the body is almost elastic, with an order of 0.1. Above, the other
# spring-pot of order 0.77 adds friction. Single moduli are missed by up to a quarter: the last
# storage modulus rises faster than two spring-pots allow. A third one beside them fits no better.

fig, (ax, below) = plt.subplots(
    2, 1, figsize=(7, 6), layout="constrained", sharex=True, height_ratios=(2, 1)
)
fine = np.geomspace(0.05, 2e3, 200)
for label, data, curve in zip(
    ("G'", "G''"), (storage, loss), found.model.moduli(fine), strict=True
):
    (line,) = ax.loglog(fine, curve, label=label)
    ax.loglog(omega, data, "o", color=line.get_color())
    missed = 100 * (np.interp(omega, fine, curve) / data - 1)
    below.semilogx(omega, missed, "o-", lw=0.8, color=line.get_color())
    assert 20 < np.abs(missed).max() < 30
ax.set(ylabel="modulus [stress]", title="measured moduli and the fit")
ax.legend()
below.axhline(0, color="0.6", lw=0.8)
below.set(xlabel="angular frequency [1/time]", ylabel="fit above data [%]")

# %%
# A stress of 1 from t = 0 to 10: the strain creeps to 1.45 and recovers slowly. Ten times the time
# of loading later 1.2 per cent of it remain.


def stress(t, strain):
    return 1.0 if t < 10.0 else 0.0


run = hd.solve(found.model.strain_equation(stress), 110.0, rtol=1e-7, breaks=[10.0])
known = found.model.creep(110.0) - found.model.creep(100.0)
print(f"strain at the end {run.y[-1, 0]:.5f}, by superposed steps {known:.5f}")
assert abs(run.y[-1, 0] / known - 1) < 1e-6
assert 0.011 < known / found.model.creep(10.0) < 0.013
fig, ax = plt.subplots(figsize=(7, 4.4), layout="constrained")
hd.plots.oscillogram(run, ax)
ax.set(xlabel="t [time]", ylabel="strain per stress [1/stress]", title="creep and recovery")
plt.show()
