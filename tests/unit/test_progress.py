import io
import sys

import pytest

from deabayes.sampling.progress import progress_bar


def written(monkeypatch, terminal, steps=2000):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: terminal)
    monkeypatch.setattr(sys, "stderr", stream)
    with progress_bar(True, total=steps) as bar:
        for _ in range(steps):
            bar.update(1)
            bar.set_postfix_str("still going", refresh=False)
    return stream.getvalue()


def test_a_log_is_not_filled_by_the_bar(monkeypatch):
    assert 1 <= written(monkeypatch, terminal=False).count("\r") <= 3


@pytest.mark.parametrize("terminal", [True, False])
def test_the_end_is_said(monkeypatch, terminal):
    assert "2000/2000" in written(monkeypatch, terminal)


def test_silent_unless_asked_for(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    with progress_bar(False, total=3) as bar:
        bar.update(3)
    assert stream.getvalue() == ""
