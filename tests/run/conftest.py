"""The compiled loops of runs."""

from importlib import import_module

import pytest

from mbvi.run.loop import compiled_loop


@pytest.fixture
def loops(monkeypatch):
    """The loops of the runs of a test."""
    # the package's `simulate` is the function
    simulate, made = import_module("mbvi.run.simulate"), []
    build = simulate.compiled_loop

    def keep(*arguments):
        made.append(build(*arguments))
        return made[-1]

    monkeypatch.setattr(simulate, "compiled_loop", keep)
    return made


@pytest.fixture
def always(monkeypatch):
    """Short runs of several bodies take the loop too."""
    monkeypatch.setattr(compiled_loop, "LONG", 0)
