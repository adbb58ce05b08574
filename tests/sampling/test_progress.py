import io
import sys

import pytest

from deabayes.sampling.progress import Progress, duration


def written(monkeypatch, terminal, shown=True):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: terminal)
    monkeypatch.setattr(sys, "stderr", stream)
    line = Progress(shown)
    line.say("warm-up")
    for steps in range(0, 2000, 10):
        line.say("sampling", steps, 812.4, 1.00312, 250.0)
    line.say("judged", 2000, 900.0, 1.001)
    line.end()
    return stream.getvalue()


def test_a_log_has_a_line_per_state(monkeypatch):
    lines = written(monkeypatch, terminal=False).splitlines()
    assert lines == [
        "warm-up",
        "sampling, 0 steps, smallest ESS 812, R-hat 1.003, about 4 min left",
        "judged, 2000 steps, smallest ESS 900, R-hat 1.001",
    ]


def test_a_log_repeats_the_line_of_a_long_state(monkeypatch):
    monkeypatch.setattr("time.monotonic", iter(range(1000)).__next__)
    lines = written(monkeypatch, terminal=False).splitlines()
    assert len([line for line in lines if line.startswith("sampling")]) == 20


def test_a_terminal_has_one_line_that_is_rewritten(monkeypatch):
    text = written(monkeypatch, terminal=True)
    assert text.count("\n") == 1 and text.endswith("\n")
    *_, longest, last = text.rstrip("\n").split("\r")
    assert len(last) == len(longest) and last.rstrip() == last.strip()


def test_progress_is_silent_by_default(monkeypatch):
    assert written(monkeypatch, terminal=True, shown=False) == ""


@pytest.mark.parametrize(("seconds", "said"), [(40.2, "40 s"), (99.0, "99 s"), (250.0, "4 min")])
def test_durations(seconds, said):
    assert duration(seconds) == said
