"""The command line."""

import pytest

import hereditary as hd
from hereditary.__main__ import main
from hereditary.compiled.cache import Target

TARGET = Target("0.68.1", "x86_64-linux", "znver5", "+avx2", "cpython-311")


def test_main_job(tmp_path, capsys):
    out = tmp_path / "figure.png"
    assert main(["--n-steps", "20000", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "beta 1.8, gamma 0.8" in printed
    assert "20000 to t = 100" in printed
    assert "56 modes, 896 bytes" in printed
    assert "sticking        0.00 .. 45." in printed
    assert "error estimate" in printed
    assert out.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("target", "reason", "told"),
    [
        (
            None,
            "its compilation failed\nMemoryError",
            ["none", "its compilation failed", "MemoryError"],
        ),
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
    assert main([*flags, "--out", out]) == 0
    printed = capsys.readouterr().out
    assert "beta 2, gamma 1" in printed
    assert "adhesion 7" in printed
    assert "0 modes" in printed
    assert "needs an even number" in printed


@pytest.mark.parametrize(
    ("flags", "match"),
    [
        (["--beta", "2.5"], "beta must lie in (1, 2], got 2.5"),
        (["--n-steps", "0"], "n_steps must"),
        (["--out", "missing/figure.png"], "--out must lie in a folder that exists"),
        (["--out", "figure.foo"], "--out must end in one of"),
    ],
)
def test_bad_flags_are_told(flags, match, tmp_path, capsys):
    assert main(["--out", str(tmp_path / "none.png"), *flags]) == 2
    assert match in capsys.readouterr().err
    assert not (tmp_path / "none.png").exists()


def test_an_unstable_half_step_run_gives_no_estimate(tmp_path, capsys):
    flags = ["--omega", "100", "--beta", "2", "--gamma", "1", "--adhesion", "0"]
    flags += ["--t-end", "30", "--n-steps", "2600"]
    assert main([*flags, "--out", str(tmp_path / "figure.png")]) == 0
    assert "error estimate  none (with half the steps" in capsys.readouterr().out
