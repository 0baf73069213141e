"""
An epidemic, fitted to data
===========================

In this susceptible-infected-recovered model recovery and infection have memory: one order alpha for
all components. The fit finds order, infection rate and recovery rate from noisy counts, with their
standard errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd


def epidemic(t, y, p):
    infections = p[0] * y[0] * y[1]
    return np.array([-infections, infections - p[1] * y[1], p[1] * y[1]])


def model(alpha, infection, recovery):
    start = [0.99, 0.01, 0.0]
    return hd.Equation(hd.Caputo(alpha), epidemic, start, params=[infection, recovery])


# %%
# The data here are synthetic: the number of infected, observed every second day.

days = np.arange(2.0, 82.0, 2.0)
true = {"alpha": 0.9, "infection": 0.5, "recovery": 0.15}
infected = hd.solve(model(**true), 80.0, rtol=1e-8, t_eval=days).y[:, 1]
counts = infected * np.random.default_rng(3).normal(1.0, 0.03, days.size)

guess = {"alpha": 1.0, "infection": 0.4, "recovery": 0.2}
bounds = {"alpha": (0.5, 1.0), "infection": (0.05, 2.0), "recovery": (0.01, 1.0)}
found = hd.fit(model, days, counts, guess, bounds=bounds, observe=[1], sigma=0.03 * counts)
for name, value in found.parameters.items():
    print(f"{name} = {value:.3f} +- {found.standard_errors[name]:.3f}")
for name, value in true.items():
    assert abs(found.parameters[name] - value) < 3 * found.standard_errors[name]

fig, ax = plt.subplots(figsize=(7, 4), layout="constrained")
hd.plots.fit(found, ax, label="model")
ax.set(xlabel="day", ylabel="share infected")
plt.show()

# %%
# Order and rates are correlated, as neighbouring memory terms are. The data determine their
# combination better than each of them.

print(np.round(found.correlation, 2))
assert np.abs(found.correlation).min() > 0.5
