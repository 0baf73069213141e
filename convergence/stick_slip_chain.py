"""A chain of hereditary stick-slip blocks: slips, their sizes, and memory that does not grow.

Blocks of the stick-slip scene on wells of unequal depth (20 to 100), with springs between
neighbours, ``hd.scenes.stick_slip_chain``. By the explicit scheme with h = 0.005:

* without coupling each block is the scene of one block, to rounding;
* the second half of a run takes no more memory than the first;
* sizes of slips, sums of the displacements, are distributed over four decades, without memory (beta
  = 2, gamma = 1) and with it. With it (beta = 1.8, gamma = 0.8) there are fewer, larger ones;
* half the step changes the number of slips and their total by less than a tenth.
"""

import resource
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
from _study import Claim, fastest, study

import hereditary as hd

H, EVERY, COUPLING = 0.005, 20, 5.0
KINDS = {"classical": (2.0, 1.0), "hereditary": (1.8, 0.8)}
COLOURS = {"classical": "#0072B2", "hereditary": "#D55E00"}


def chain(kind, blocks):
    beta, gamma = KINDS[kind]
    depths = np.random.default_rng(1).uniform(20.0, 100.0, blocks)
    return hd.scenes.stick_slip_chain(
        blocks, beta=beta, gamma=gamma, coupling=COUPLING, adhesion=depths
    )


def peaks(blocks, n_steps):
    """Peak of this process' memory after each half of a run that keeps rows of one block [MB]."""
    state = None
    for stop in (n_steps // 2 * H, n_steps * H):
        how = {"n_steps": n_steps // 2} if state is None else {"resume": state}
        state = hd.solve(
            chain("hereditary", blocks),
            stop,
            save_every=EVERY,
            components=[0],
            estimate=False,
            **how,
        ).state
        yield resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def halved():
    """Larger relative change of the number of slips and of their total as h is halved."""
    found = []
    for h, every in ((H, EVERY), (H / 2, 2 * EVERY)):
        sol = hd.solve(chain("hereditary", 200), 500.0, round(500 / h), save_every=every)
        sizes = hd.scenes.slips(sol).size
        found.append(np.array([sizes.size, sizes.sum()]))
    return np.abs(found[1] / found[0] - 1).max()


def uncoupled():
    """Largest distance of three uncoupled blocks from runs of one block each."""
    places = [0.2, 0.25, 0.3]
    chain = hd.scenes.stick_slip_chain(3, coupling=0.0, x0=places, v0=0.3)
    together = hd.solve(chain, 20.0, 4000).y
    alone = [hd.solve(hd.scenes.stick_slip(x0=x, v0=0.3), 20.0, 4000).y[:, 0] for x in places]
    return np.abs(together - np.array(alone).T).max()


def measure(quick):
    blocks, n_steps = (30, 12_000) if quick else (1000, 200_000)
    first, second = peaks(blocks, n_steps)
    sizes = {}
    for kind in KINDS:
        how = {"n_steps": n_steps, "save_every": EVERY, "estimate": False}
        call = partial(hd.solve, chain(kind, blocks), n_steps * H, **how)
        seconds, sol = fastest(call, 1, warm=False)
        slips = hd.scenes.slips(sol)
        sizes[kind] = slips.size
        yield {
            "kind": kind,
            "blocks": blocks,
            "steps": n_steps,
            "seconds": f"{seconds:.3g}",
            "ns_a_step_and_block": f"{1e9 * seconds / n_steps / blocks:.3g}",
            "history_MB": f"{sol.stats['history_bytes'] / 1e6:.4g}",
            "slips": slips.size.size,
            "largest": f"{slips.size.max(initial=0):.4g}",
            "widest": int((slips.last - slips.first + 1).max(initial=0)),
        }
    yield draw(sol.t, sol.y, sizes)
    more = second - first
    yield Claim("memory that the second half of a run adds [MB]", more, 10, small=True)
    yield Claim("uncoupled blocks off single ones", uncoupled(), 1e-9, small=True)
    if not quick:
        for kind, found in sizes.items():
            decades = np.log10(found.max() / found.min())
            yield Claim("decades that sizes of slips span", decades, at_least=4, where=kind)
        ratio = sizes["hereditary"].mean() / sizes["classical"].mean()
        yield Claim("mean size of slips with memory over that without", ratio, at_least=1)
        yield Claim("counts and totals change with half the step by", halved(), 0.1)


def claims(rows):
    row = rows[-1]
    yield Claim(f"{row['blocks']:g} blocks, {row['steps']:g} steps, memory [s]", row["seconds"])
    yield Claim("their history [MB]", row["history_MB"])


def draw(t, y, sizes):
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    rate = np.abs(np.diff(y, axis=0)) / np.diff(t)[:, None]
    late = t[1:] > 0.75 * t[-1]
    blocks = np.arange(y.shape[1])
    image = left.pcolormesh(
        t[1:][late], blocks, np.log10(rate[late].T + 1e-3), cmap="magma", rasterized=True,
        vmin=-1.0, vmax=1.5,
    )  # fmt: skip
    figure.colorbar(image, ax=left, label="log10 of the speed")
    left.set(xlabel="t", ylabel="block", title="With memory")
    for kind, found in sizes.items():
        ordered = np.sort(found)
        share = 1.0 - np.arange(ordered.size) / ordered.size
        right.loglog(ordered, share, color=COLOURS[kind], label=kind, drawstyle="steps-post")
    right.set(xlabel="size s of a slip", ylabel="share of slips larger than s", title="Sizes")
    right.legend()
    return figure


if __name__ == "__main__":
    study(measure, claims)
