"""
An epidemic by its generation time
==================================

The renewal equation of an epidemic convolves the infections with the density of generation times.
Densities of equal mean and standard deviation give nearly the same epidemic. A density with a shift
is a delay beside the density without it. A lockdown on day 40 is a jump of the reproduction number.
"""

import matplotlib.pyplot as plt
import numpy as np

import hereditary as hd

share, infections = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def outbreak(t, y, memory):
    reproduction = 1.8 if t < 40.0 else 0.9
    force = reproduction * memory[0, 1] + 1e-4 * np.exp(-t)
    return np.array([-y[1], y[0] * force - y[1]])


# %%
# Mean 5 and standard deviation 1.9 days, and shares of infections day by day.

days = np.arange(13.0)
shares = [0, 0.02, 0.09, 0.17, 0.2, 0.18, 0.13, 0.09, 0.06, 0.03, 0.02, 0.01, 0]
densities = {
    "gamma": hd.GammaDensity.from_mean(5.0, 1.9),
    "lognormal": hd.LognormalDensity.from_mean(5.0, 1.9),
    "Weibull": hd.WeibullDensity.from_mean(5.0, 1.9),
    "daily shares": hd.Kernel.from_table(days, shares, signed=True),
}
t = np.linspace(0.0, 80.0, 401)
found = {}
for name, density in densities.items():
    equation = hd.Equation(
        share * hd.Caputo(1), outbreak, [1.0, 1e-4], memory=infections * hd.Memory(density, 0)
    )
    found[name] = hd.solve(equation, 80.0, rtol=1e-4, breaks=[40.0], t_eval=t).y[:, 1]

# %%
# The gamma density as a shift of one day and a gamma density of mean 4. The convolution is a
# component of its own, which is read one day later.


def after_a_day(t, y, memory):
    reproduction = 1.8 if t < 40.0 else 0.9
    force = reproduction * memory[1, 2] + 1e-4 * np.exp(-t)
    return np.array([-y[1], y[0] * force - y[1], memory[0, 1] - y[2]])


densities["shifted gamma"] = hd.GammaDensity.from_mean(4.0, 1.9)
of_infections = np.array([0.0, 1.0, 0.0]) * hd.Memory(densities["shifted gamma"], 0)
memory = [of_infections, hd.Delay(1.0, past=[1.0, 0.0, 0.0])]
derived = np.array([1.0, 0.0, 0.0]) * hd.Caputo(1)
equation = hd.Equation(derived, after_a_day, [1.0, 1e-4, 0.0], memory=memory)
found["shifted gamma"] = hd.solve(equation, 80.0, rtol=1e-4, breaks=[40.0], t_eval=t).y[:, 1]

fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
ages = np.linspace(0.01, 15.0, 300)
for name, density in densities.items():
    shift = 1.0 if name == "shifted gamma" else 0.0
    left.plot(ages + shift, density(ages), label=name)
    right.semilogy(t, found[name], label=name)
left.set(xlabel="days since infection", ylabel="density of generation times")
right.set(xlabel="day", ylabel="infections a day")
left.legend()
plt.show()

# %%
# The four kinds of equal mean and standard deviation differ by a few per cent on day 80.

last = [found[name][-1] for name in ("gamma", "lognormal", "Weibull", "shifted gamma")]
print(np.round(np.array(last) / last[0], 3))
assert np.ptp(last) < 0.1 * last[0]
