"""The compiled loops of runs."""

import pytest

from mbvi.run.fixed_steps import taking


@pytest.fixture
def loops(monkeypatch):
    """The loops of the runs of a test."""
    made, build = [], taking.compiled_loop

    def keep(*arguments):
        made.append(build(*arguments))
        return made[-1]

    monkeypatch.setattr(taking, "compiled_loop", keep)
    return made
