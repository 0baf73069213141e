"""The command line."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import hereditary as hd
from hereditary.__main__ import _parser, main

TARGET = SimpleNamespace(numba="0.68.1", processor="znver5")


def printed(text, label):
    """Return what the command line prints behind a label."""
    return next(line.removeprefix(label) for line in text.splitlines() if line.startswith(label))


def test_main_job(tmp_path, capsys):
    out = tmp_path / "figure.png"
    assert main(["--n-steps", "20000", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "beta 1.8, gamma 0.8" in text
    assert "20000 steps to t = 100" in printed(text, "explicit")
    assert "56 modes, 896 bytes" in text
    assert "sticking        0.00 .. 45." in text
    assert printed(text, "ensemble").split()[:2] == ["100", "initial"]
    assert printed(text, "figure").strip() == str(out)
    assert out.stat().st_size > 10_000
    # the run by a tolerance comes first, and the explicit run is measured by it
    assert text.index("by tolerance") < text.index("explicit")
    told = float(printed(text, "error estimate").split()[0])
    sol, exact = (hd.solve(hd.scenes.stick_slip(), 100.0, rtol=rtol) for rtol in (1e-8, 1e-11))
    assert np.abs(sol(exact.t) - exact.y).max() < told * np.abs(exact.y).max()
    explicit = hd.solve(hd.scenes.stick_slip(), 100.0, 20000, estimate=False)
    apart = np.abs(explicit.y - exact(explicit.t)).max() / np.abs(exact.y).max()
    # two digits are printed
    assert float(printed(text, "difference").split()[0]) == pytest.approx(apart, rel=0.06)


def test_git_does_not_see_the_figure_of_the_demonstration_in_a_clone():
    ignored = (Path(__file__).parents[1] / ".gitignore").read_text().splitlines()
    assert f"/{_parser().get_default('out')}" in ignored


@pytest.mark.parametrize(
    ("target", "reason", "told"),
    [
        (None, "its compilation failed\nMemoryError", ["none", "its compilation", "MemoryError"]),
        (TARGET, "it is for cpython-310", ["none", "it is for cpython-310"]),
        (TARGET, "", ["installed", "numba 0.68.1", "znver5"]),
    ],
)
def test_the_version_says_whether_machine_code_was_installed(
    target, reason, told, monkeypatch, capsys
):
    monkeypatch.setattr("hereditary.__main__.shipped_target", lambda: (target, reason))
    assert main(["--version"]) == 0
    first, second = capsys.readouterr().out.split("\n", 1)
    assert first == f"hereditary {hd.__version__}"
    assert second.startswith(f"machine code: {told[0]}")
    assert all(word in second for word in told)


def test_everything_is_compiled_ahead(capsys):
    assert main(["compile"]) == 0
    assert "runs are ready" in capsys.readouterr().out


def test_flags_change_the_parameters(tmp_path, capsys):
    out = str(tmp_path / "figure.pdf")
    flags = ["--beta", "2", "--gamma", "1", "--adhesion", "7", "--t-end", "5", "--n-steps", "501"]
    assert main([*flags, "--rtol", "1e-4", "--out", out]) == 0
    text = capsys.readouterr().out
    assert "beta 2, gamma 1" in text
    assert "adhesion 7" in text
    assert "0 modes" in text
    assert float(printed(text, "error estimate").split()[0]) <= 1e-4


@pytest.mark.parametrize(
    ("flags", "match"),
    [
        (["--beta", "2.5"], "beta must lie in (1, 2], got 2.5"),
        (["--n-steps", "0"], "n_steps must"),
        (["--rtol", "0"], "rtol must"),
        (["--out", "missing/figure.png"], "--out must lie in a folder that exists"),
        (["--out", "figure.foo"], "--out must end in one of"),
    ],
)
def test_bad_flags_are_told(flags, match, tmp_path, capsys):
    assert main(["--out", str(tmp_path / "none.png"), *flags]) == 2
    assert match in capsys.readouterr().err
    assert not (tmp_path / "none.png").exists()


def test_a_run_that_fails_is_no_measure(tmp_path, capsys):
    """With 1,000 steps the explicit scheme is unstable here."""
    flags = ["--omega", "100", "--beta", "2", "--gamma", "1", "--adhesion", "0"]
    flags += ["--t-end", "30", "--n-steps", "1000"]
    with pytest.warns(hd.SolveWarning):
        assert main([*flags, "--out", str(tmp_path / "figure.png")]) == 1
    text = capsys.readouterr().out
    assert "reached the end" in printed(text, "by tolerance")
    assert "none" in printed(text, "difference")
