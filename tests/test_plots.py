"""Figures: what they hold, not how they look."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb

import hereditary as hd
from hereditary import Table


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def oscillation():
    return hd.solve(hd.scenes.stick_slip(), 2.0, 200)


@pytest.fixture(scope="module")
def relaxation():
    return hd.solve(hd.Equation(hd.Caputo(0.5), lambda t, y: -y, [1.0, 2.0]), 1.0, 50)


def test_oscillogram_and_velocity(oscillation):
    for draw, values in (
        (hd.plots.oscillogram, oscillation.y),
        (hd.plots.velocity, oscillation.ydot),
    ):
        ax = draw(oscillation)
        assert np.array_equal(ax.lines[0].get_xdata(), oscillation.t)
        assert np.array_equal(ax.lines[0].get_ydata(), values[:, 0])
        assert ax.get_xlabel() == "$t$"


def test_phase_portrait(oscillation, relaxation):
    ax = hd.plots.phase_portrait(oscillation)
    assert np.array_equal(ax.lines[0].get_xdata(), oscillation.y[:, 0])
    assert np.array_equal(ax.lines[0].get_ydata(), oscillation.ydot[:, 0])
    plane = hd.plots.phase_portrait(relaxation)
    assert np.array_equal(plane.lines[0].get_ydata(), relaxation.y[:, 1])


def distance(points, x, y):
    """Return the largest distance of points (k, 2) from a polygon, in shares of its size."""
    corners = np.column_stack([x, y]) / (np.ptp(x), np.ptp(y))
    start, along = corners[:-1], np.diff(corners, axis=0)
    off = (points / (np.ptp(x), np.ptp(y)))[:, None] - start
    place = np.clip((off * along).sum(2) / np.maximum((along**2).sum(1), 1e-300), 0, 1)
    return np.linalg.norm(off - place[..., None] * along, axis=2).min(axis=1).max()


@pytest.mark.parametrize("rtol", [1e-3, 1e-9])
def test_lines_follow_the_solution_between_long_steps(rtol):
    """To a thousandth of their size; the chords between the rows do not."""
    bouncing = hd.Equation(hd.Caputo(2) + 0.5 * hd.Caputo(1.5), lambda t, x: -x, [1.0, 0.0])
    fading = hd.Equation(hd.Caputo([0.3, 0.6]), lambda t, y: -y, [1.0, 2.0])
    t = np.unique([*np.geomspace(1e-6, 0.1, 300), *np.linspace(0.1, 30.0, 700)])
    swing, fall = (hd.solve(equation, 30.0, rtol=rtol) for equation in (bouncing, fading))
    for draw, sol, line, rows in (
        (hd.plots.oscillogram, swing, (t, swing(t)), (swing.t, swing.y)),
        (hd.plots.velocity, swing, (t, swing(t, 1)), (swing.t, swing.ydot)),
        (hd.plots.phase_portrait, swing, (swing(t), swing(t, 1)), (swing.y, swing.ydot)),
        (hd.plots.oscillogram, fall, (t, fall(t)[:, 0]), (fall.t, fall.y[:, 0])),
        (hd.plots.phase_portrait, fall, fall(t).T, fall.y.T),
    ):
        points = np.column_stack(line)
        assert distance(points, *draw(sol).lines[0].get_data()) < 1e-3
        assert distance(points, *map(np.ravel, rows)) > 1e-3
    asked = hd.solve(bouncing, 30.0, rtol=rtol, t_eval=t)
    assert np.array_equal(hd.plots.oscillogram(asked).lines[0].get_xdata(), t)


def test_jumps_are_drawn_upright():
    def fire(t, v):
        return v[0] - 1.0

    fire.change = lambda t, v: 0.0 * v
    leaky = hd.Equation(hd.Caputo(0.8), lambda t, v: 1.5 - v, 0.0)
    sol = hd.solve(leaky, 3.0, rtol=1e-6, events=fire)
    t, v = hd.plots.oscillogram(sol).lines[0].get_data()
    jumps = np.flatnonzero(np.diff(t) == 0)
    assert np.array_equal(t[jumps], sol.t_events[0])
    np.testing.assert_allclose(v[jumps] - v[jumps + 1], 1.0, atol=1e-9)


def test_own_axes_have_the_style_of_the_package_and_given_ones_their_own(oscillation, relaxation):
    own, given = hd.plots.oscillogram(relaxation), plt.subplots()[1]
    assert own.figure.get_facecolor()[3] == own.get_facecolor()[3] == 0
    assert own.lines[0].get_linewidth() == 1.4
    grey = to_rgb(own.xaxis.label.get_color())
    assert grey == to_rgb(own.get_legend().get_texts()[0].get_color())
    luminance = ((grey[0] + 0.055) / 1.055) ** 2.4
    assert min(1.05 / (luminance + 0.05), (luminance + 0.05) / 0.05) > 4.5  # on white, on black
    assert hd.plots.oscillogram(relaxation, given) is given
    assert given.lines[0].get_linewidth() == plt.rcParams["lines.linewidth"] == 1.5
    assert given.get_legend().get_texts()[0].get_color() == "black"
    assert hd.plots.phase_portrait(oscillation, ax=given) is given


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_components_get_a_legend(relaxation):
    assert legend(hd.plots.oscillogram(relaxation)) == ["component 0", "component 1"]


def table_of(axes, status=None, **values):
    shape = tuple(len(axis) for axis in axes.values())
    filled = np.full(shape, "completed") if status is None else np.array(status)
    axes = {name: np.asarray(axis, dtype=float) for name, axis in axes.items()}
    return Table(axes, {k: np.asarray(v) for k, v in values.items()}, filled)


def crosses(ax):
    return [line for line in ax.lines if line.get_marker() == "x"]


def test_lyapunov_spectrum():
    b = [0.5, 1.0, 1.5, 2.0]
    status = ["completed", "completed", "diverged", "completed"]
    table = table_of({"spring_speed": b}, status, exponent=[-0.1, 0.05, np.nan, 0.2],
                     slope=[-0.2, 0.1, np.nan, 0.1], slope_stderr=[0.1] * 4)  # fmt: skip
    ax = hd.plots.lyapunov_spectrum(table, name="since 0")
    assert hd.plots.lyapunov_spectrum(table, "slope", "slope_stderr", ax, name="late") is ax
    zero, exponent = ax.lines[:2]
    assert list(zero.get_ydata()) == [0, 0]
    np.testing.assert_array_equal(exponent.get_ydata(), table["exponent"])
    assert [line.get_gid() for line in ax.lines].count("zero") == 1
    assert [cross.get_xdata().tolist() for cross in crosses(ax)] == [[1.5], [1.5]]
    assert len(ax.collections) == 1  # error bars
    assert "spring speed" in ax.get_xlabel()
    assert legend(ax) == ["since 0", "late"]


def test_several_exponents_are_several_lines():
    table = table_of({"beta": [1.5, 1.6]}, exponents=[[0.1, -0.1], [0.2, -0.2]])
    ax = hd.plots.lyapunov_spectrum(table, "exponents", name="L")
    assert [line.get_label() for line in ax.lines[1:]] == ["L, 1", "L, 2"]
    assert ax.lines[2].get_ydata().tolist() == [-0.1, -0.2]


def test_bifurcation_shows_every_sample_once():
    samples = np.array([[1.0, 2.0, np.nan], [3.0, np.nan, np.nan]])
    table = table_of({"friction": [0.1, 0.2]}, place=samples)
    ax = hd.plots.bifurcation(table, ylabel="x")
    assert ax.lines[0].get_xdata().tolist() == [0.1, 0.1, 0.2]
    assert ax.lines[0].get_ydata().tolist() == [1.0, 2.0, 3.0]
    assert not ax.lines[0].get_rasterized()
    failed = table_of({"friction": [0.1, 0.2]}, ["diverged", "completed"], place=samples)
    shown, cross = hd.plots.bifurcation(failed).lines
    assert shown.get_xydata().tolist() == [[0.2, 3.0]]
    assert cross.get_xdata().tolist() == [0.1]
    many = table_of({"friction": np.arange(3.0)}, place=np.zeros((3, 1000)))
    assert hd.plots.bifurcation(many).lines[0].get_rasterized()


def test_regime_map(tmp_path):
    regimes = [["stuck", "sliding"], ["stick-slip, periodic", ""], ["stuck", "stuck"]]
    status = [["completed"] * 2, ["completed", "diverged"], ["completed"] * 2]
    table = table_of({"adhesion": [1, 2, 4], "spring_speed": [0.5, 1.0]}, status,
                     regime=regimes, certainty=[[1, 0.5], [1, np.nan], [0.0, 1]])  # fmt: skip
    ax = hd.plots.regime_map(table)
    colours = ax.collections[0].get_array()
    assert legend(ax) == ["stick-slip, periodic", "sliding", "stuck"]
    stuck = np.array(to_rgb(ax.get_legend().legend_handles[2].get_facecolor()))
    np.testing.assert_allclose(colours[0, 0], stuck)
    np.testing.assert_allclose(colours[2, 1], stuck)
    assert np.all(colours[2, 0] > colours[2, 1])  # paler where less certain
    np.testing.assert_allclose(colours[1, 1], 1.0)
    assert [line.get_xdata().tolist() for line in crosses(ax)] == [[1.0]]
    assert ax.get_ylim() == (0.5, 5.0)
    for suffix in ("pdf", "svg", "png"):
        ax.figure.savefig(tmp_path / f"map.{suffix}")
    plain = hd.plots.regime_map(table, certainty=None)
    np.testing.assert_allclose(plain.collections[0].get_array()[2, 0], stuck)


def test_tables_with_other_axes_are_refused():
    one, two = table_of({"b": [1.0]}, x=[1.0]), table_of({"b": [1.0], "c": [1.0]}, x=[[1.0]])
    for draw in (hd.plots.lyapunov_spectrum, hd.plots.bifurcation):
        with pytest.raises(ValueError, match="table must have one axis, got b, c"):
            draw(two)
    with pytest.raises(ValueError, match="table must have two axes, got b"):
        hd.plots.regime_map(one)


def test_keywords_of_matplotlib_and_components(relaxation, oscillation):
    ax = hd.plots.oscillogram(relaxation, components=1, linewidth=3.0, label="one")
    assert [line.get_linewidth() for line in ax.lines] == [3.0]
    assert np.array_equal(ax.lines[0].get_ydata(), relaxation.y[:, 1])
    assert legend(ax) == ["one"]
    ax = hd.plots.phase_portrait(relaxation, components=[1, 0], color="red")
    assert ax.get_xlabel() == "$y_{2}$"
    assert np.array_equal(ax.lines[0].get_xdata(), relaxation.y[:, 1])
    assert hd.plots.velocity(oscillation, ls=":").lines[0].get_linestyle() == ":"


def test_keywords_of_figures_of_tables():
    table = table_of({"b": [1.0, 2.0]}, exponent=[0.1, -0.1], place=[[1.0], [2.0]])
    assert hd.plots.lyapunov_spectrum(table, c="k").lines[-1].get_color() == "k"
    wide = table_of({"b": [1.0, 2.0]}, exponent=[0.1, -0.1], se=[0.1, 0.1])
    ax = hd.plots.lyapunov_spectrum(wide, error="se", color="k")
    assert np.all(ax.collections[0].get_colors()[0][:3] == 0.0)
    assert hd.plots.bifurcation(table, markersize=7).lines[0].get_markersize() == 7


@pytest.mark.parametrize(
    ("axis", "label"),
    [("alpha", r"order $\alpha$ [-]"), ("force", "force [-]"), ("anything", "anything")],
)
def test_axes_name_orders_and_parameters(axis, label):
    table = table_of({axis: [1.0, 2.0]}, exponent=[0.1, -0.1])
    assert hd.plots.lyapunov_spectrum(table).get_xlabel() == label


def test_errors_are_drawn_relative_to_the_size_of_components(relaxation):
    found = relaxation.check()
    ax = hd.plots.errors(found)
    assert np.array_equal(ax.lines[0].get_xdata(), found.t)
    positive = found.relative[:, 0] > 0
    assert np.array_equal(ax.lines[0].get_ydata()[positive], found.relative[positive, 0])
    assert ax.get_yscale() == "log"
    assert ax.lines[-1].get_ydata()[0] == found.rtol
