"""`python -m hereditary paper`: its tables contain what they claim."""

import numpy as np
import pytest

import hereditary as hd
from hereditary import Regime, Table
from hereditary.__main__ import main
from hereditary.paper import figures
from hereditary.paper.job import Job, merged
from hereditary.paper.runs import (
    CLASSICAL,
    _solvable,
    exponents,
    growth_exponent,
    orbit,
    regime,
    section,
    signs,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One figure of each kind; the others differ from them in parameters alone."""
    out = tmp_path_factory.mktemp("paper")
    figures = ["--figures", "2,3,5,8,b,b-c"]
    assert main(["paper", "--out", str(out), "--quick", *figures]) == 0
    return out


def test_figures_come_as_images_and_tables(folder):
    assert (folder / "figure_2.png").stat().st_size > 10_000
    stems = {path.stem for path in folder.glob("*.png")}
    assert stems == {path.stem for path in folder.glob("*.pdf")}
    tables = {path.stem for path in folder.glob("*.npz")}
    assert stems - tables == {"figure_8"}
    assert {"figure_8_beta", "figure_8_gamma"} <= tables
    for stem in tables:
        assert np.all(np.load(folder / f"{stem}.npz")["status"] == "completed")


def test_the_stay_in_the_first_well(folder):
    """The source's 45 and 60, to four digits: first upward crossing of 2 pi."""
    table = np.load(folder / "figure_5.npz")
    assert table["adhesion"].tolist() == [50.0, 70.0]
    assert table["first_stay"][:, 0].round(2).tolist() == [45.27, 60.56]
    for places, stay in zip(table["place"], (45.27, 60.56), strict=True):
        crossing = table["t"][np.argmax(places > 2 * np.pi)]
        assert crossing == pytest.approx(stay, abs=0.03)


def test_orbits_agree_with_the_source_step_until_they_part(folder):
    table = np.load(folder / "figure_2.npz")
    early = table["t"] < 15.0
    apart = np.abs(table["place"] - table["paper_place"])[:, early].max()
    assert 1e-4 < apart < 0.1
    assert np.all(table["place"][0] < 2 * np.pi)  # b = 0.25 does not leave the first well


def test_spectra_are_those_of_single_runs(folder):
    table = np.load(folder / "figure_3.npz")
    assert table["adhesion"].tolist() == [1.0, 25.0, 50.0]
    again = growth_exponent(t_end=10.0, n_steps=2000, **CLASSICAL, adhesion=25.0)
    assert table["paper_exponent"][1] == again["exponent"]
    assert set(table["long_verdict"]) <= {
        "exponential growth", "neutral", "exponential decay", "undetermined",
    }  # fmt: skip
    np.testing.assert_allclose(table["fine_exponent"], table["converged_exponent"], atol=0.02)


def test_spectra_over_the_orders_hold_every_horizon(folder):
    table = np.load(folder / "figure_8_beta.npz")
    assert table["fine_exponent"].shape == (3, 2)
    assert np.all(table["fine_exponent"] < 0)
    # values of the horizon: nearer to 0 at the later one
    assert np.all(table["fine_exponent"][:, 1] > table["fine_exponent"][:, 0])


def test_diagrams_and_maps(folder):
    diagram = np.load(folder / "bifurcation_b.npz")
    places = diagram["panel_1_place"]
    assert places.shape == (4, 20)
    assert np.nanmin(places) >= 0
    assert np.nanmax(places) < 2 * np.pi
    cells = np.load(folder / "regimes_b_c.npz")
    assert cells["panel_1_regime"].shape == (cells["adhesion"].size, cells["spring_speed"].size)
    assert set(cells["panel_1_regime"].ravel()) <= {str(kind) for kind in Regime}
    assert np.all((cells["panel_1_certainty"] >= 0) & (cells["panel_1_certainty"] <= 1))


def test_horizons_of_one_run_are_those_of_separate_ones():
    found = exponents(horizons=(5.0, 10.0), h=0.01, beta=1.5)
    for k, t_end in enumerate((5.0, 10.0)):
        alone = growth_exponent(t_end=t_end, n_steps=round(100 * t_end), beta=1.5)
        assert found["exponent"][k] == pytest.approx(alone["exponent"], abs=1e-12)


def test_runs_keep_to_their_parameters():
    times = np.linspace(0.0, 70.0, 8)
    places, speeds, stays = orbit(times=times, **CLASSICAL, adhesion=70.0)
    assert places.shape == speeds.shape == times.shape
    assert stays[0][1] == pytest.approx(60.56, abs=0.005)
    samples = section(t_end=40.0, count=5, adhesion=10.0, spring_speed=2.0)
    assert np.isfinite(samples["place"]).all()
    assert regime(t_end=20.0, n_steps=2000, spring_speed=0.4)["regime"] == "stuck"


def test_orders_of_inertia_near_1_get_short_steps():
    """Half as many steps, those of the check, must still leave the implicit step one solution."""
    steepest = 50.0 * sum(n * a for n, a in enumerate(hd.scenes.PRINTED_WELL, 1))
    for beta in (1.05, 1.3, 1.8, 2.0):
        n = _solvable(1000, 20.0, beta=beta)
        assert (1.5 * n / 2 / 20.0) ** beta > 2 * steepest
        assert n == 1000 or (1.5 * n / 4 / 20.0) ** beta < 2 * steepest


@pytest.mark.parametrize("beta", [1.147, 1.34])
def test_newton_passes_the_barriers(beta):
    found = regime(t_end=400.0, n_steps=20_000, beta=beta, gamma=0.372)
    assert found["regime"] == "stick-slip, periodic"


def test_signs_in_words():
    assert signs([(1, 0.1), (2, 0.2), (3, -0.1), (4, 0.0), (5, np.nan)]) == (
        "+ up to 2, - up to 3, 0 up to 4, ? up to 5"
    )


def test_a_failed_point_of_any_part_is_marked():
    axes = {"b": np.array([1.0, 2.0])}
    good = Table(axes, {"x": np.array([1.0, 2.0])}, np.array(["completed", "completed"]))
    bad = Table(axes, {"x": np.array([1.0, np.nan])}, np.array(["completed", "diverged"]))
    both = merged({"one": good, "other": bad})
    assert both.status.tolist() == ["completed", "diverged"]
    assert both.names == ("one_x", "other_x")


def test_a_quick_job_keeps_the_ends_of_an_axis(tmp_path):
    assert Job(tmp_path, quick=True).few(figures.SPEEDS).tolist() == [0.5, 1.75, 3.0]
    assert Job(tmp_path).few(figures.SPEEDS).size == 51
    sizes = [axis.size for axis in (figures.SPEEDS, figures.ADHESIONS, figures.FRICTIONS)]
    assert sum(sizes) == 122


@pytest.mark.parametrize(
    ("flags", "match"),
    [
        (["--figures", "1,9"], "--figures must name figures among 1, 2,"),
        (["--out", "{file}/below"], "--out must be a folder that can be made"),
    ],
)
def test_bad_flags_are_told(flags, match, tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("")
    flags = [flag.format(file=file) for flag in flags]
    assert main(["paper", "--out", str(tmp_path / "none"), *flags]) == 2
    assert match in capsys.readouterr().err
