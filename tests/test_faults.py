"""Some cases of `make faults` that take milliseconds, with seeds of their own."""

import warnings

import pytest

import mbvi
from support.faults import cases


@pytest.mark.parametrize("kind", ["rotations", "names", "pairs", "mjcf"])
def test_faulty_input_is_refused_or_gives_the_right_answer(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if kind == "mjcf":
        pytest.importorskip("mujoco")
    held = 0
    for seed in range(100_000, 100_012):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mbvi.MbviWarning)
            try:
                getattr(cases, kind)(seed)
                held += 1
            except mbvi.MbviError as error:
                assert str(error)
    assert held
