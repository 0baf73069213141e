"""The progress bar draws on a terminal and nowhere else."""

import io

from hereditary.solver import progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_draws_on_a_terminal(monkeypatch):
    clock = iter(float(i) for i in range(100))
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(clock))
    stream = Terminal()
    bar = progress.ProgressBar(True, stream)
    bar.update(0.25)
    bar.update(1.0)
    bar.close()
    text = stream.getvalue()
    assert " 25.0 %  0:03 left" in text
    assert "100.0 %  done in 0:02" in text
    assert text.endswith("\n")


def test_silent_elsewhere():
    for shown, stream in ((True, io.StringIO()), (False, Terminal())):
        bar = progress.ProgressBar(shown, stream)
        bar.update(0.5)
        bar.update(1.0)
        bar.close()
        assert stream.getvalue() == ""


def test_long_times():
    assert progress._clock(3.4) == "0:03"
    assert progress._clock(3725) == "1:02:05"
